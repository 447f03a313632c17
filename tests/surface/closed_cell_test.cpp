#include <Eigen/Geometry>
#include <cmath>

#include <gtest/gtest.h>
#include <surfel/base/random.h>
#include <surfel/surface/closed_cell.h>
#include <surfel/surface/voronoi_cell.h>

namespace surfel {
namespace {

struct OrientedPoints {
  Array<Vec3f> position;
  Array<Vec3f> normal;
};

/// 20 x 20 points of a tilted plane, `spacing` apart, moved by up to `jitter` spacings.
OrientedPoints tilted_grid(double jitter, float spacing) {
  const Vec3f n = Vec3f(0.3F, -0.5F, -0.8F).normalized();
  const Vec3f a = n.unitOrthogonal();
  const Vec3f b = n.cross(a);
  OrientedPoints out;
  for (std::uint64_t k = 0; k < 400; ++k) {
    const auto at = [&](double i, int axis) {
      return static_cast<float>(i + jitter * (2 * random_uniform(4, k, axis) - 1)) * spacing;
    };
    const auto u = at(static_cast<double>(k % 20), 0);
    const auto v = at(static_cast<double>(k / 20), 1);
    out.position.emplace_back(u * a + v * b);
    out.normal.push_back(n);
  }
  return out;
}

/// All as far as the plane reaches: the cell is what VoronoiCell makes of the same neighbours.
void expect_voronoi_cells(const OrientedPoints& points, std::size_t k, float spacing) {
  const auto search = make_neighbor_search(points.position);
  const CellSurface surface{points.position, points.normal, true};
  std::vector<Neighbor> near;
  std::size_t closed = 0;
  for (std::size_t i = 0; i < points.position.size(); ++i) {
    search->nearest(points.position[i], k, near);
    const float reach = std::sqrt(near.back().distance2);
    ClosedCell cell;
    CellLimits limits{reach, 0.5F * spacing, 4 * spacing};
    CellState state = measure_cell(surface, i, near, limits, cell);
    if (state == CellState::kBeyondReach) {
      limits.reach = 2.001F * reach * std::sqrt(cell.radius2);
      std::vector<Neighbor> more;
      search->within(points.position[i], limits.reach, ClosedCell::kMostNeighbors / 2, more);
      std::erase_if(more, [&](const Neighbor& n) { return n.distance2 < near.back().distance2; });
      state = extend_cell(surface, i, more, limits, cell);
    }
    if (state != CellState::kClosed) continue;
    ++closed;
    search->within(points.position[i], 2 * limits.reach, points.position.size(), near);
    VoronoiCell expected;
    expected.reset(static_cast<double>(limits.reach));
    for (const Neighbor& n : near) {
      const Vec3d offset = (points.position[n.index] - points.position[i]).cast<double>();
      expected.cut({offset.dot(cell.a.cast<double>()), offset.dot(cell.b.cast<double>())});
    }
    const double unit2 = cell.unit * cell.unit;
    const Eigen::Matrix2d moments = expected.moments() / (unit2 * unit2);
    ASSERT_NEAR(cell.radius2 * unit2 / expected.radius2(), 1, 1e-4) << i;
    ASSERT_NEAR(cell.area * unit2 / expected.area(), 1, 1e-4) << i;
    ASSERT_NEAR(cell.xx, moments(0, 0), 1e-4 * moments.trace()) << i;
    ASSERT_NEAR(cell.xy, moments(0, 1), 1e-4 * moments.trace()) << i;
    ASSERT_NEAR(cell.yy, moments(1, 1), 1e-4 * moments.trace()) << i;
    for (const Vec2d& corner : expected.corners()) {
      double nearest2 = 1;
      for (std::size_t c = 0; c < cell.corners; ++c) {
        const Vec2d other(cell.corner_x[c], cell.corner_y[c]);
        nearest2 = std::min(nearest2, (other - corner / cell.unit).squaredNorm());
      }
      ASSERT_LT(nearest2, 1e-6) << i;
    }
  }
  // All but those at the border.
  EXPECT_GT(closed, 280U);
  EXPECT_LT(closed, 380U);
}

TEST(ClosedCell, IsTheVoronoiCell) {
  for (const float spacing : {1.0F, 1e-12F, 1e12F}) {
    for (const double jitter : {0.0, 0.01, 0.3, 1.0}) {
      for (const std::size_t k : {12, 16, 30}) {
        SCOPED_TRACE(testing::Message() << spacing << ' ' << jitter << ' ' << k);
        expect_voronoi_cells(tilted_grid(jitter, spacing), k, spacing);
      }
    }
  }
}

TEST(ClosedCell, CoincidentAndNearlyCoincidentNeighborsCountOnce) {
  for (const float apart : {0.0F, 1e-7F, 1e-5F, 1e-3F}) {
    OrientedPoints points = tilted_grid(0.3, 1);
    const std::size_t count = points.position.size();
    for (std::size_t i = 0; i < count; ++i) {
      points.position.emplace_back(points.position[i] + Vec3f(apart, apart, 0));
      points.normal.push_back(points.normal[i]);
    }
    const auto search = make_neighbor_search(points.position);
    std::vector<Neighbor> near;
    search->nearest(points.position[210], 32, near);
    ClosedCell cell;
    const CellLimits limits{std::sqrt(near.back().distance2), 1, 4};
    const CellState state =
        measure_cell({points.position, points.normal, true}, 210, near, limits, cell);
    // Single precision may not tell where the edges of near twins meet, but it tells that.
    if (apart > 0 && state == CellState::kOpen) continue;
    ASSERT_EQ(state, CellState::kClosed) << apart;
    VoronoiCell expected;
    expected.reset(static_cast<double>(limits.reach));
    for (const Neighbor& n : near) {
      const Vec3d offset = (points.position[n.index] - points.position[210]).cast<double>();
      expected.cut({offset.dot(cell.a.cast<double>()), offset.dot(cell.b.cast<double>())});
    }
    EXPECT_NEAR(cell.area * cell.unit * cell.unit / expected.area(), 1, 1e-3) << apart;
  }
}

TEST(ClosedCell, OtherSheetsAndBordersAreSeen) {
  OrientedPoints points = tilted_grid(0.3, 1);
  const auto search = make_neighbor_search(points.position);
  std::vector<Neighbor> near;
  ClosedCell cell;
  search->nearest(points.position[210], 16, near);
  const CellLimits limits{std::sqrt(near.back().distance2), 1, 4};
  const auto state = [&](bool oriented) {
    return measure_cell({points.position, points.normal, oriented}, 210, near, limits, cell);
  };
  ASSERT_EQ(state(true), CellState::kClosed);
  // Half a plane.
  const Vec3f across = points.position[211] - points.position[210];
  for (const Neighbor& n : near) {
    if ((points.position[n.index] - points.position[210]).dot(across) > 0) {
      points.normal[n.index] *= -1;
    }
  }
  EXPECT_EQ(state(true), CellState::kOpen);
  EXPECT_EQ(state(false), CellState::kClosed);
  // Neighbours behind an edge.
  for (const Neighbor& n : near) {
    if ((points.position[n.index] - points.position[210]).dot(across) > 0) {
      points.position[n.index] += 5 * points.normal[210];
    }
  }
  EXPECT_EQ(state(false), CellState::kOpen);
}

}  // namespace
}  // namespace surfel
