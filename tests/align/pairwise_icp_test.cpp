#include <cmath>

#include <gtest/gtest.h>
#include <surfel/align/pairwise_icp.h>
#include <surfel/base/random.h>

namespace surfel {
namespace {

/// Points of a bumpy sheet, and their normals.
Scan sheet(double size, std::uint64_t seed) {
  Scan scan;
  for (std::uint64_t i = 0; i < 1500; ++i) {
    const double x = random_uniform(seed, i, 0);
    const double y = random_uniform(seed, i, 1);
    const double z = 0.1 * std::sin(9 * x) + 0.1 * std::cos(8 * y);
    const double along_x = 0.9 * std::cos(9 * x);
    const double along_y = -0.8 * std::sin(8 * y);
    scan.position.push_back((size * Vec3d(x, y, z)).cast<float>());
    scan.normal.push_back(Vec3d(-along_x, -along_y, 1).normalized().cast<float>());
  }
  return scan;
}

RigidPose pose_at_size(double size) {
  IcpTarget target;
  add_to_target(sheet(size, 1), {}, 1500, target);
  RigidPose start;
  start.translation = size * Vec3d(0.01, -0.015, 0.02);
  return icp_pose(sheet(size, 2), start, target, 0.1 * size, 1500);
}

TEST(PairwiseIcp, EndsAfterTheSameStepsAtEveryScale) {
  const RigidPose one = pose_at_size(1);
  EXPECT_LT(one.translation.z(), 0.002);
  for (const int exponent : {-40, 50}) {
    const double size = std::ldexp(1.0, exponent);
    const RigidPose scaled = pose_at_size(size);
    EXPECT_EQ(scaled.rotation.coeffs(), one.rotation.coeffs()) << exponent;
    EXPECT_EQ(Vec3d(scaled.translation / size), one.translation) << exponent;
  }
}

}  // namespace
}  // namespace surfel
