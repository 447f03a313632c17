#include <cmath>
#include <numbers>

#include <gtest/gtest.h>
#include <surfel/base/color.h>
#include <surfel/scene/gaussians_of_surfels.h>

#include "support/gaussian_shape.h"
#include "support/message_of.h"

namespace surfel::test {
namespace {

/// A grid of surfels in the plane z = 0, spacing 1, whose kernels' sum is `overlap` in the mean.
SurfelCloud plane(int side, double overlap) {
  SurfelCloud cloud;
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      cloud.position.emplace_back(static_cast<float>(x), static_cast<float>(y), 0.0F);
      cloud.normal.emplace_back(0.0F, 0.0F, 1.0F);
      cloud.variance.push_back(static_cast<float>(overlap / (2 * std::numbers::pi)));
      cloud.color.emplace_back(0.2F, 0.5F, 1.0F);
    }
  }
  return cloud;
}

TEST(OpacityFor, InvertsTheDilogarithm) {
  // Li2(1/2) = pi^2 / 12 - ln(2)^2 / 2.
  const double half =
      std::numbers::pi * std::numbers::pi / 12 - std::numbers::ln2 * std::numbers::ln2 / 2;
  for (const double overlap : {1.0, 3.0, 10.0}) {
    EXPECT_NEAR(opacity_for(overlap, 1 - std::exp(-overlap * half)), 0.5, 1e-9);
    // A faint surface: Li2(x) is about x.
    EXPECT_NEAR(opacity_for(overlap, 1e-6), 1e-6 / overlap, 1e-11);
    EXPECT_NEAR(opacity_for(overlap, 0), 0, 1e-11);
  }
  EXPECT_EQ(opacity_for(0.1, 0.99), 0.99);
  EXPECT_LT(opacity_for(6, 0.99), opacity_for(3, 0.99));
}

TEST(GaussiansOfSurfels, TogetherTheyHideWhatLiesBehind) {
  for (const double overlap : {3.0, 6.0}) {
    const int side = 21;
    const GaussianCloud out =
        gaussians_of_surfels(plane(side, overlap), "plane", {.overlap = overlap});
    double mean_log = 0;
    double most = 0;
    constexpr int kSteps = 16;
    for (int k = 0; k < kSteps * kSteps; ++k) {
      const double x = side / 2 + (k % kSteps + 0.5) / kSteps;
      const double y = side / 2 + (k / kSteps + 0.5) / kSteps;
      double passes = 1;
      for (std::size_t i = 0; i < out.size(); ++i) {
        const double dx = x - out.position[i][0];
        const double dy = y - out.position[i][1];
        const double variance = static_cast<double>(out.scale[i][0]) * out.scale[i][0];
        passes *= 1 - out.amplitude[i] * std::exp(-(dx * dx + dy * dy) / (2 * variance));
      }
      mean_log += std::log(passes) / (kSteps * kSteps);
      most = std::max(most, passes);
    }
    EXPECT_NEAR(mean_log, std::log(0.01), 0.02);
    EXPECT_LT(most, 0.05);
  }
}

TEST(GaussiansOfSurfels, ShapesAreTheSurfels) {
  SurfelCloud cloud = plane(2, 3);
  cloud.variance.clear();
  for (std::size_t i = 0; i < 4; ++i) {
    const auto x = static_cast<float>(i);
    const Vec3f n = Vec3f(std::sin(x), std::cos(x), 0.3F * x - 0.5F).normalized();
    cloud.normal[i] = i == 2 ? Vec3f(0, 0, -1) : n;
    const Vec3f t = cloud.normal[i].unitOrthogonal();
    cloud.tangent.push_back((t + 0.5F * cloud.normal[i].cross(t)).normalized());
    cloud.variance_u.push_back(4);
    cloud.variance_v.push_back(0.25F);
  }
  const GaussianCloud flat = gaussians_of_surfels(cloud, "cloud", {.thickness = 0});
  const GaussianCloud thick = gaussians_of_surfels(cloud, "cloud", {.thickness = 0.1});
  for (std::size_t i = 0; i < 4; ++i) {
    const Vec3d n = cloud.normal[i].cast<double>();
    const Vec3d t = cloud.tangent[i].cast<double>();
    const Vec3d b = n.cross(t);
    const Eigen::Matrix3d expected = 4 * t * t.transpose() + 0.25 * b * b.transpose();
    EXPECT_LT((covariance(flat, i) - expected).norm(), 1e-5);
    EXPECT_EQ(flat.scale[i][2], 0);
    EXPECT_LT((covariance(thick, i) - expected - 0.0025 * n * n.transpose()).norm(), 1e-5);
  }
}

