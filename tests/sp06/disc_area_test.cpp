#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/random.h>
#include <surfel/sp06/disc_area.h>

namespace surfel {
namespace {

/// Lens of two discs, by the textbook formula.
double lens(double r, double s, double d) {
  if (d >= r + s) return 0;
  if (d <= std::abs(r - s)) return std::numbers::pi * std::min(r, s) * std::min(r, s);
  const double a = std::acos((d * d + r * r - s * s) / (2 * d * r));
  const double b = std::acos((d * d + s * s - r * r) / (2 * d * s));
  return r * r * (a - std::sin(2 * a) / 2) + s * s * (b - std::sin(2 * b) / 2);
}

/// Share of the square |x|, |y| <= half where `inside` holds, times its area; midpoints of a grid.
template <class Inside>
double grid_area(double half, Inside inside) {
  constexpr int kSide = 400;
  int count = 0;
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      if (inside(Vec2d(half * (2 * (x + 0.5) / kSide - 1), half * (2 * (y + 0.5) / kSide - 1)))) {
        ++count;
      }
    }
  }
  return 4 * half * half * count / (kSide * kSide);
}

std::vector<Vec2d> convex_polygon(std::uint64_t seed) {
  // Corners on an ellipse about a place near the origin.
  const auto uniform = [&](std::uint64_t k) { return random_uniform(seed, k); };
  const auto count = 3 + static_cast<std::size_t>(6 * uniform(0));
  const Vec2d center(uniform(1) - 0.5, uniform(2) - 0.5);
  std::vector<double> angle;
  for (std::size_t k = 0; k < count; ++k) angle.push_back(2 * std::numbers::pi * uniform(10 + k));
  std::sort(angle.begin(), angle.end());
  std::vector<Vec2d> corners;
  for (const double a : angle) {
    corners.emplace_back(center + Vec2d(1.4 * std::cos(a), 0.9 * std::sin(a)));
  }
  return corners;
}

bool inside_polygon(const std::vector<Vec2d>& polygon, const Vec2d& p) {
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Vec2d side = polygon[(i + 1) % polygon.size()] - polygon[i];
    const Vec2d to = p - polygon[i];
    if (side.x() * to.y() - side.y() * to.x() < 0) return false;
  }
  return true;
}

TEST(DiscAreaInPolygon, SquareInClosedForm) {
  const std::vector<Vec2d> square{{-1, -1}, {1, -1}, {1, 1}, {-1, 1}};
  EXPECT_NEAR(disc_area_in_polygon(0.5, square), std::numbers::pi / 4, 1e-14);
  EXPECT_NEAR(disc_area_in_polygon(1, square), std::numbers::pi, 1e-14);
  EXPECT_NEAR(disc_area_in_polygon(1.5, square), 4, 1e-14) << "the corners are at 1.41";
  const double r = 1.2;
  const double segment = r * r * std::acos(1 / r) - std::sqrt(r * r - 1);
  EXPECT_NEAR(disc_area_in_polygon(r, square), std::numbers::pi * r * r - 4 * segment, 1e-13);
  EXPECT_EQ(disc_area_in_polygon(0, square), 0);
  EXPECT_EQ(disc_area_in_polygon(1, {}), 0);
}

TEST(DiscAreaInPolygon, HoldsAtAnyScale) {
  for (const double scale : {1e-12, 1e-6, 1e6, 1e12}) {
    const std::vector<Vec2d> square{
        {-scale, -scale}, {scale, -scale}, {scale, scale}, {-scale, scale}};
    EXPECT_NEAR(disc_area_in_polygon(scale, square) / (scale * scale), std::numbers::pi, 1e-12)
        << scale;
    // A quarter of a disc far smaller than the polygon.
    const std::vector<Vec2d> corner{{0, 0}, {scale, 0}, {scale, scale}, {0, scale}};
    EXPECT_NEAR(disc_area_in_polygon(1e-3 * scale, corner) / (1e-6 * scale * scale),
                std::numbers::pi / 4, 1e-9);
  }
}

TEST(DiscAreaInPolygon, AgreesWithNumericIntegration) {
  for (std::uint64_t seed = 0; seed < 12; ++seed) {
    const std::vector<Vec2d> polygon = convex_polygon(seed);
    const double radius = 0.3 + 1.2 * random_uniform(seed, 3);
    const double expected = grid_area(
        2, [&](const Vec2d& p) { return p.norm() < radius && inside_polygon(polygon, p); });
    EXPECT_NEAR(disc_area_in_polygon(radius, polygon), expected, 4e-3) << seed;
  }
}

TEST(UncoveredDiscArea, LensesInClosedForm) {
  UncoveredDiscArea uncovered;
  const Circle disc{{3, -2}, 1};
  EXPECT_NEAR(uncovered(disc, {}), std::numbers::pi, 1e-14);
  for (const double d : {0.1, 0.5, 0.9, 1.3, 1.7, 2.5}) {
    for (const double s : {0.2, 0.7, 1.0, 1.6}) {
      const std::vector<Circle> other{{disc.center + d * Vec2d(0.6, 0.8), s}};
      EXPECT_NEAR(uncovered(disc, other), std::numbers::pi - lens(1, s, d), 1e-12) << d << ' ' << s;
      // The same disc twice hides no more than once.
      const std::vector<Circle> twice{other[0], other[0]};
      EXPECT_NEAR(uncovered(disc, twice), std::numbers::pi - lens(1, s, d), 1e-12) << d << ' ' << s;
    }
  }
  EXPECT_EQ(uncovered(disc, std::vector<Circle>{disc}), 0) << "covered by its own copy";
}

TEST(UncoveredDiscArea, AgreesWithNumericIntegration) {
  UncoveredDiscArea uncovered;
  for (std::uint64_t seed = 0; seed < 12; ++seed) {
    std::vector<Circle> others;
    for (std::uint64_t k = 0; k < 2 + seed; ++k) {
      others.push_back(
          {Vec2d(3 * random_uniform(seed, 3 * k) - 1.5, 3 * random_uniform(seed, 3 * k + 1) - 1.5),
           0.1 + 0.7 * random_uniform(seed, 3 * k + 2)});
    }
    const double expected = grid_area(1, [&](const Vec2d& p) {
      return p.norm() < 1 && std::none_of(others.begin(), others.end(), [&](const Circle& c) {
               return (p - c.center).norm() < c.radius;
             });
    });
    EXPECT_NEAR(uncovered({Vec2d(0, 0), 1}, others), expected, 4e-3) << seed;
  }
}

}  // namespace
}  // namespace surfel
