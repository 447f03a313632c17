#include <numeric>

#include <gtest/gtest.h>
#include <surfel/io/gaussian_io.h>
#include <surfel/measure/gaussian_statistics.h>

#include "support/test_data.h"

namespace surfel::test {
namespace {

/// A grid of 10 x 10 x 10 discs, one unit apart.
GaussianCloud grid() {
  GaussianCloud cloud;
  cloud.origin = Vec3d(1000, 0, 0);
  for (int i = 0; i < 1000; ++i) {
    cloud.position.emplace_back(static_cast<float>(i % 10), static_cast<float>(i / 10 % 10),
                                static_cast<float>(i / 100));
    cloud.scale.emplace_back(0.5F, 0.0F, 0.25F);
    cloud.rotation.push_back({1, 0, 0, 0});
    cloud.amplitude.push_back(0.55F);
    cloud.harmonics.insert(cloud.harmonics.end(), {0, 0, 0});
  }
  return cloud;
}

std::size_t total(const Histogram& histogram) {
  EXPECT_EQ(histogram.edges.size(), histogram.counts.size() + 1);
  return std::accumulate(histogram.counts.begin(), histogram.counts.end(), std::size_t{0});
}

TEST(GaussianStatistics, MeasuresShapesAndOpacities) {
  const GaussianStatistics s = gaussian_statistics(grid());
  EXPECT_EQ(s.count, 1000U);
  EXPECT_EQ(s.bounds.min, Vec3d(1000, 0, 0));
  EXPECT_EQ(s.bounds.max, Vec3d(1009, 9, 9));
  EXPECT_FLOAT_EQ(static_cast<float>(s.amplitude.median), 0.55F);
  EXPECT_EQ(s.scale.max, 0.5);
  EXPECT_EQ(s.elongation->median, 2);
  EXPECT_EQ(s.flatness->max, 0);
  EXPECT_EQ(s.amplitudes.counts[5], 1000U);
  EXPECT_EQ(total(s.amplitudes), 1000U);
  ASSERT_EQ(s.scales.counts.size(), 1U);
  EXPECT_NEAR(s.scales.edges[0], 0.1, 1e-12);
  EXPECT_NEAR(s.scales.edges[1], 1, 1e-12);
  EXPECT_EQ(s.invisible + s.isolated + s.veils, 0U);
}

TEST(GaussianStatistics, SmallPicturesNeedFewer) {
  // 100 groups of 20, each much smaller than the pixels of small pictures.
  GaussianCloud cloud;
  for (int i = 0; i < 2000; ++i) {
    const int group = i / 20;
    cloud.position.emplace_back(static_cast<float>(group % 10) + 1e-4F * static_cast<float>(i % 20),
                                static_cast<float>(group / 10), 0.5F);
    cloud.scale.emplace_back(0.001F, 0.001F, 0.001F);
    cloud.rotation.push_back({1, 0, 0, 0});
    cloud.amplitude.push_back(i % 20 == 0 ? 0.001F : 0.5F);
    cloud.harmonics.insert(cloud.harmonics.end(), {0, 0, 0});
  }
  const GaussianStatistics s = gaussian_statistics(cloud);
  EXPECT_EQ(s.needs[0].rows, 128);
  EXPECT_EQ(s.needs[3].rows, 1024);
  EXPECT_GE(s.needs[0].gaussians, 100U);
  EXPECT_LE(s.needs[0].gaussians, 110U);  // Few groups lie in two cubes.
  EXPECT_LE(s.needs[3].gaussians, 200U);
  EXPECT_EQ(s.invisible, 100U);
}

TEST(GaussianStatistics, RemainsOfTrainingAreCounted) {
  GaussianCloud cloud = grid();
  cloud.position[3] = Vec3f(100, 0, 0);   // Alone.
  cloud.position[4] = Vec3f(-100, 0, 0);  // Alone, but it reaches the others.
  cloud.scale[4] = Vec3f(50, 50, 50);
  cloud.scale[5] = Vec3f(11, 11, 0.001F);  // A veil.
  cloud.amplitude[5] = 0.05F;
  cloud.amplitude[6] = 0.003F;
  cloud.amplitude[7] = 1;
  const GaussianStatistics s = gaussian_statistics(cloud);
  EXPECT_EQ(s.isolated, 1U);
  EXPECT_EQ(s.veils, 1U);
  EXPECT_EQ(s.invisible, 1U);
  EXPECT_EQ(s.amplitudes.counts.front(), 2U);
  EXPECT_EQ(s.amplitudes.counts.back(), 1U);
  EXPECT_EQ(total(s.scales), 1000U);
}

TEST(GaussianStatistics, PointsAndDensitiesAreMeasuredToo) {
  GaussianCloud cloud = grid();
  cloud.rule = AmplitudeRule::kDensity;
  for (Vec3f& scale : cloud.scale) scale.setZero();
  cloud.amplitude[0] = 200;
  const GaussianStatistics s = gaussian_statistics(cloud);
  EXPECT_FALSE(s.elongation || s.flatness);
  EXPECT_EQ(total(s.scales), 1000U);
  EXPECT_EQ(s.amplitudes.edges.back(), 200);
  EXPECT_EQ(s.invisible, 0U);
}

TEST(GaussianStatistics, RealFile) {
  SURFEL_REQUIRE_TEST_DATA();
  const GaussianStatistics s =
      gaussian_statistics(read_gaussians(data_folder() / "surfels/table.splat"));
  EXPECT_EQ(total(s.amplitudes), 72637U);
  EXPECT_EQ(total(s.scales), 72637U);
  EXPECT_LT(s.isolated, 726U);
}

}  // namespace
}  // namespace surfel::test
