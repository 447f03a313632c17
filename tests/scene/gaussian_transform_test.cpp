#include <gtest/gtest.h>
#include <surfel/scene/gaussian_transform.h>
#include <surfel/scene/harmonic_rotation.h>

#include "support/gaussian_shape.h"

namespace surfel::test {
namespace {

/// Red of a Gaussian seen along a direction.
double red(const GaussianCloud& cloud, std::size_t i, const Vec3d& direction) {
  const auto basis = harmonics_of(direction);
  double sum = 0.5;
  for (std::size_t k = 0; k < cloud.harmonics_stride() / 3; ++k) {
    sum += basis[k] * cloud.harmonics[i * cloud.harmonics_stride() + 3 * k];
  }
  return sum;
}

Vec3d direction_of(int k) {
  return Vec3d(std::sin(k), std::cos(2 * k), std::sin(3 * k + 1)).normalized();
}

GaussianCloud two_gaussians() {
  GaussianCloud cloud;
  cloud.degree = GaussianCloud::kMostDegree;
  cloud.position = {Vec3f(1, 2, 3), Vec3f(-1, 0, 0.5F)};
  cloud.scale = {Vec3f(1, 2, 3), Vec3f(0.5F, 0.1F, 0)};
  cloud.rotation = {{1, 0, 0, 0}, {0.5F, 0.5F, -0.5F, 0.5F}};
  cloud.amplitude = {0.5F, 1};
  for (std::size_t k = 0; k < 2 * cloud.harmonics_stride(); ++k) {
    cloud.harmonics.push_back(static_cast<float>(std::sin(1.7 * static_cast<double>(k))));
  }
  cloud.up = Vec3d(0, -1, 0);
  return cloud;
}

TEST(HarmonicsOf, AreOrthonormal) {
  // The mean over a fine grid of the sphere, by equal areas.
  constexpr int kSteps = 200;
  Eigen::MatrixXd gram = Eigen::MatrixXd::Zero(kMostHarmonics, kMostHarmonics);
  for (int i = 0; i < kSteps; ++i) {
    const double z = -1 + (2 * i + 1.0) / kSteps;
    for (int j = 0; j < kSteps; ++j) {
      const double angle = 2 * M_PI * j / kSteps;
      const double radius = std::sqrt(1 - z * z);
      const auto basis = harmonics_of({radius * std::cos(angle), radius * std::sin(angle), z});
      const Eigen::Map<const Eigen::VectorXd> v(basis.data(), kMostHarmonics);
      gram += v * v.transpose() * (4 * M_PI / (kSteps * kSteps));
    }
  }
  EXPECT_LT(
      (gram - Eigen::MatrixXd::Identity(kMostHarmonics, kMostHarmonics)).cwiseAbs().maxCoeff(),
      1e-3);
}

TEST(TransformGaussians, ShapesAndColorsTurnTogether) {
  const GaussianCloud before = two_gaussians();
  GaussianCloud after = before;
  const Similarity similarity{.scale = 2,
                              .rotation = Quaternion(0.5, 0.1, -0.7, 0.4).normalized(),
                              .translation = Vec3d(10, 20, 30)};
  transform_gaussians(after, similarity);
  const Eigen::Matrix3d turn = similarity.rotation.toRotationMatrix();
  for (std::size_t i = 0; i < before.size(); ++i) {
    const Vec3d world = after.origin + after.position[i].cast<double>();
    EXPECT_LT(
        (world - (2 * turn * before.position[i].cast<double>() + similarity.translation)).norm(),
        1e-5);
    EXPECT_LT((covariance(after, i) - 4 * turn * covariance(before, i) * turn.transpose()).norm(),
              1e-5);
    for (int k = 0; k < 20; ++k) {
      const Vec3d direction = direction_of(k);
      EXPECT_NEAR(red(after, i, turn * direction), red(before, i, direction), 1e-5);
    }
    EXPECT_EQ(after.amplitude[i], before.amplitude[i]);
  }
  EXPECT_LT((*after.up - turn * *before.up).norm(), 1e-12);
}

TEST(TransformGaussians, IdentityChangesNothing) {
  const GaussianCloud before = two_gaussians();
  GaussianCloud after = before;
  transform_gaussians(after, {});
  EXPECT_EQ(after.position, before.position);
  EXPECT_EQ(after.harmonics, before.harmonics);
}

TEST(TransformGaussians, DensitiesFallAsLengthsGrow) {
  GaussianCloud cloud = two_gaussians();
  cloud.rule = AmplitudeRule::kDensity;
  transform_gaussians(cloud, {.scale = 4});
  EXPECT_EQ(cloud.amplitude[1], 0.25F);
}

TEST(TransformGaussians, FarAwayTheyKeepTheirOffsets) {
  GaussianCloud cloud = two_gaussians();
  transform_gaussians(cloud, {.translation = Vec3d(5e6, 5e6, 0)});
  const Vec3d between = (cloud.position[0] - cloud.position[1]).cast<double>();
  EXPECT_LT((between - Vec3d(2, 2, 2.5)).norm(), 1e-5);
  EXPECT_LT((cloud.origin + cloud.position[0].cast<double>() - Vec3d(5e6 + 1, 5e6 + 2, 3)).norm(),
            1e-5);
}

}  // namespace
}  // namespace surfel::test
