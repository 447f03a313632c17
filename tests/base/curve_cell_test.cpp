#include <algorithm>
#include <cmath>
#include <set>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/curve_cell.h>
#include <surfel/base/error.h>
#include <surfel/base/morton.h>
#include <surfel/base/random.h>

namespace surfel {
namespace {

/// Points of all scales and signs, some of them on borders of cells.
std::vector<Vec3d> points() {
  std::vector<Vec3d> all{{0, 0, 0},      {-0.0, 0, 0},     {1, 0, 0},
                         {-1, 0, 0},     {0.5, 0.5, -0.5}, {1e-300, 0, 0},
                         {-1e300, 1, 1}, {1e300, 1, 1},    {455000.25, 5401000, 200}};
  for (std::uint64_t i = 0; i < 300; ++i) {
    const double scale = std::pow(2, static_cast<double>(random_bits(1, i) % 40) - 20);
    Vec3d p;
    for (std::uint64_t axis = 0; axis < 3; ++axis) {
      const double steps = static_cast<double>(random_bits(2 + axis, i) % 64) - 32;
      p[static_cast<Eigen::Index>(axis)] = steps * scale;
    }
    all.push_back(p);
  }
  return all;
}

TEST(CurveCell, HoldsWhatItsSideSays) {
  const std::vector<Vec3d> all = points();
  for (const Vec3d& p : all) {
    EXPECT_EQ(common_side(p, p), kNoSide);
    for (const Vec3d& q : all) {
      const int side = common_side(p, q);
      EXPECT_EQ(side, common_side(q, p));
      if (p == q) continue;
      ASSERT_NE(side, kNoSide);
      const CurveCell both = cell_around(p, side);
      EXPECT_TRUE(both.contains(p));
      EXPECT_TRUE(both.contains(q));
      EXPECT_EQ(both.name(), cell_around(q, side).name());
      const CurveCell smaller = cell_around(p, side - 1);
      EXPECT_TRUE(smaller.contains(p));
      EXPECT_FALSE(smaller.contains(q)) << p.transpose() << " / " << q.transpose();
      EXPECT_NE(smaller.name(), cell_around(q, side - 1).name());
    }
  }
}

TEST(CurveCell, CellsAreRangesOfTheCurve) {
  std::vector<Vec3d> all = points();
  std::sort(all.begin(), all.end(), before_in_space);
  for (std::size_t i = 0; i + 1 < all.size(); ++i) {
    EXPECT_FALSE(before_in_space(all[i + 1], all[i]));
    for (int side = common_side(all[i], all[i + 1]) - 3; side < 20; side += 2) {
      if (side < -300) continue;
      const CurveCell cell = cell_around(all[i], side);
      std::size_t changes = 0;
      for (std::size_t k = 0; k + 1 < all.size(); ++k) {
        if (cell.contains(all[k]) != cell.contains(all[k + 1])) ++changes;
      }
      EXPECT_LE(changes, 2U) << cell.name();
      // The middle stands for its cell along the curve.
      for (const Vec3d& p : all) {
        if (cell.contains(p)) continue;
        EXPECT_EQ(before_in_space(p, cell.center), before_in_space(p, all[i]));
      }
    }
  }
}

TEST(CurveCell, TheCurveIsTheOneOfFloats) {
  const std::vector<Vec3d> all = points();
  for (const Vec3d& p : all) {
    for (const Vec3d& q : all) {
      const Vec3f a = p.cast<float>();
      const Vec3f b = q.cast<float>();
      if (!a.allFinite() || !b.allFinite()) continue;
      EXPECT_EQ(before_in_space(a.cast<double>(), b.cast<double>()), before_on_curve(a, b));
    }
  }
}

TEST(CurveCell, AllOfSpaceHasNoBorder) {
  const CurveCell all = cell_around({3, 4, 5}, CurveCell::kAllSpace);
  EXPECT_EQ(all.name(), "all");
  for (const Vec3d& p : points()) EXPECT_TRUE(all.contains(p));
}

TEST(CurveCell, SmallerThanPrecisionIsRefused) {
  EXPECT_THROW(cell_around({0x1p52 + 1, 0, 0}, 0), Error);
}

}  // namespace
}  // namespace surfel
