#include <cstddef>

#include <gtest/gtest.h>
#include <surfel/gaussian/gaussian_extent.h>

namespace surfel::test {
namespace {

void add(GaussianCloud& cloud, const Vec3f& position, float opacity) {
  cloud.position.push_back(position);
  cloud.scale.emplace_back(0.01F, 0.01F, 0.01F);
  cloud.rotation.push_back({1, 0, 0, 0});
  cloud.amplitude.push_back(opacity);
  cloud.harmonics.insert(cloud.harmonics.end(), 3, 0.0F);
}

/// A cube of 10 cubed Gaussians, 2 units wide.
GaussianCloud cube() {
  GaussianCloud cloud;
  for (int i = 0; i < 1000; ++i) {
    add(cloud,
        {static_cast<float>(i % 10) / 4.5F - 1, static_cast<float>(i / 10 % 10) / 4.5F - 1,
         static_cast<float>(i / 100) / 4.5F - 1},
        0.9F);
  }
  return cloud;
}

TEST(GaussianExtent, FramesTipsAndNoFloaters) {
  GaussianCloud cloud = cube();
  add(cloud, {0, 1.2F, 0}, 0.9F);
  add(cloud, {7, 0, 0}, 0.9F);
  const SceneExtent extent = gaussian_extent(cloud);
  EXPECT_NEAR(extent.box.max.x(), 7.02, 1e-5);
  ASSERT_TRUE(extent.core);
  EXPECT_NEAR(extent.core->box.max.x(), 1.02, 1e-5);
  EXPECT_NEAR(extent.core->box.max.y(), 1.22, 1e-5);
  EXPECT_NEAR(extent.core->box.min.y(), -1.02, 1e-5);
}

TEST(GaussianExtent, DoesNotSeeWhatIsNearlyClear) {
  GaussianCloud cloud = cube();
  for (int i = 0; i < 500; ++i) add(cloud, {0, 0, 9}, 0.01F);
  EXPECT_NEAR(gaussian_extent(cloud).box.max.z(), 1.02, 1e-5);
}

}  // namespace
}  // namespace surfel::test
