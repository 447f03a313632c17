#include <cmath>
#include <limits>
#include <numbers>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/measure/cloud_statistics.h>

namespace surfel {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr double kPi = std::numbers::pi;

/// Square grid of spacing h in the plane z = height.
SurfelCloud grid(int side, float h, float variance, float height = 0, float up = 1) {
  SurfelCloud cloud;
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      cloud.position.emplace_back(h * static_cast<float>(x), h * static_cast<float>(y), height);
    }
  }
  cloud.normal.assign(cloud.size(), Vec3f(0, 0, up));
  cloud.variance.assign(cloud.size(), variance);
  return cloud;
}

void append(SurfelCloud& to, const SurfelCloud& from) {
  to.position.insert(to.position.end(), from.position.begin(), from.position.end());
  to.normal.insert(to.normal.end(), from.normal.begin(), from.normal.end());
  to.variance.insert(to.variance.end(), from.variance.begin(), from.variance.end());
}

Coverage coverage_of(const SurfelCloud& cloud, double cutoff = 1) {
  const CloudStatistics s = cloud_statistics(cloud, {.cutoff = cutoff});
  EXPECT_TRUE(s.coverage);
  return s.coverage.value_or(Coverage{});
}

TEST(CloudStatisticsOptions, DefaultsAreValidAndBadValuesRefused) {
  EXPECT_TRUE(CloudStatisticsOptions{}.problems().empty());
  for (const double cutoff : {0.0, -1.0, std::nan(""), std::numeric_limits<double>::infinity()}) {
    const CloudStatisticsOptions bad{.cutoff = cutoff};
    EXPECT_EQ(bad.problems().size(), 1U) << cutoff;
    EXPECT_THROW(cloud_statistics(grid(3, 1, 1), bad), Error);
  }
  EXPECT_EQ(CloudStatisticsOptions{.samples = 0}.problems().size(), 1U);
}

TEST(CloudStatistics, SpacingOfAGridIsItsPitch) {
  for (const float h : {1e-6F, 1.0F, 1e6F}) {
    const CloudStatistics s = cloud_statistics(grid(40, h, h * h));
    ASSERT_TRUE(s.spacing);
    EXPECT_NEAR(s.spacing->min, h, 1e-4 * h);
    EXPECT_NEAR(s.spacing->mean, h, 1e-4 * h);
    EXPECT_NEAR(s.spacing->max, h, 1e-4 * h);
    EXPECT_EQ(s.coincident_share, 0);
  }
}

TEST(CloudStatistics, NeighborsOfAGridAreCounted) {
  // Four are as far away as a square's side, four more as its diagonal.
  for (const auto& [reach, inside] :
       {std::pair{0.9F, 0U}, {1.2F, 4U}, {1.6F, 8U}, {2.3F, 20U}, {9.0F, 24U}}) {
    const CloudStatistics s = cloud_statistics(grid(40, 1, reach * reach / 2));
    ASSERT_TRUE(s.neighbors);
    EXPECT_EQ(s.neighbors->samples(), 1600U);
    EXPECT_GT(s.neighbors->surfels[inside], 1200U) << reach;
  }
  EXPECT_EQ(cloud_statistics(grid(40, 1, 1), {.samples = 100}).neighbors->samples(), 100U);
  SurfelCloud bare = grid(10, 1, 1);
  bare.variance.clear();
  EXPECT_FALSE(cloud_statistics(bare).neighbors);
}

TEST(CloudStatistics, CellsOfAGridAreItsSquares) {
  const CloudStatistics s = cloud_statistics(grid(40, 0.5F, 0.25F));
  ASSERT_TRUE(s.coverage);
  EXPECT_NEAR(s.coverage->cell_area_mean, 0.25, 1e-6);
  EXPECT_GT(s.coverage->cells, 36U * 36U - 1);  // All but the border.
  EXPECT_LT(s.coverage->cells, 40U * 40U);
}

TEST(CloudStatistics, DiscsThatReachTheCellsCornersLeaveNoHole) {
  // sqrt(2 c variance) on either side of h / sqrt(2).
  EXPECT_EQ(coverage_of(grid(30, 1, 0.2501F)).hole_share, 0);
  EXPECT_GT(coverage_of(grid(30, 1, 0.24F)).hole_share, 0);
  EXPECT_EQ(coverage_of(grid(30, 1, 0.0626F), 4).hole_share, 0);
}

