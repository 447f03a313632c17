#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>
#include <surfel/base/parallel.h>
#include <surfel/gaussian/gaussian_renderer.h>
#include <surfel/simplify/simplify_gaussians.h>
#include <surfel/truth/image_error.h>

#include "gaussian/random_gaussians.h"
#include "support/message_of.h"

namespace surfel::test {
namespace {

/// A wall across the view of gaussian_camera(): flat Gaussians of opacity 0.98, three over a place
/// in the mean, with colours that change slowly.
GaussianCloud wall(int side) {
  GaussianCloud cloud;
  cloud.resize(static_cast<std::size_t>(side) * static_cast<std::size_t>(side));
  const float step = 6.0F / static_cast<float>(side);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const auto x = static_cast<float>(i % static_cast<std::size_t>(side)) * step - 3;
    const auto y = static_cast<float>(i / static_cast<std::size_t>(side)) * step - 3;
    cloud.position[i] = {x, y, 4};
    const float s = step * std::sqrt(3 / (2 * 3.14159265F));
    cloud.scale[i] = {s, s, 0.01F * s};
    cloud.rotation[i] = {1, 0, 0, 0};
    cloud.amplitude[i] = 0.98F;
    cloud.harmonics[3 * i] = std::sin(x);
    cloud.harmonics[3 * i + 1] = std::sin(2 * y);
    cloud.harmonics[3 * i + 2] = 0.5F;
  }
  return cloud;
}

Image picture(const GaussianCloud& cloud, int size) {
  Camera camera = gaussian_camera(size, size);
  camera.center_x = camera.center_y = size / 2.0;
  camera.eye = cloud.origin;
  return GaussianRenderer(cloud, {}).render(camera);
}

TEST(SimplifyGaussians, LooksTheSameFromAfarAndWallsStayClosed) {
  const GaussianCloud full = wall(100);
  SimplifyGaussiansReport report;
  const GaussianCloud few = simplify_gaussians(full, {.count = 1000}, "wall", &report);
  EXPECT_EQ(few.size(), 1000U);
  EXPECT_EQ(report.unseen, 0U);
  EXPECT_GT(report.merged, 900U);
  EXPECT_LE(report.merged, 1000U);
  // About a pixel for each Gaussian of the result, the wall filling the picture and more.
  const Image truth = picture(full, 40);
  const Image seen = picture(few, 40);
  EXPECT_GT(image_error(seen, truth).psnr, 38);
  for (std::size_t p = 0; p < 40U * 40U; ++p) {
    EXPECT_GT(seen.data[4 * p + 3], 0.85F);
    EXPECT_NEAR(seen.data[4 * p + 3], truth.data[4 * p + 3], 0.1);
  }
}

TEST(SimplifyGaussians, LeavesOutWhatNobodySeesFirst) {
  GaussianCloud cloud = random_gaussians(2000, 3, 1);
  for (std::size_t i = 0; i < cloud.size(); i += 2) cloud.amplitude[i] = 0.003F;
  for (float& a : cloud.amplitude) a = a == 0.003F ? a : std::max(a, 0.01F);
  SimplifyGaussiansReport report;
  const GaussianCloud seen = simplify_gaussians(cloud, {.count = 1500}, "cloud", &report);
  EXPECT_EQ(report.unseen, 1000U);
  EXPECT_EQ(report.merged, 0U);
  EXPECT_EQ(seen.size(), 1000U);
  for (std::size_t i = 0; i < seen.size(); ++i) EXPECT_GE(seen.amplitude[i], 0.01F);
}

TEST(SimplifyGaussians, DoesNotDependOnTheThreads) {
  const GaussianCloud cloud = random_gaussians(5000, 5);
  const GaussianCloud many = simplify_gaussians(cloud, {.count = 300});
  set_thread_count(1);
  const GaussianCloud one = simplify_gaussians(cloud, {.count = 300});
  set_thread_count(0);
  ASSERT_EQ(many.size(), 300U);
  EXPECT_EQ(many.position, one.position);
  EXPECT_EQ(many.scale, one.scale);
  EXPECT_EQ(many.rotation, one.rotation);
  EXPECT_EQ(many.amplitude, one.amplitude);
  EXPECT_EQ(many.harmonics, one.harmonics);
}

TEST(SimplifyGaussians, RefusesWhatHasNoSense) {
  const GaussianCloud cloud = random_gaussians(10, 5);
  EXPECT_EQ(message_of([&] { simplify_gaussians(cloud, {}); }), "`count` is 0; it must be >= 1");
  GaussianCloud clear = cloud;
  for (float& a : clear.amplitude) a = 0.001F;
  EXPECT_EQ(message_of([&] { simplify_gaussians(clear, {.count = 1}, "a.ply"); }),
            "a.ply: holds no Gaussian that can be seen: all are points, or clearer than 1/255");
  GaussianCloud vast = random_gaussians(2000, 5);
  for (Vec3f& s : vast.scale) s.setConstant(1e18F);
  EXPECT_TRUE(message_of([&] {
                simplify_gaussians(vast, {.count = 1}, "a.ply");
              }).starts_with("a.ply: its extent is too large"));
}

}  // namespace
}  // namespace surfel::test
