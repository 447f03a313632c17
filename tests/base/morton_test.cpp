#include <bit>
#include <cmath>
#include <limits>
#include <set>

#include <gtest/gtest.h>
#include <surfel/base/bounds.h>
#include <surfel/base/morton.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>

#include "support/message_of.h"

namespace surfel {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();

/// Deterministic shuffle of 0..count-1.
Array<std::uint32_t> shuffled(std::size_t count, std::uint64_t seed) {
  Array<std::uint32_t> order(count);
  for (std::size_t i = 0; i < count; ++i) order[i] = static_cast<std::uint32_t>(i);
  for (std::size_t i = count; i > 1; --i) {
    std::swap(order[i - 1], order[random_bits(seed, i) % i]);
  }
  return order;
}

Array<Vec3f> random_points(std::size_t count) {
  Array<Vec3f> points(count);
  for (std::size_t i = 0; i < count; ++i) {
    for (int a = 0; a < 3; ++a) points[i][a] = static_cast<float>(random_uniform(5, i, a));
  }
  return points;
}

template <class T>
Array<T> picked(const Array<T>& from, const Array<std::uint32_t>& order) {
  Array<T> out(order.size());
  for (std::size_t i = 0; i < order.size(); ++i) out[i] = from[order[i]];
  return out;
}

bool is_permutation_of_indices(const Array<std::uint32_t>& order) {
  const std::set<std::uint32_t> seen(order.begin(), order.end());
  return seen.size() == order.size() && (seen.empty() || *seen.rbegin() + 1 == order.size());
}

TEST(MortonCode, InterleavesTheLow21Bits) {
  for (std::uint64_t i = 0; i < 1000; ++i) {
    std::uint32_t c[3];
    // All 32 bits, of which the high ones do not count.
    for (int a = 0; a < 3; ++a) c[a] = static_cast<std::uint32_t>(random_bits(2, 3 * i + a));
    std::uint64_t expected = 0;
    for (int bit = 0; bit < 21; ++bit) {
      for (int a = 0; a < 3; ++a) expected |= std::uint64_t{c[a] >> bit & 1} << (3 * bit + a);
    }
    ASSERT_EQ(morton_code(c[0], c[1], c[2]), expected) << i;
  }
}

TEST(MortonOrder, WalksTheEightCornersInOrder) {
  Array<Vec3f> corners;
  for (int code = 7; code >= 0; --code) {
    corners.emplace_back(static_cast<float>(code & 1), static_cast<float>(code >> 1 & 1),
                         static_cast<float>(code >> 2 & 1));
  }
  const Array<std::uint32_t> order = morton_order(corners);
  for (std::uint32_t i = 0; i < 8; ++i) EXPECT_EQ(order[i], 7 - i);
}

TEST(MortonOrder, ShuffledPointsComeInTheSameSequence) {
  Array<Vec3f> points = random_points(20000);
  // A tenth of the points share a cell with others, and some are equal.
  for (int i = 0; i < 2000; ++i) {
    points[i] = Vec3f::Constant(0.3F + 1e-8F * static_cast<float>(i % 50));
  }
  const Array<Vec3f> sequence = picked(points, morton_order(points));
  for (std::uint64_t seed = 0; seed < 3; ++seed) {
    const Array<Vec3f> mixed = picked(points, shuffled(points.size(), seed));
    EXPECT_TRUE(picked(mixed, morton_order(mixed)) == sequence);
  }
}

TEST(MortonOrder, IsTheSameForAnyNumberOfThreads) {
  const Array<Vec3f> points = random_points(200000);
  set_thread_count(1);
  const Array<std::uint32_t> alone = morton_order(points);
  for (const int threads : {2, 5}) {
    set_thread_count(threads);
    EXPECT_TRUE(morton_order(points) == alone);
  }
  set_thread_count(0);
}

TEST(MortonOrder, NeighboursInOrderAreNeighboursInSpace) {
  const Array<Vec3f> points = random_points(30000);
  const Array<Vec3f> walk = picked(points, morton_order(points));
  const auto mean_step = [](const Array<Vec3f>& p) {
    double sum = 0;
    for (std::size_t i = 1; i < p.size(); ++i) sum += (p[i] - p[i - 1]).norm();
    return sum / static_cast<double>(p.size() - 1);
  };
  EXPECT_LT(mean_step(walk), mean_step(points) / 10);
}

TEST(MortonOrder, OnePointFarAwayLeavesNeighboursNeighbours) {
  // All points but one share a cell of the grid.
  Array<Vec3f> points = random_points(30000);
  const auto mean_step = [](const Array<Vec3f>& p) {
    double sum = 0;
    for (std::size_t i = 2; i + 1 < p.size(); ++i) sum += (p[i] - p[i - 1]).norm();
    return sum / static_cast<double>(p.size() - 3);
  };
  const double alone = mean_step(picked(points, morton_order(points)));
  points.emplace_back(1e15F, 0.0F, 0.0F);
  EXPECT_LT(mean_step(picked(points, morton_order(points))), 1.1 * alone);
}

TEST(MortonOrder, CurveThroughAllOfSpaceIsTheGridsWherePointsAreNotNegative) {
  const auto cell = [](float v) { return static_cast<std::uint32_t>(v * 0x200000); };
  const auto code = [&](const Vec3f& p) {
    return morton_code(cell(p.x()), cell(p.y()), cell(p.z()));
  };
  const Array<Vec3f> points = random_points(3000);
  for (std::size_t i = 1; i < points.size(); ++i) {
    const Vec3f& p = points[i - 1];
    const Vec3f& q = points[i];
    if (code(p) == code(q)) continue;
    EXPECT_EQ(before_on_curve(p, q), code(p) < code(q));
    EXPECT_EQ(before_on_curve(-p, -q), before_on_curve(q, p));
  }
}

TEST(MortonOrder, StepsAreAsLargeAsTheCellsWhoseBorderTheyCross) {
  const auto code = [&](const Vec3f& p) {
    const auto cell = [](float v) { return static_cast<std::uint32_t>(v); };
    return morton_code(cell(p.x()), cell(p.y()), cell(p.z()));
  };
  const auto width = [&](const Vec3f& p, const Vec3f& q) {
    return std::bit_width(code(p) ^ code(q));
  };
  Array<Vec3f> points = random_points(3000);
  for (Vec3f& p : points) p = (0x200000 * p).array().floor();
  for (std::size_t i = 2; i < points.size(); ++i) {
    const Vec3f& p = points[i - 2];
    const Vec3f& q = points[i - 1];
    const Vec3f& r = points[i];
    EXPECT_EQ(step_on_curve(p, q) < step_on_curve(q, r), width(p, q) < width(q, r));
    EXPECT_EQ(step_on_curve(p, q), step_on_curve(q, p));
  }
  EXPECT_EQ(step_on_curve(points[0], points[0]), 0);
  EXPECT_GT(step_on_curve({-1, 0, 0}, {1, 0, 0}), step_on_curve({1, 1, 1}, {1e30F, 1e30F, 1e30F}));
}

TEST(MortonOrder, CurveThroughAllOfSpaceOrdersNumbersOfAllScales) {
  constexpr float kLeast = std::numeric_limits<float>::denorm_min();
  const float ascending[] = {-1e30F, -2,         -1,     -1e-30F, -3 * kLeast, -kLeast, 0,
                             kLeast, 2 * kLeast, 1e-38F, 2e-38F,  1,           1.5F,    1e30F};
  for (const float a : ascending) {
    for (const float b : ascending) {
      for (int axis = 0; axis < 3; ++axis) {
        EXPECT_EQ(before_on_curve(a * Vec3f::Unit(axis), b * Vec3f::Unit(axis)), a < b) << a << b;
      }
    }
  }
  EXPECT_FALSE(before_on_curve(Vec3f(0, 0, 0), Vec3f(-0.0F, 0, 0)));
}

TEST(Bounds, AreRefusedWhereSinglePrecisionCannotHoldTheirScale) {
  const auto box = [](double low, double high) {
    return Bounds{Vec3d::Constant(low), Vec3d::Constant(high)};
  };
  EXPECT_NO_THROW(require_float_extent(Bounds{}, "a"));
  EXPECT_NO_THROW(require_float_extent(box(3, 3), "a"));
  EXPECT_NO_THROW(require_float_extent(box(-1e15, 1e15), "a"));
  EXPECT_NO_THROW(require_float_extent(box(0, 1e-14), "a"));
  for (const Bounds& bad : {box(0, 1e-16), box(-1e19, 1)}) {
    const std::string message = test::message_of([&] { require_float_extent(bad, "a.ply"); });
    EXPECT_EQ(message.find("a.ply: "), 0U);
    EXPECT_NE(message.find("scale it"), std::string::npos);
  }
}

TEST(MortonOrder, PutsPointsThatAreNotFiniteLast) {
  Array<Vec3f> points = random_points(100);
  points[0] = Vec3f(kNan, 0, 0);
  points[50] = Vec3f(0, kInfinity, 0);
  points[70] = Vec3f(0, 0, -kInfinity);
  const Array<std::uint32_t> order = morton_order(points);
  EXPECT_TRUE(is_permutation_of_indices(order));
  EXPECT_EQ(order[97], 0U);
  EXPECT_EQ(order[98], 50U);
  EXPECT_EQ(order[99], 70U);
}

TEST(MortonOrder, TakesAnyExtent) {
  EXPECT_TRUE(morton_order({}).empty());
  EXPECT_EQ(morton_order({Vec3f(1, 2, 3)}).size(), 1U);
  EXPECT_TRUE(is_permutation_of_indices(morton_order({Vec3f(1, 2, 3), Vec3f(1, 2, 3)})));
  EXPECT_TRUE(is_permutation_of_indices(morton_order({Vec3f::Constant(kNan)})));
  constexpr float kMax = std::numeric_limits<float>::max();
  constexpr float kLeast = std::numeric_limits<float>::denorm_min();
  EXPECT_EQ(morton_order({Vec3f::Constant(kMax), Vec3f::Constant(-kMax)})[0], 1U);
  EXPECT_EQ(morton_order({Vec3f(kLeast, 0, 0), Vec3f::Zero()})[0], 1U);
}

/// in_order() says what morton_order() would do.
TEST(MortonGrid, KnowsWhetherPointsAreInOrder) {
  Array<Vec3f> points = random_points(70000);
  for (int i = 0; i < 500; ++i)
    points[i] = Vec3f::Constant(0.3F + 1e-8F * static_cast<float>(i % 5));
  points = picked(points, morton_order(points));
  const auto in_order = [](const Array<Vec3f>& p) {
    Array<float> columns[3];
    Vec3f min = p[0];
    Vec3f max = p[0];
    for (const Vec3f& point : p) {
      for (int axis = 0; axis < 3; ++axis) columns[axis].push_back(point[axis]);
      min = min.cwiseMin(point);
      max = max.cwiseMax(point);
    }
    return MortonGrid(min, max).in_order(
        {columns[0].data(), columns[1].data(), columns[2].data(), p.size()});
  };
  EXPECT_TRUE(in_order(points));
  for (std::size_t i = 1; i < points.size(); i += 3500) {
    Array<Vec3f> swapped = points;
    std::swap(swapped[i - 1], swapped[i]);
    EXPECT_EQ(in_order(swapped), points[i - 1] == points[i]) << i;
  }
  std::swap(points[65535], points[65536]);  // Where two threads' shares meet.
  EXPECT_FALSE(in_order(points));
}

}  // namespace
}  // namespace surfel
