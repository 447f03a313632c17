#include <cmath>
#include <numbers>

#include <gtest/gtest.h>
#include <surfel/base/random.h>
#include <surfel/surface/voronoi_cell.h>

namespace surfel {
namespace {

std::vector<Vec2d> grid_neighbors(double h) {
  std::vector<Vec2d> out;
  for (int y = -2; y <= 2; ++y) {
    for (int x = -2; x <= 2; ++x) out.emplace_back(x * h, y * h);
  }
  return out;
}

VoronoiCell cell_of(const std::vector<Vec2d>& neighbors, double half_side) {
  VoronoiCell cell;
  cell.reset(half_side);
  for (const Vec2d& neighbor : neighbors) cell.cut(neighbor);
  return cell;
}

TEST(VoronoiCell, OfASquareGridIsASquare) {
  const VoronoiCell cell = cell_of(grid_neighbors(0.5), 1);
  EXPECT_NEAR(cell.area(), 0.25, 1e-12);
  EXPECT_NEAR(cell.radius(), 0.25 * std::numbers::sqrt2, 1e-12);
  for (const Vec2d& corner : cell.corners()) EXPECT_NEAR(corner.norm(), cell.radius(), 1e-12);
  // Integral of x^2 over a square of side h is h^4 / 12.
  EXPECT_TRUE(cell.moments().isApprox(Eigen::Matrix2d::Identity() / 192, 1e-12));
}

TEST(VoronoiCell, OfAHexagonalGridIsAHexagon) {
  std::vector<Vec2d> neighbors;
  for (int i = 0; i < 6; ++i) {
    const double angle = i * std::numbers::pi / 3;
    neighbors.emplace_back(std::cos(angle), std::sin(angle));
  }
  EXPECT_NEAR(cell_of(neighbors, 1.5).area(), std::sqrt(3) / 2, 1e-12);
}

TEST(VoronoiCell, ReachesTheSquareAtABorder) {
  EXPECT_NEAR(cell_of({}, 1).radius(), std::numbers::sqrt2, 1e-12);
  EXPECT_NEAR(cell_of({{0.1, 0}, {0, 0.1}, {0, -0.1}}, 1).radius(), std::hypot(1, 0.05), 1e-12);
  EXPECT_NEAR(cell_of({{0, 0}, {0, 0}}, 1).area(), 4, 1e-12);  // Coincident points cut nothing.
}

TEST(VoronoiCell, PointsAreUniformInArea) {
  const VoronoiCell cell =
      cell_of({{1, 1}}, 1);  // A square of side 2 without the corner x + y > 1.
  EXPECT_NEAR(cell.area(), 3.5, 1e-12);
  double sum = 0;
  int right = 0;
  constexpr int kCount = 100000;
  for (int i = 0; i < kCount; ++i) {
    const Vec2d p = cell.point(random_uniform(1, i, 0), random_uniform(1, i, 1));
    ASSERT_LE(p.cwiseAbs().maxCoeff(), 1 + 1e-12);
    ASSERT_LE(p.sum(), 1 + 1e-12);
    sum += p.x();
    right += p.x() > 0 ? 1 : 0;
  }
  EXPECT_NEAR(right / static_cast<double>(kCount), 1.5 / 3.5, 0.01);
  EXPECT_NEAR(sum / kCount, -0.5 * 2 / 3 / 3.5, 0.01);
}

}  // namespace
}  // namespace surfel