TEST(CloudStatistics, HolesBetweenSmallDiscsAreTheAreaThatTheyLeave) {
  for (const double radius : {0.1, 0.3, 0.5}) {
    const auto variance = static_cast<float>(radius * radius / 2);
    EXPECT_NEAR(coverage_of(grid(60, 1, variance)).hole_share, 1 - kPi * radius * radius, 0.006)
        << radius;
  }
}

TEST(CloudStatistics, OverlapIsTheDiscsAreaOverTheCells) {
  for (const double cutoff : {0.5, 1.0, 2.0}) {
    EXPECT_NEAR(coverage_of(grid(60, 1, 1), cutoff).overlap, 2 * kPi * cutoff, 0.06 * cutoff * kPi);
  }
}

TEST(CloudStatistics, AnisotropicDiscsCoverEllipses) {
  SurfelCloud cloud = grid(60, 1, 0);
  cloud.variance.clear();
  cloud.tangent.assign(cloud.size(), Vec3f(0, 1, 0));
  cloud.variance_u.assign(cloud.size(), 2.0F);
  cloud.variance_v.assign(cloud.size(), 0.125F);
  const Coverage c = coverage_of(cloud);
  EXPECT_NEAR(c.overlap, 2 * kPi * std::sqrt(2 * 0.125), 0.05);
  EXPECT_NEAR(cloud_statistics(cloud).radius->median, 2, 1e-6);
  // Radius 0.5 across: neighbouring columns touch, and the long axis closes every column.
  EXPECT_LT(c.hole_share, 0.02);
  cloud.tangent.assign(cloud.size(), Vec3f(1, 0, 0));
  EXPECT_LT(coverage_of(cloud).hole_share, 0.02);
  cloud.variance_v.assign(cloud.size(), 0.02F);  // Stripes of width 0.4 along x.
  EXPECT_NEAR(coverage_of(cloud).hole_share, 0.6, 0.03);
}

TEST(CloudStatistics, ASecondSheetDoesNotCoverTheFirst) {
  // Opposite sheets close together: each has its own holes.
  const double radius = 0.4;
  const auto variance = static_cast<float>(radius * radius / 2);
  SurfelCloud sheets = grid(40, 1, variance);
  append(sheets, grid(40, 1, 2, 0.05F, -1));
  const double expected = (1 - kPi * radius * radius) / 2;
  EXPECT_NEAR(coverage_of(sheets).hole_share, expected, 0.01);
}

TEST(CloudStatistics, CountsFlaws) {
  SurfelCloud cloud = grid(20, 1, 1);
  cloud.position[3].x() = kNan;
  cloud.position[4].y() = std::numeric_limits<float>::infinity();
  cloud.normal[5] = Vec3f::Zero();
  cloud.normal[6] = Vec3f(0, 0, 2);
  cloud.normal[7].z() = kNan;
  cloud.variance[8] = -1;
  cloud.variance[9] = kNan;
  cloud.color.assign(cloud.size(), Vec3f::Zero());
  cloud.color[9].x() = kNan;
  cloud.color[10].x() = kNan;
  cloud.uv.assign(cloud.size(), Vec2f::Zero());
  const CloudStatistics s = cloud_statistics(cloud);
  EXPECT_EQ(s.count, 400U);
  EXPECT_EQ(s.nonfinite_positions, 2U);
  EXPECT_EQ(s.zero_normals, 1U);
  EXPECT_EQ(s.non_unit_normals, 1U);
  EXPECT_EQ(s.nonfinite_normals, 1U);
  EXPECT_EQ(s.negative_variances, 1U);
  EXPECT_EQ(s.nonfinite_values, 2U);
  EXPECT_EQ(s.bounds.max, Vec3d(19, 19, 0));
  ASSERT_TRUE(s.coverage);
  EXPECT_TRUE(std::isfinite(s.coverage->overlap));
}

