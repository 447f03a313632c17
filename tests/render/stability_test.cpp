#include <limits>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/scene/framing.h>

#include "render/scenes.h"

namespace surfel::test {
namespace {

double total_alpha(const Image& image) {
  double sum = 0;
  for (std::size_t i = 3; i < image.data.size(); i += image.channels.size()) sum += image.data[i];
  return sum;
}

void expect_finite_colors(const Image& image) {
  for (std::size_t i = 0; i < image.data.size(); i += image.channels.size()) {
    for (int c = 0; c < 4; ++c) ASSERT_TRUE(std::isfinite(image.data[i + c]));
  }
}

TEST(Stability, NoPointGivesTheBackground) {
  RenderOptions options;
  options.background = {0.5F, 0.25F, 1, 1};
  const Image image = render_unlit(SurfelCloud{}, camera_at(2, 40), options);
  for (int i = 0; i < 40 * 40; ++i) {
    EXPECT_EQ(image.data[static_cast<std::size_t>(i) * 10], 0.5F);
    EXPECT_EQ(image.data[static_cast<std::size_t>(i) * 10 + 3], 1.0F);
  }
}

TEST(Stability, OnePointIsSeen) {
  SurfelCloud cloud;
  add_surfel(cloud, {0, 0, 0}, {0, 0, 1}, 0.01F, 0.01F, {1, 1, 1});
  const RenderCloud surfels(cloud);
  const Camera camera = make_camera(CameraOptions{}, surfels.extent());
  EXPECT_GT(total_alpha(render_unlit(cloud, camera)), 10);
}

TEST(Stability, PointsBehindTheCameraAndAtTheEyeAreNotSeen) {
  SurfelCloud cloud;
  for (const float z : {2.0F, 2.1F, 100.0F}) {
    add_surfel(cloud, {0, 0, z}, {0.3F, 0, 1}, 0.04F, 0.04F, {1, 1, 1});
  }
  const Image image = render_unlit(cloud, camera_at(2, 64));
  EXPECT_EQ(total_alpha(image), 0);
  expect_finite_colors(image);
}

TEST(Stability, UnusableSurfelsAreDroppedAndCounted) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  constexpr float kInf = std::numeric_limits<float>::infinity();
  SurfelCloud cloud = jittered_plane(16, 1, 0.3);
  cloud.position[3].x() = kNan;
  cloud.position[4].y() = kInf;
  cloud.variance[5] = 0;
  cloud.variance[6] = -1;
  cloud.variance[7] = kNan;
  cloud.coefficient[8].x() = kInf;
  cloud.normal[9] = Vec3f(kNan, 0, 1);  // An unknown normal, still a surfel.
  const RenderCloud surfels(cloud);
  EXPECT_EQ(surfels.dropped().position, 2);
  EXPECT_EQ(surfels.dropped().variance, 3);
  EXPECT_EQ(surfels.dropped().color, 1);
  EXPECT_EQ(surfels.size(), 16 * 16 - 6);
  expect_finite_colors(render_unlit(cloud, camera_at(2.5, 64)));
}

/// Weights and colours whose products and sums are no numbers of single precision would spoil every
/// pixel that they reach.
TEST(Stability, WeightsAndColorsBeyondSinglePrecisionAreDropped) {
  SurfelCloud cloud = jittered_plane(16, 1, 0.3);
  cloud.area[3] = 3e32F;
  cloud.variance[4] = 1e-38F;
  cloud.coefficient[5].y() = 3e38F;
  cloud.coefficient[6].z() = 1e17F;
  cloud.area[7] *= 1e12F;
  const RenderCloud surfels(cloud);
  EXPECT_EQ(surfels.dropped().color, 3);
  EXPECT_EQ(surfels.size(), 16 * 16 - 3);
  expect_finite_colors(render_unlit(cloud, camera_at(2.5, 64)));
}

TEST(Stability, NoVarianceIsAnError) {
  SurfelCloud cloud = jittered_plane(4, 1, 0);
  cloud.variance.clear();
  EXPECT_THROW(RenderCloud{cloud}, Error);
}

/// The scene scaled and moved, its camera with it, gives the same picture.
void expect_same_picture(double scale, const Vec3d& offset, double tolerance) {
  const SurfelCloud cloud = fibonacci_sphere(5000, 1, {0.3F, 0.6F, 0.9F});
  SurfelCloud moved = cloud;
  moved.origin = offset;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    moved.position[i] = (cloud.position[i].cast<double>() * scale).cast<float>();
    moved.variance[i] = static_cast<float>(cloud.variance[i] * scale * scale);
    moved.area[i] = static_cast<float>(cloud.area[i] * scale * scale);
  }
  const Camera camera = camera_at(3, 96);
  Camera moved_camera = camera;
  moved_camera.eye = camera.eye * scale + offset;
  const Image a = render_unlit(cloud, camera);
  const Image b = render_unlit(moved, moved_camera);
  double worst = 0;
  for (std::size_t i = 0; i < a.data.size(); i += a.channels.size()) {
    for (int c = 0; c < 4; ++c)
      worst = std::max<double>(worst, std::abs(a.data[i + c] - b.data[i + c]));
  }
  EXPECT_LT(worst, tolerance);
}

