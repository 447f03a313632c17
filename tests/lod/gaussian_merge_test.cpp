#include <cmath>
#include <numbers>
#include <numeric>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/lod/gaussian_merge.h>
#include <surfel/lod/gaussian_reduction.h>
#include <surfel/scene/gaussian_mass.h>

#include "gaussian/random_gaussians.h"
#include "support/gaussian_shape.h"

namespace surfel::test {
namespace {

MergeGaussians all_of(const GaussianCloud& cloud) {
  std::vector<std::uint32_t> which(cloud.size());
  std::iota(which.begin(), which.end(), 0U);
  return merge_gaussians(cloud, which);
}

/// Merges all into the first, from the last to the second or the other way.
MergeGaussians merged_all(const GaussianCloud& cloud, bool backwards) {
  MergeGaussians out = all_of(cloud);
  for (std::size_t k = 1; k < out.size(); ++k) out.merge(0, backwards ? out.size() - k : k);
  out.resize(1);
  return out;
}

/// `count` balls at one place.
GaussianCloud balls(std::size_t count, float scale, float amplitude,
                    AmplitudeRule rule = AmplitudeRule::kOpacity) {
  GaussianCloud cloud;
  cloud.rule = rule;
  cloud.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    cloud.position[i] = {1, 2, 3};
    cloud.scale[i].setConstant(scale);
    cloud.rotation[i] = {1, 0, 0, 0};
    cloud.amplitude[i] = amplitude;
    for (std::size_t k = 0; k < 3; ++k) cloud.harmonics[3 * i + k] = 0.1F;
  }
  return cloud;
}

double mass_of(const GaussianCloud& cloud, std::size_t i) {
  return double{cloud.amplitude[i]} * mean_projection(cloud.scale[i].cast<double>());
}

TEST(MergeGaussians, KeepsMassMeanCovarianceAndColours) {
  const GaussianCloud cloud = random_gaussians(40, 7, 2);
  double mass = 0;
  Vec3d mean(0, 0, 0);
  std::vector<double> harmonics(cloud.harmonics_stride(), 0);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const double m = mass_of(cloud, i);
    mass += m;
    mean += m * cloud.position[i].cast<double>();
    for (std::size_t k = 0; k < harmonics.size(); ++k) {
      harmonics[k] += m * cloud.harmonics[i * harmonics.size() + k];
    }
  }
  mean /= mass;
  Eigen::Matrix3d variance = Eigen::Matrix3d::Zero();
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3d apart = cloud.position[i].cast<double>() - mean;
    variance += mass_of(cloud, i) / mass * (covariance(cloud, i) + apart * apart.transpose());
  }
  for (const bool backwards : {false, true}) {
    const MergeGaussians one = merged_all(cloud, backwards);
    EXPECT_NEAR(one.mass[0] / mass, 1, 1e-5);
    EXPECT_LT((one.position[0].cast<double>() - mean).norm(), 1e-5);
    const std::array<float, 6>& c = one.covariance[0];
    Eigen::Matrix3d found;
    found << c[0], c[1], c[2], c[1], c[3], c[4], c[2], c[4], c[5];
    EXPECT_LT((found - variance).norm(), 1e-5 * variance.norm());
    for (std::size_t k = 0; k < harmonics.size(); ++k) {
      EXPECT_NEAR(one.harmonics[k], harmonics[k] / mass, 1e-5);
    }
    // Spread as widely as these, the opacity is far from the cap: the drawn one has the moments.
    const GaussianCloud drawn = drawn_gaussians(one, cloud);
    ASSERT_EQ(drawn.size(), 1U);
    EXPECT_NEAR(mass_of(drawn, 0) / mass, 1, 1e-4);
    EXPECT_LT((covariance(drawn, 0) - variance).norm(), 1e-4 * variance.norm());
    EXPECT_EQ(drawn.origin, cloud.origin);
    EXPECT_EQ(drawn.degree, 2);
  }
}

TEST(MergeGaussians, OnesThatAreNotMergedStayBitForBit) {
  const GaussianCloud cloud = random_gaussians(30, 1);
  const GaussianCloud drawn = drawn_gaussians(all_of(cloud), cloud);
  EXPECT_EQ(drawn.position, cloud.position);
  EXPECT_EQ(drawn.scale, cloud.scale);
  EXPECT_EQ(drawn.rotation, cloud.rotation);
  EXPECT_EQ(drawn.amplitude, cloud.amplitude);
  EXPECT_EQ(drawn.harmonics, cloud.harmonics);
}

TEST(MergeGaussians, HazeStaysHaze) {
  // Fifty layers of opacity 0.02 let 0.98^50 = 0.364 through.
  const GaussianCloud cloud = balls(50, 1, 0.02F);
  const GaussianCloud drawn = drawn_gaussians(merged_all(cloud, false), cloud);
  EXPECT_NEAR(drawn.amplitude[0], 1 - std::pow(0.98, 50), 0.13);
  EXPECT_LT(drawn.amplitude[0], 0.8);
  EXPECT_NEAR(mass_of(drawn, 0), 50 * mass_of(cloud, 0), 1e-3 * mass_of(drawn, 0));
  // Two thin layers add up.
  const GaussianCloud two = balls(2, 1, 0.01F);
  EXPECT_NEAR(drawn_gaussians(merged_all(two, false), two).amplitude[0], 0.02, 1e-4);
}