TEST(CloudStatistics, TakesCloudsWithLittleInThem) {
  EXPECT_FALSE(cloud_statistics({}).spacing);
  EXPECT_TRUE(cloud_statistics({}).bounds.empty());
  const CloudStatistics one = cloud_statistics(grid(1, 1, 1));
  EXPECT_FALSE(one.spacing);
  EXPECT_FALSE(one.coverage);
  EXPECT_TRUE(one.radius);
  SurfelCloud bare = grid(20, 1, 1);
  bare.normal.clear();
  EXPECT_TRUE(cloud_statistics(bare).spacing);
  EXPECT_FALSE(cloud_statistics(bare).coverage);
  SurfelCloud nowhere = grid(2, 1, 1);
  nowhere.position.assign(4, Vec3f::Constant(kNan));
  EXPECT_FALSE(cloud_statistics(nowhere).spacing);
  EXPECT_EQ(cloud_statistics(nowhere).nonfinite_positions, 4U);
  SurfelCloud same = grid(10, 0, 1);
  EXPECT_EQ(cloud_statistics(same).coincident_share, 1);
  EXPECT_EQ(cloud_statistics(same).spacing->max, 0);
  EXPECT_FALSE(cloud_statistics(same).coverage);
}

TEST(CloudStatistics, IsTheSameForAnyThreadsAndFromFewSamplesAlmost) {
  const SurfelCloud cloud = grid(80, 1, 0.2F);
  const CloudStatisticsOptions few{.samples = 500};
  set_thread_count(1);
  const CloudStatistics alone = cloud_statistics(cloud, few);
  set_thread_count(5);
  const CloudStatistics together = cloud_statistics(cloud, few);
  set_thread_count(0);
  EXPECT_EQ(alone.coverage->overlap, together.coverage->overlap);
  EXPECT_EQ(alone.coverage->hole_share, together.coverage->hole_share);
  EXPECT_EQ(alone.spacing->mean, together.spacing->mean);
  EXPECT_NEAR(alone.coverage->hole_share, coverage_of(cloud).hole_share, 0.02);
}

TEST(Distribution, TellsRanksAndMean) {
  std::vector<double> values;
  for (int i = 100; i >= 0; --i) values.push_back(i);
  const Distribution d = distribution(values);
  EXPECT_EQ(d.min, 0);
  EXPECT_EQ(d.percentile_5, 5);
  EXPECT_EQ(d.median, 50);
  EXPECT_EQ(d.percentile_95, 95);
  EXPECT_EQ(d.max, 100);
  EXPECT_EQ(d.mean, 50);
}

TEST(CloudProperties, NameEveryColumnInItsType) {
  SurfelCloud cloud = grid(2, 1, 1);
  cloud.double_positions = true;
  cloud.color.assign(4, Vec3f::Zero());
  cloud.color_encoding = ColorEncoding::kUint16Srgb;
  cloud.extra.push_back({"time", ScalarType::kInt32, {}});
  std::string all;
  for (const auto& [name, type] : cloud_properties(cloud)) all += name + ":" + type + " ";
  EXPECT_EQ(all,
            "x:double y:double z:double nx:float ny:float nz:float variance:float red:ushort "
            "green:ushort blue:ushort time:int ");
}

TEST(CloudProperties, OfFarAwayCloudsAreFloatWhereFloatIsExact) {
  SurfelCloud cloud = grid(2, 1, 1);
  cloud.origin = Vec3d(4096, 0, 0);
  EXPECT_EQ(cloud_properties(cloud).front().type, "float");
  cloud.origin = Vec3d(1e9 + 0.1, 0, 0);
  EXPECT_EQ(cloud_properties(cloud).front().type, "double");
}

TEST(CloudStatistics, DiscsOverEachOtherAreMeasuredAtFewerPlaces) {
  // 2500 discs, each as large as the whole: of 1024 over a point no more are counted.
  const auto cells = [](float variance) { return coverage_of(grid(50, 1, variance)); };
  const Coverage closed = cells(1);
  const Coverage crowded = cells(1e4F);
  EXPECT_GT(closed.cells, 2000U);
  EXPECT_LT(crowded.cells, closed.cells / 4);
  EXPECT_GT(crowded.cells, 50U);
  EXPECT_NEAR(crowded.overlap, 1024, 1);
}

TEST(CloudStatistics, ALargeDiscDoesNotMakeTheSmallOnesFewerPlaces) {
  SurfelCloud cloud = grid(50, 1, 0.3F);
  const Coverage alike = coverage_of(cloud);
  cloud.variance[1275] = 1e6F;
  cloud.variance[0] = 0;
  const Coverage covered = coverage_of(cloud);
  EXPECT_EQ(covered.cells, alike.cells);
  EXPECT_EQ(covered.hole_share, 0);
  // The large disc lies over all points, instead of one that lay over its share of them.
  EXPECT_NEAR(covered.overlap, alike.overlap + 1, 2e-3);
}

}  // namespace
}  // namespace surfel