TEST(Stability, ScaleAndOffsetDoNotChangeThePicture) {
  expect_same_picture(1e-6, Vec3d(0, 0, 0), 1 / 255.0);
  expect_same_picture(1e6, Vec3d(0, 0, 0), 1 / 255.0);
  expect_same_picture(1, Vec3d(1e7, -1e7, 1e7), 1 / 255.0);
}

TEST(Stability, GrazingAndEdgeOnSplatsStayFinite) {
  SurfelCloud cloud;
  for (int i = 0; i < 200; ++i) {
    const double angle = M_PI / 2 + (i - 100) * 1e-4;
    add_surfel(cloud, Vec3d(0, -1 + 0.01 * i, -0.02 * i).cast<float>(),
               Vec3d(0, std::sin(angle), std::cos(angle)).cast<float>(), 0.04F, 0.04F, {1, 1, 1});
  }
  expect_finite_colors(render_unlit(cloud, camera_at(2, 96)));
}

TEST(Stability, HugeAndTinySplats) {
  SurfelCloud cloud;
  add_surfel(cloud, {0, 0, 0}, {0, 0, 1}, 100, 100, {1, 1, 1});           // Larger than the screen.
  add_surfel(cloud, {0, 0, 1}, {0, 0, 1}, 1e-12F, 1e-12F, {1, 1, 1});     // Far below a pixel.
  add_surfel(cloud, {0, 0, -5}, {0.9F, 0, 0.1F}, 1e6F, 1e6F, {1, 1, 1});  // Reaches behind the eye.
  const Image image = render_unlit(cloud, camera_at(30, 64));
  expect_finite_colors(image);
  EXPECT_GT(image.pixel(32, 32)[3], 0.1F);
}

TEST(Stability, CoincidentSurfelsAreOneSurface) {
  SurfelCloud cloud = jittered_plane(32, 1, 0.3);
  SurfelCloud twice = cloud;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    add_surfel(twice, cloud.position[i], cloud.normal[i], cloud.variance[i], cloud.area[i],
               cloud.coefficient[i]);
  }
  const Camera camera = camera_at(2.2, 64);
  const Image a = render_unlit(cloud, camera);
  const Image b = render_unlit(twice, camera);
  for (int y = 4; y < 60; ++y) {
    for (int x = 4; x < 60; ++x) {
      for (int c = 0; c < 3; ++c) ASSERT_NEAR(a.pixel(x, y)[c], b.pixel(x, y)[c], 1e-4);
    }
  }
}

TEST(Stability, GrazingHillsLeaveNoHolesWithFewLayers) {
  // Many surfels in a pixel, hills behind hills: a crest is deeper within its pixel than epsilon.
  SurfelCloud cloud = jittered_plane(300, 1, 0.35);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    Vec3f& p = cloud.position[i];
    p.z() = 0.03F * std::sin(40 * p.y()) * std::cos(5 * p.x());
    cloud.normal[i] = Vec3f(0.15F * std::sin(40 * p.y()) * std::sin(5 * p.x()),
                            -1.2F * std::cos(40 * p.y()) * std::cos(5 * p.x()), 1)
                          .normalized();
  }
  CameraOptions view;
  view.eye = Vec3d(0, -5, 1.2);
  view.target = Vec3d(0, 0, 0);
  view.up = Vec3d(0, 0, 1);
  view.fov = 30;
  view.width = view.height = 64;
  const Camera camera = make_camera(view, SceneExtent{});
  RenderOptions many;
  many.layers = 32;
  const Image truth = render_unlit(cloud, camera, many);
  const Image image = render_unlit(cloud, camera);
  int solid = 0;
  int holes = 0;
  for (int y = 0; y < 64; ++y) {
    for (int x = 0; x < 64; ++x) {
      // The hills are six pixels high, so that few of them are further than the pixel filter's
      // reach from the outline.
      if (truth.pixel(x, y)[3] < 0.9F) continue;
      ++solid;
      holes += image.pixel(x, y)[3] < truth.pixel(x, y)[3] - 0.1F ? 1 : 0;
    }
  }
  EXPECT_GT(solid, 150);
  EXPECT_EQ(holes, 0);  // 28 to 88 where slabs are not joined.
}

TEST(Stability, SingleRowAndColumnPictures) {
  const SurfelCloud cloud = fibonacci_sphere(2000, 1);
  for (const auto& [w, h] : {std::pair{1, 1}, {1, 300}, {300, 1}, {17, 33}}) {
    CameraOptions options;
    options.width = w;
    options.height = h;
    const RenderCloud surfels(cloud);
    const Image image = render_unlit(cloud, make_camera(options, surfels.extent()));
    EXPECT_EQ(image.data.size(), static_cast<std::size_t>(w) * h * 10);
    expect_finite_colors(image);
  }
}

}  // namespace
}  // namespace surfel::test
