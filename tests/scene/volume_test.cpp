#include <string>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/scene/transfer_function.h>
#include <surfel/scene/volume.h>

namespace surfel {
namespace {

/// Linear in world coordinates, on a grid of 4 x 3 x 5 voxels.
Volume linear_volume() {
  Volume volume;
  volume.size = {4, 3, 5};
  volume.origin = {10, 20, 30};
  volume.step = {Vec3d(0, 2, 0), Vec3d(-1, 0, 0), Vec3d(0, 0, 0.5)};
  for (std::size_t z = 0; z < 5; ++z) {
    for (std::size_t y = 0; y < 3; ++y) {
      for (std::size_t x = 0; x < 4; ++x) {
        const Vec3d p = volume.world({double(x), double(y), double(z)});
        volume.value.push_back(static_cast<float>(p.dot(Vec3d(1, -2, 4))));
      }
    }
  }
  return volume;
}

TEST(Volume, LinearFieldsAreInterpolatedExactly) {
  const Volume volume = linear_volume();
  for (const Vec3d& voxel : {Vec3d(0, 0, 0), Vec3d(1.25, 0.5, 3.9), Vec3d(3, 2, 4)}) {
    EXPECT_NEAR(value_at(volume, voxel), volume.world(voxel).dot(Vec3d(1, -2, 4)), 1e-5);
  }
  EXPECT_LT((gradient_at(volume, {1.5, 1, 2}) - Vec3d(1, -2, 4)).norm(), 1e-5);
  // Beyond the last voxels nothing changes.
  EXPECT_EQ(value_at(volume, {-3, 1, 2}), value_at(volume, {0, 1, 2}));
  EXPECT_EQ(value_at(volume, {1, 1, 9}), value_at(volume, {1, 1, 4}));
}

TEST(Volume, OneVoxelIsAVolume) {
  Volume volume;
  volume.size = {1, 1, 1};
  volume.value = {7};
  EXPECT_EQ(value_at(volume, {0.3, -2, 5}), 7);
  EXPECT_TRUE(gradient_at(volume, {0, 0, 0}).isZero(0));
}

TEST(TransferFunction, IsLinearBetweenPointsAndConstantBeyond) {
  const TransferFunction function{
      {{0, {0, 0, 0}, 1}, {2, {1, 0.5F, 0}, 3}, {2, {0, 0, 1}, 5}, {4, {0, 0, 1}, 5}}, false};
  EXPECT_TRUE(function.problems().empty());
  EXPECT_EQ(function(-1).density, 1);
  EXPECT_EQ(function(1).density, 2);
  EXPECT_EQ(function(1).color, Vec3f(0.5F, 0.25F, 0));
  EXPECT_EQ(function(2).density, 5);
  EXPECT_EQ(function(9).density, 5);
  EXPECT_EQ(function.density_range(-2, 1)[1], 2);
  EXPECT_EQ(function.density_range(1, 3)[1], 5);
}

TEST(TransferFunction, NamesAreKnownAndUsable) {
  for (const std::string& name : transfer_function_names()) {
    EXPECT_TRUE(transfer_function(name).problems().empty()) << name;
  }
  EXPECT_THROW(transfer_function("bones"), Error);
}

TEST(TransferFunction, RelativeValuesAreSharesOfTheRange) {
  Volume volume;
  volume.size = {1001, 1, 1};
  for (int i = 0; i <= 1000; ++i) volume.value.push_back(static_cast<float>(i));
  const TransferFunction function{{{0, {1, 1, 1}, 0}, {1, {1, 1, 1}, 1}}, true};
  const TransferFunction values = absolute(function, volume);
  EXPECT_FALSE(values.relative);
  EXPECT_NEAR(values.point[0].value, 10, 1);
  EXPECT_NEAR(values.point[1].value, 999, 1);
}

}  // namespace
}  // namespace surfel