TEST(MergeGaussians, OpacitiesStayBelowOneAndSizesBounded) {
  const GaussianCloud cloud = balls(500, 1, 0.99F);
  const GaussianCloud drawn = drawn_gaussians(merged_all(cloud, false), cloud);
  EXPECT_LE(drawn.amplitude[0], 0.99F);
  EXPECT_GT(drawn.amplitude[0], 0.98F);
  EXPECT_LE(drawn.scale[0].maxCoeff(), 2.001F);
}

TEST(MergeGaussians, DensitiesKeepTheirIntegral) {
  GaussianCloud cloud = balls(2, 0.5F, 3, AmplitudeRule::kDensity);
  cloud.position[1].x() += 1;
  const GaussianCloud drawn = drawn_gaussians(merged_all(cloud, false), cloud);
  EXPECT_EQ(drawn.rule, AmplitudeRule::kDensity);
  EXPECT_NEAR(drawn.amplitude[0] * drawn.scale[0].prod(), 2 * 3 * 0.125, 1e-5);
  EXPECT_NEAR(drawn.scale[0].maxCoeff(), std::sqrt(0.5), 1e-6);
}

TEST(MergeGaussians, TellsWhatNobodyCanSee) {
  GaussianCloud cloud = balls(5, 1, 0.5F);
  cloud.amplitude[1] = 0.0039F;
  cloud.amplitude[2] = 0.004F;
  cloud.scale[3] = {1, 0, 0};
  cloud.scale[4] = {1, 1, 0};
  EXPECT_TRUE(has_mass(cloud, 0));
  EXPECT_FALSE(has_mass(cloud, 1));
  EXPECT_TRUE(has_mass(cloud, 2));
  EXPECT_FALSE(has_mass(cloud, 3));
  EXPECT_TRUE(has_mass(cloud, 4));
  cloud.position[0].x() = 1e30F;
  EXPECT_FALSE(has_mass(cloud, 0));
  cloud.rule = AmplitudeRule::kDensity;
  EXPECT_TRUE(has_mass(cloud, 1));
  EXPECT_FALSE(has_mass(cloud, 4));  // A sheet has no volume.
}

TEST(GaussianReduction, MergesTheNearestAlikeFirst) {
  // Two pairs of red balls, one of which is closer, and a blue ball within the other.
  GaussianCloud cloud = balls(5, 0.1F, 0.5F);
  const float x[] = {0, 0.05F, 3, 3.2F, 3.1F};
  for (std::size_t i = 0; i < 5; ++i) cloud.position[i] = {x[i], 0, 0};
  cloud.harmonics[3 * 4 + 2] = 3;
  MergeGaussians gaussians = all_of(cloud);
  GaussianReduction reduction;
  reduction.run(gaussians, 4, 0);
  ASSERT_EQ(gaussians.size(), 4U);
  EXPECT_EQ(gaussians.source[0], MergeGaussians::kMerged);
  EXPECT_NEAR(gaussians.position[0].x(), 0.025, 1e-6);
  reduction.run(gaussians, 3, 0);
  ASSERT_EQ(gaussians.size(), 3U);
  std::size_t blue = 0;
  for (std::size_t i = 0; i < 3; ++i) blue += gaussians.source[i] == 4 ? 1U : 0U;
  EXPECT_EQ(blue, 1U);
}

TEST(GaussianReduction, DoesNotMixTheSidesOfASheet) {
  // Flat Gaussians of two parallel sheets, as far apart as neighbours of one sheet are.
  GaussianCloud cloud = balls(2 * 20 * 20, 0.5F, 0.9F);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    cloud.position[i] = {static_cast<float>(i % 20), static_cast<float>(i / 20 % 20),
                         i < 400 ? 0.0F : 1.0F};
    cloud.scale[i].z() = 0.01F;
  }
  MergeGaussians gaussians = all_of(cloud);
  GaussianReduction().run(gaussians, 80, group_blur(gaussians, 10) / 4);
  ASSERT_EQ(gaussians.size(), 80U);
  for (std::size_t i = 0; i < 80; ++i) {
    EXPECT_NEAR(std::abs(gaussians.position[i].z() - 0.5F), 0.5, 1e-5) << i;
  }
}

TEST(GaussianReduction, EndsWhateverTheGaussiansAre) {
  const auto left = [](GaussianCloud cloud, std::size_t count) {
    MergeGaussians gaussians = all_of(cloud);
    GaussianReduction().run(gaussians, count, group_blur(gaussians, 10));
    const GaussianCloud out = drawn_gaussians(gaussians, cloud);
    for (std::size_t i = 0; i < out.size(); ++i) {
      EXPECT_TRUE(out.position[i].allFinite() && out.scale[i].allFinite());
      EXPECT_TRUE(std::isfinite(out.amplitude[i]));
    }
    return out.size();
  };
  EXPECT_EQ(left(balls(1000, 1, 0.5F), 1), 1U);  // All at one place.
  GaussianCloud line = balls(1000, 1, 0.5F);
  for (std::size_t i = 0; i < line.size(); ++i) line.position[i].x() = static_cast<float>(i) * 1e3F;
  for (Vec3f& s : line.scale) s = {1, 1, 0};
  EXPECT_EQ(left(line, 7), 7U);
  for (Vec3f& s : line.scale) s = {1e15F, 1e15F, 1e15F};
  EXPECT_EQ(left(line, 7), 7U);
  for (Vec3f& s : line.scale) s = {1e-15F, 1e-15F, 1e-15F};
  EXPECT_EQ(left(line, 7), 7U);
}

}  // namespace
}  // namespace surfel::test
