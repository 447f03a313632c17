#include <cmath>
#include <numbers>

#include <gtest/gtest.h>
#include <surfel/base/random.h>
#include <surfel/measure/voronoi_cell.h>

namespace surfel {
namespace {

std::vector<Vec2d> grid_neighbors(double h) {
  std::vector<Vec2d> out;
  for (int y = -2; y <= 2; ++y) {
    for (int x = -2; x <= 2; ++x) out.emplace_back(x * h, y * h);
  }
  return out;
}

TEST(VoronoiCell, OfASquareGridIsASquare) {
  const auto cell = voronoi_cell(grid_neighbors(0.5), 1);
  ASSERT_TRUE(cell);
  EXPECT_NEAR(polygon_area(*cell), 0.25, 1e-12);
  for (const Vec2d& corner : *cell) EXPECT_NEAR(corner.norm(), 0.25 * std::numbers::sqrt2, 1e-12);
}

TEST(VoronoiCell, OfAHexagonalGridIsAHexagon) {
  std::vector<Vec2d> neighbors;
  for (int i = 0; i < 6; ++i) {
    const double angle = i * std::numbers::pi / 3;
    neighbors.emplace_back(std::cos(angle), std::sin(angle));
  }
  const auto cell = voronoi_cell(neighbors, 1.5);
  ASSERT_TRUE(cell);
  EXPECT_NEAR(polygon_area(*cell), std::sqrt(3) / 2, 1e-12);
}

TEST(VoronoiCell, IsOpenAtABorderAndWhereNeighboursAreUnknown) {
  EXPECT_FALSE(voronoi_cell({}, 1));
  EXPECT_FALSE(voronoi_cell({{0.1, 0}, {0, 0.1}, {0, -0.1}}, 1));
  EXPECT_FALSE(voronoi_cell(grid_neighbors(0.5), 0.6));
  EXPECT_FALSE(voronoi_cell({{0, 0}, {0, 0}}, 0));
}

TEST(PolygonPoint, IsUniformInArea) {
  const std::vector<Vec2d> triangle_and_more = {{0, 0}, {2, 0}, {2, 1}, {0, 3}};
  Vec2d sum(0, 0);
  int right = 0;
  constexpr int kCount = 100000;
  for (int i = 0; i < kCount; ++i) {
    const Vec2d p =
        polygon_point(triangle_and_more, random_uniform(1, i, 0), random_uniform(1, i, 1));
    ASSERT_GE(p.x(), 0);
    ASSERT_LE(p.x(), 2);
    ASSERT_GE(p.y(), 0);
    ASSERT_LE(p.y(), 3 - p.x() + 1e-12);
    sum += p;
    right += p.x() > 1 ? 1 : 0;
  }
  // A trapezium of parallel sides 3 and 1, width 2: area 4, of which 1.5 lies right of x = 1.
  EXPECT_NEAR(polygon_area(triangle_and_more), 4, 1e-12);
  EXPECT_NEAR(right / static_cast<double>(kCount), 1.5 / 4, 0.01);
  EXPECT_NEAR(sum.x() / kCount, 2.0 / 3 * (3 + 2 * 1) / 4, 0.01);
}

}  // namespace
}  // namespace surfel
