// Thousands of surfels over each other: pictures stay what they are, and work is bounded.

#include <cmath>

#include <gtest/gtest.h>

#include "render/scenes.h"

namespace surfel::test {
namespace {

/// The red and green of every second surfel, at one place each.
SurfelCloud crowd(std::size_t count) {
  SurfelCloud cloud;
  for (std::size_t i = 0; i < count; ++i) {
    add_surfel(cloud, {0, 0, 0}, {0, 0, 1}, 0.04F, 0.01F,
               i % 2 == 0 ? Vec3f(1, 0, 0) : Vec3f(0, 1, 0));
  }
  return cloud;
}

TEST(CrowdedSurfels, AlikeAtOnePlaceBecomeOne) {
  SurfelCloud cloud = crowd(3000);
  for (std::size_t i = 0; i < 1000; ++i) cloud.normal[i] = {0, 0, -1};
  cloud.material.assign(3000, 0);
  cloud.material[2999] = 1;
  const RenderCloud merged(cloud);
  EXPECT_EQ(merged.size(), 3U);
  EXPECT_EQ(merged.coincident(), 2997U);
  double area = 0;
  for (std::size_t i = 0; i < 3; ++i) area += merged.area[i];
  EXPECT_NEAR(area, 30, 1e-4);
  // Fewer than a cluster are left as they are.
  EXPECT_EQ(RenderCloud(crowd(100)).size(), 100U);
}

TEST(CrowdedSurfels, MergedLookAsTheyDidOneByOne) {
  // Apart by less than rounding of the depth shows, they are not merged.
  SurfelCloud apart = crowd(1000);
  for (std::size_t i = 0; i < apart.size(); ++i) {
    apart.position[i].x() = 1e-7F * static_cast<float>(i);
  }
  apart.alpha.assign(1000, 0.25F);
  SurfelCloud together = crowd(1000);
  together.alpha = apart.alpha;
  const Camera camera = camera_at(3, 64);
  const Image expected = render_unlit(apart, camera);
  const Image image = render_unlit(together, camera);
  for (std::size_t i = 0; i < image.data.size(); ++i) {
    if (!std::isfinite(expected.data[i])) continue;
    ASSERT_NEAR(image.data[i], expected.data[i], 2e-3 * (1 + std::abs(expected.data[i]))) << i;
  }
}

TEST(CrowdedSurfels, LargeOnesOverEachOtherCostABoundedTimeAPixel) {
  // Discs over the whole picture, in distinct places of one plane.
  const auto discs = [](std::size_t count) {
    SurfelCloud cloud;
    for (std::size_t i = 0; i < count; ++i) {
      const auto shift = 1e-4F * static_cast<float>(i) / static_cast<float>(count);
      add_surfel(cloud, {shift, -shift, 0}, {0, 0, 1}, 4, 20.0F / static_cast<float>(count),
                 i % 3 == 0 ? Vec3f(1, 0, 0) : Vec3f(0, 0.5F, 1));
    }
    return cloud;
  };
  const Camera camera = camera_at(3, 32);
  for (const Kernel kernel : {Kernel::kPerspective, Kernel::kAffine}) {
    RenderOptions options;
    options.kernel = kernel;
    FrameStatistics few;
    FrameStatistics many;
    const Image expected = render_unlit(discs(500), camera, options, &few);
    const Image image = render_unlit(discs(30000), camera, options, &many);
    EXPECT_EQ(few.thinned_splats, 0U);
    EXPECT_GT(many.thinned_splats, 0U);
    EXPECT_LE(many.fragments, 256U * 32 * 32);
    for (int y = 0; y < 32; ++y) {
      for (int x = 0; x < 32; ++x) {
        for (int c = 0; c < 4; ++c) {
          ASSERT_NEAR(image.pixel(x, y)[c], expected.pixel(x, y)[c], 0.03) << x << " " << y;
        }
      }
    }
  }
}

/// `count` discs that are 60 pixels wide and more in pictures by square_camera_of(), among small
/// ones in front of them, between them and behind them.
SurfelCloud discs_among_dots(int count) {
  SurfelCloud cloud;
  for (int i = 0; i < count; ++i) {
    const float depth = 0.01F * static_cast<float>(i);
    const float shift = 0.2F * std::sin(static_cast<float>(i));
    add_surfel(cloud, {shift, -shift, depth}, {0, 0, 1}, 1.5F, 0.2F,
               {static_cast<float>(i % 2), 0.5F, 1});
    add_surfel(cloud, {2 * shift, 3 * shift, depth + 0.005F}, {0, 0, 1}, 1e-3F, 1e-3F, {0, 1, 0});
  }
  return cloud;
}

/// Orthographic, 32 pixels for two units, whatever the size.
Camera square_camera_of(int size) {
  CameraOptions options;
  options.eye = Vec3d(0, 0, 4);
  options.target = Vec3d(0, 0, 0);
  options.ortho = size / 16.0;
  options.width = options.height = size;
  return make_camera(options, SceneExtent{});
}

TEST(CrowdedSurfels, DiscsOverAWholeBlockAreDrawnInTheirOrder) {
  // A picture of 32 pixels is one block, which the discs cover; one of 512 has blocks of 64 and
  // more, which they do not.
  RenderOptions options;
  options.layers = 16;
  const SurfelCloud cloud = discs_among_dots(100);
  const Image small = render_unlit(cloud, square_camera_of(32), options);
  const Image large = render_unlit(cloud, square_camera_of(512), options);
  for (int y = 0; y < 32; ++y) {
    for (int x = 0; x < 32; ++x) {
      for (int c = 0; c < 4; ++c) {
        ASSERT_NEAR(small.pixel(x, y)[c], large.pixel(240 + x, 240 + y)[c], 1e-4) << x << " " << y;
      }
    }
  }
}

TEST(CrowdedSurfels, SmallOnesStayWhereLargeOnesAreThinned) {
  // A dot in front of everything is seen whole, however many discs there are behind it.
  SurfelCloud cloud = discs_among_dots(2400);
  add_surfel(cloud, {0, 0, 30}, {0, 0, 1}, 0.02F, 0.02F, {1, 0, 0});
  FrameStatistics statistics;
  CameraOptions camera;
  camera.eye = Vec3d(0, 0, 60);
  camera.target = Vec3d(0, 0, 0);
  camera.ortho = 2;
  camera.width = camera.height = 32;
  RenderOptions options;
  options.coverage_threshold = 0.1;
  const Image image = render_unlit(cloud, make_camera(camera, SceneExtent{}), options, &statistics);
  EXPECT_GT(statistics.thinned_splats, 0U);
  const float* const middle = image.pixel(16, 16);
  EXPECT_NEAR(middle[0], 1, 1e-3);
  EXPECT_NEAR(middle[1], 0, 1e-3);
}

}  // namespace
}  // namespace surfel::test
