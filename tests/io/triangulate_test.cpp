#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/io/triangulate.h>

namespace surfel {
namespace {

double cross(const Vec2d& a, const Vec2d& b) { return a.x() * b.y() - a.y() * b.x(); }

/// Triangles of a polygon in the plane z = 0: their number and winding are right, and as their
/// areas sum to the polygon's they neither overlap nor leave it.
void expect_tiled(const std::vector<Vec2d>& polygon) {
  std::vector<Vec3d> corners;
  double whole = 0;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    corners.emplace_back(polygon[i].x(), polygon[i].y(), 0);
    whole += cross(polygon[i], polygon[(i + 1) % polygon.size()]) / 2;
  }
  std::vector<std::array<std::uint32_t, 3>> triangles;
  triangulate_polygon(corners, triangles);
  EXPECT_EQ(triangles.size(), polygon.size() - 2);
  double sum = 0;
  for (const auto& [a, b, c] : triangles) {
    const double signed_area = cross(polygon[b] - polygon[a], polygon[c] - polygon[a]) / 2;
    EXPECT_GE(signed_area * whole, 0);
    sum += signed_area;
  }
  EXPECT_NEAR(sum, whole, 1e-9 * std::abs(whole));
}

std::vector<Vec2d> reversed(std::vector<Vec2d> polygon) {
  return {polygon.rbegin(), polygon.rend()};
}

TEST(TriangulatePolygon, TilesConcavePolygonsOfEitherWinding) {
  const std::vector<Vec2d> arrow{{0, 0}, {2, 1}, {0, 2}, {0.5, 1}};
  const std::vector<Vec2d> comb{{0, 0}, {6, 0}, {6, 3}, {5, 3}, {5, 1}, {4, 1},
                                {4, 3}, {3, 3}, {3, 1}, {2, 1}, {2, 3}, {0, 3}};
  const std::vector<Vec2d> collinear{{0, 0}, {1, 0}, {2, 0}, {2, 2}, {1, 2}, {0, 2}, {0, 1}};
  // A square with a square hole, joined by a bridge that is walked twice.
  const std::vector<Vec2d> hole{{0, 0}, {4, 0}, {4, 4}, {0, 4}, {0, 0},
                                {1, 1}, {1, 3}, {3, 3}, {3, 1}, {1, 1}};
  for (const auto& polygon : {arrow, comb, collinear, hole}) {
    expect_tiled(polygon);
    expect_tiled(reversed(polygon));
  }
}

TEST(TriangulatePolygon, TilesRandomStars) {
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    std::vector<Vec2d> star;
    const std::size_t corners = 4 + seed % 40;
    for (std::size_t i = 0; i < corners; ++i) {
      const double angle = 2 * M_PI * static_cast<double>(i) / static_cast<double>(corners);
      const double radius = 0.1 + 0.1 * static_cast<double>((seed * 7919 + i * i * 31) % 97);
      star.emplace_back(radius * std::cos(angle), radius * std::sin(angle));
    }
    expect_tiled(star);
  }
}

TEST(TriangulatePolygon, CrossedAndFlatPolygonsEnd) {
  const std::vector<std::vector<Vec3d>> polygons{
      {{0, 0, 0}, {1, 1, 0}, {1, 0, 0}, {0, 1, 0}},
      {{0, 0, 0}, {0, 0, 0}, {0, 0, 0}, {0, 0, 0}},
      {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {3, 0, 0}, {1, 0, 0}}};
  for (const auto& polygon : polygons) {
    std::vector<std::array<std::uint32_t, 3>> triangles;
    triangulate_polygon(polygon, triangles);
    EXPECT_EQ(triangles.size(), polygon.size() - 2);
  }
}

TEST(TriangulatePolygon, TilesLongPolygons) {
  // So many corners that to look at all reflex ones for each ear would take minutes.
  constexpr std::size_t kCorners = 40000;
  constexpr auto kHalf = static_cast<int>(kCorners / 2);
  std::vector<Vec2d> comb;
  std::vector<Vec2d> spiral;
  std::vector<Vec2d> star;
  std::vector<Vec2d> flat_sides;
  std::vector<Vec2d> petals;
  const auto polar = [](double radius, double angle) {
    return Vec2d(radius * std::cos(angle), radius * std::sin(angle));
  };
  for (int i = 0; i < kHalf; ++i) {
    comb.emplace_back(i, 0);
    comb.emplace_back(i + 0.5, 1000);
    spiral.push_back(polar(1 + i, 0.01 * i));
    star.push_back(polar(1 + (i * 7919 % 997), M_PI * 2 * i / kHalf));
    star.push_back(polar(1 + (i * 104729 % 499), M_PI * (2 * i + 1) / kHalf));
    flat_sides.emplace_back(i, 0);
    // All begin at one place.
    petals.emplace_back(0, 0);
    petals.push_back(polar(1, M_PI * 2 * i / kHalf));
    petals.push_back(polar(1, M_PI * (2 * i + 1) / kHalf));
  }
  comb.emplace_back(kHalf, -1);
  comb.emplace_back(-1, -1);
  for (int i = kHalf; i-- > 0;) {
    spiral.push_back(polar(200 + i, 0.01 * i));
    flat_sides.emplace_back(i, kHalf - 1 - i);
  }
  for (const auto& polygon : {comb, spiral, star, flat_sides, petals}) {
    expect_tiled(polygon);
    expect_tiled(reversed(polygon));
  }
}

TEST(TriangulatePolygon, CrossedPolygonsOfManyCornersEndWithTheirSignedArea) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<Vec3d> scribble;
  std::vector<Vec3d> walk(1, Vec3d::Zero());
  std::vector<Vec3d> grid;
  while (scribble.size() < 40000) {
    scribble.emplace_back(uniform(random), uniform(random), 0);
    walk.emplace_back(walk.back() + Vec3d(uniform(random) - 0.5, uniform(random) - 0.5, 0));
    // Most corners coincide with others.
    grid.emplace_back(std::floor(uniform(random) * 30), std::floor(uniform(random) * 30), 0);
  }
  const std::vector<Vec3d> place(40000, Vec3d(1, 2, 3));
  for (const auto& polygon : {scribble, walk, grid, place}) {
    std::vector<std::array<std::uint32_t, 3>> triangles;
    triangulate_polygon(polygon, triangles);
    ASSERT_EQ(triangles.size(), polygon.size() - 2);
    Vec3d area = Vec3d::Zero();
    for (std::size_t i = 0; i < polygon.size(); ++i) {
      area += polygon[i].cross(polygon[(i + 1) % polygon.size()]) / 2;
    }
    std::vector<bool> used(polygon.size());
    for (const auto& [a, b, c] : triangles) {
      area -= (polygon[b] - polygon[a]).cross(polygon[c] - polygon[a]) / 2;
      used[a] = used[b] = used[c] = true;
    }
    EXPECT_NEAR(area.norm(), 0, 1e-6);
    EXPECT_EQ(std::count(used.begin(), used.end(), false), 0);
  }
}

}  // namespace
}  // namespace surfel
