#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include <gtest/gtest.h>
#include <hwy/highway.h>
#include <surfel/base/random.h>
#include <surfel/scene/cluster_bounds.h>
#include <surfel/scene/usable_surfels.h>

namespace surfel {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();

/// Surfels around a point, normals in one octant; NaN after the last.
struct Surfels {
  std::array<std::vector<float>, 9> column;
  std::vector<float> area, alpha;
  std::size_t count;

  explicit Surfels(std::size_t n) : count(n) {
    for (std::size_t c = 0; c < column.size(); ++c) {
      column[c].assign(n + kColumnPadding, kNan);
      for (std::size_t i = 0; i < n; ++i) {
        const auto random = static_cast<float>(random_uniform(c, i));
        column[c][i] = c < 3 ? 100 + random : c < 6 ? random + 0.2F : 0.1F + random;
      }
    }
    for (std::size_t i = 0; i < n; ++i) {
      const float length = normal(i).norm();
      for (int axis = 0; axis < 3; ++axis) column[3 + axis][i] /= length;
    }
    alpha.assign(n + kColumnPadding, kNan);
    std::fill_n(alpha.begin(), n, 1.0F);
    area = alpha;
  }
  Vec3f position(std::size_t i) const { return {column[0][i], column[1][i], column[2][i]}; }
  Vec3f normal(std::size_t i) const { return {column[3][i], column[4][i], column[5][i]}; }
  float deviation(std::size_t i) const { return std::max(column[6][i], column[7][i]); }
  ClusterColumns columns() const {
    const auto from = [&](std::size_t c) { return column[c].data(); };
    return {.position = {from(0), from(1), from(2)},
            .normal = {from(3), from(4), from(5)},
            .deviation_u = from(6),
            .deviation_v = from(7),
            .count = count};
  }
  /// Column 8 stands for what must be bounded and no more.
  SurfelTotals totals() const {
    const float* positive[] = {column[6].data(), column[7].data()};
    const float* bounded[] = {column[0].data(), column[6].data(), column[7].data(),
                              column[8].data()};
    return surfel_totals(columns(), area.data(), alpha.data(), positive, bounded);
  }
};

void expect_true_bounds(const Surfels& s) {
  const ClusterBounds b = cluster_bounds(s.columns());
  float radius = 0;
  float deviation = 0;
  float cosine = 1;
  for (std::size_t i = 0; i < s.count; ++i) {
    radius = std::max(radius, (s.position(i) - b.center).norm());
    deviation = std::max(deviation, s.deviation(i));
    cosine = std::min(cosine, b.cone_axis.dot(s.normal(i)));
  }
  EXPECT_GE(b.radius, radius);
  EXPECT_NEAR(b.radius, radius, 1e-5F * radius);
  EXPECT_EQ(b.max_deviation, deviation);
  ASSERT_GT(b.cone_cosine, 0);
  EXPECT_LE(b.cone_cosine, cosine);
  EXPECT_NEAR(b.cone_cosine, cosine, 3e-6F);
  EXPECT_NEAR(b.cone_axis.norm(), 1, 1e-6F);
}

void expect_true_totals(const Surfels& s) {
  const SurfelTotals t = s.totals();
  Vec3f min = Vec3f::Constant(kInfinity);
  Vec3f max = -min;
  Vec3f reach_min = min;
  Vec3f reach_max = max;
  double deviations = 0;
  for (std::size_t i = 0; i < s.count; ++i) {
    const Vec3f reach = Vec3f::Constant(s.column[6][i]);
    min = min.cwiseMin(s.position(i));
    max = max.cwiseMax(s.position(i));
    reach_min = reach_min.cwiseMin(s.position(i) - reach);
    reach_max = reach_max.cwiseMax(s.position(i) + reach);
    deviations += s.deviation(i);
  }
  EXPECT_EQ(t.min, min);
  EXPECT_EQ(t.max, max);
  EXPECT_EQ(t.reach_min, reach_min);
  EXPECT_EQ(t.reach_max, reach_max);
  EXPECT_NEAR(t.deviations, deviations, 1e-9);
  EXPECT_TRUE(t.usable);
  EXPECT_FALSE(t.transparent);
}

TEST(SurfelTotals, AddUpToThoseOfAll) {
  SurfelTotals parts[2];
  parts[0].min = parts[0].reach_min = Vec3f(0, -1, 2);
  parts[0].max = parts[0].reach_max = Vec3f(1, 1, 3);
  parts[0].deviations = 1.5;
  parts[1].min = parts[1].reach_min = Vec3f(-2, 0, 2);
  parts[1].max = parts[1].reach_max = Vec3f(0, 5, 2.5F);
  parts[1].deviations = 2;
  const SurfelTotals sound = added_up(parts);
  EXPECT_EQ(sound.min, Vec3f(-2, -1, 2));
  EXPECT_EQ(sound.reach_max, Vec3f(1, 5, 3));
  EXPECT_EQ(sound.deviations, 3.5);
  EXPECT_TRUE(sound.usable);
  EXPECT_FALSE(sound.transparent);
  parts[0].usable = false;
  parts[1].transparent = true;
  EXPECT_FALSE(added_up(parts).usable);
  EXPECT_TRUE(added_up(parts).transparent);
  EXPECT_EQ(added_up({}).min, Vec3f::Constant(kInfinity));
}

/// Takes back what the test asked for, however it ends.
struct TargetsForTest {
  explicit TargetsForTest(std::int64_t targets) { hwy::SetSupportedTargetsForTest(targets); }
  ~TargetsForTest() { hwy::SetSupportedTargetsForTest(0); }
};

/// Every instruction set, every number of values past the last whole vector.
TEST(ClusterBounds, AreThoseOfEverySurfel) {
  for (const std::int64_t target : {HWY_STATIC_TARGET, HWY_AVX2, HWY_AVX3}) {
    if ((hwy::SupportedTargets() & HWY_TARGETS & target) == 0) continue;
    const TargetsForTest chosen(target);
    for (const std::size_t count : {1, 2, 3, 4, 5, 7, 8, 9, 15, 16, 17, 31, 33, 100, 255, 256}) {
      SCOPED_TRACE(testing::Message() << hwy::TargetName(target) << ", " << count << " surfels");
      const Surfels surfels(count);
      expect_true_bounds(surfels);
      expect_true_totals(surfels);
    }
  }
}

TEST(ClusterBounds, RoundAlikeForEveryInstructionSet) {
  const Surfels surfels(256);
  const ClusterBounds here = cluster_bounds(surfels.columns());
  for (const std::int64_t target : {HWY_STATIC_TARGET, HWY_AVX2}) {
    if ((hwy::SupportedTargets() & HWY_TARGETS & target) == 0) continue;
    const TargetsForTest chosen(target);
    const ClusterBounds there = cluster_bounds(surfels.columns());
    EXPECT_EQ(here.center, there.center);
    EXPECT_EQ(here.radius, there.radius);
    EXPECT_EQ(here.cone_axis, there.cone_axis);
    EXPECT_EQ(here.cone_cosine, there.cone_cosine);
  }
}

TEST(ClusterBounds, HaveNoConeWhereANormalIsUnknownOrOpposite) {
  for (const float scale : {0.0F, -1.0F}) {
    Surfels surfels(100);
    for (int axis = 0; axis < 3; ++axis) surfels.column[3 + axis][77] *= scale;
    EXPECT_EQ(cluster_bounds(surfels.columns()).cone_cosine, -1) << scale;
  }
}

TEST(ClusterBounds, LeaveOutPositionsThatAreNan) {
  Surfels surfels(50);
  surfels.column[1][13] = kNan;
  const ClusterBounds bounds = cluster_bounds(surfels.columns());
  EXPECT_TRUE(bounds.center.allFinite());
  EXPECT_GT(bounds.radius, 0);
  EXPECT_TRUE(surfels.totals().min.allFinite());
}

TEST(SurfelTotals, FindTheOneValueThatCannotBeUsed) {
  for (const std::size_t at : {0, 15, 16, 36}) {
    for (const float value : {kNan, kInfinity, -kInfinity, 2 * kMostMagnitude, -2e18F}) {
      for (const std::size_t column : {0, 6, 7, 8}) {
        Surfels surfels(37);
        surfels.column[column][at] = value;
        EXPECT_FALSE(surfels.totals().usable) << column << " " << at << " " << value;
      }
    }
    for (const float value : {0.0F, -1.0F}) {
      Surfels surfels(37);
      surfels.column[6][at] = value;
      EXPECT_FALSE(surfels.totals().usable) << at << " " << value;
      surfels = Surfels(37);
      surfels.column[8][at] = value;
      EXPECT_TRUE(surfels.totals().usable) << at << " " << value;
    }
    Surfels surfels(37);
    for (const float factor : {0.5F, 1.0F, 2.0F, kInfinity, kNan}) {
      surfels.area[at] = factor * most_area(surfels.column[6][at], surfels.column[7][at]);
      EXPECT_EQ(surfels.totals().usable, factor <= 1) << at << " " << factor;
    }
    surfels.area[at] = 1;
    surfels.alpha[at] = 0.99F;
    EXPECT_TRUE(surfels.totals().transparent) << at;
  }
}

}  // namespace
}  // namespace surfel