TEST(GaussiansOfSurfels, ColorsAreAsDisplaysTakeThem) {
  const GaussianCloud out = gaussians_of_surfels(plane(2, 3), "plane");
  for (std::size_t k = 0; k < 3; ++k) {
    const float linear = plane(1, 3).color[0][static_cast<Eigen::Index>(k)];
    EXPECT_NEAR(0.5 + GaussianCloud::kHarmonic0 * out.harmonics[k], linear_to_srgb(linear), 1e-6);
  }
  SurfelCloud none = plane(1, 3);
  none.color.clear();
  EXPECT_NEAR(0.5 + GaussianCloud::kHarmonic0 * gaussians_of_surfels(none, "plane").harmonics[0],
              linear_to_srgb(SurfelCloud::colorless()[0]), 1e-6);
}

TEST(GaussiansOfSurfels, TransparentSurfelsStaySo) {
  SurfelCloud cloud = plane(2, 3);
  cloud.alpha = {1, 0.5F, 0, 2};
  const GaussianCloud out = gaussians_of_surfels(cloud, "plane");
  EXPECT_FLOAT_EQ(out.amplitude[0], static_cast<float>(opacity_for(3, 0.99)));
  EXPECT_FLOAT_EQ(out.amplitude[1], static_cast<float>(opacity_for(3, 0.495)));
  EXPECT_NEAR(out.amplitude[2], 0, 1e-9);
  EXPECT_EQ(out.amplitude[3], out.amplitude[0]);
}

TEST(GaussiansOfSurfels, WhatHasNoShapeIsLeftOutOrASphere) {
  SurfelCloud cloud = plane(3, 3);
  cloud.position[0][0] = NAN;
  cloud.variance[1] = 0;
  cloud.normal[2] = Vec3f(0, 0, 0);
  cloud.clip1.assign(cloud.size(), Vec3f(0, 0, 0));
  cloud.clip1_distance.assign(cloud.size(), 0);
  cloud.clip1[3] = cloud.clip1[4] = Vec3f(1, 0, 0);
  cloud.clip1_distance[3] = 0.1F;
  cloud.clip1_distance[4] = -0.1F;
  GaussiansOfSurfelsReport report;
  const GaussianCloud out = gaussians_of_surfels(cloud, "plane", {}, &report);
  EXPECT_EQ(out.size(), 6U);
  EXPECT_EQ(report.left_out.position, 1U);
  EXPECT_EQ(report.left_out.variance, 1U);
  EXPECT_EQ(report.mirrored, 1U);
  EXPECT_EQ(report.clipped, 1U);
  EXPECT_EQ(out.scale[0][2], out.scale[0][0]);
  EXPECT_LT(out.scale[1][2], out.scale[1][0]);
}

TEST(GaussiansOfSurfels, WhatIsWrongIsNamed) {
  SurfelCloud cloud = plane(2, 3);
  EXPECT_NE(message_of([&] { gaussians_of_surfels(cloud, "a", {.overlap = 0}); }).find("overlap"),
            std::string::npos);
  EXPECT_NE(message_of([&] { gaussians_of_surfels(cloud, "a", {.thickness = 2}); }).find("thick"),
            std::string::npos);
  for (float& variance : cloud.variance) variance = -1;
  EXPECT_NE(message_of([&] { gaussians_of_surfels(cloud, "a"); }).find("a: has no surfel"),
            std::string::npos);
  cloud.variance.clear();
  EXPECT_NE(message_of([&] { gaussians_of_surfels(cloud, "a"); }).find("a: has no variances"),
            std::string::npos);
}

}  // namespace
}  // namespace surfel::test
