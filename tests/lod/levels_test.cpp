// Pictures of clouds with levels of detail.

#include <cmath>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/lod/hierarchy.h>
#include <surfel/scene/framing.h>
#include <surfel/sp06/methods.h>
#include <surfel/truth/image_error.h>

#include "render/scenes.h"

namespace surfel::test {
namespace {

struct Picture {
  Image image;
  FrameStatistics statistics;
};

Picture render(const SurfelCloud& cloud, const Camera& camera, bool levels,
               RenderOptions options = {}) {
  options.lit = false;
  RenderCloud surfels(cloud, {.levels = levels});
  const Scene scene;
  Picture picture;
  picture.image = Renderer(surfels, scene, options).render(camera, &picture.statistics);
  return picture;
}

/// Smooth colours, so that pictures at different levels are alike.
void paint(SurfelCloud& cloud) {
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3f& p = cloud.position[i];
    cloud.coefficient[i] =
        Vec3f(0.5F + 0.4F * std::sin(9 * p.x()), 0.5F + 0.4F * std::cos(7 * p.y()),
              0.5F + 0.4F * std::sin(5 * (p.x() + p.y() + p.z())));
  }
}

/// Share of the pixels within `radius` of the middle that are not covered.
double holes(const Image& image, double radius) {
  double open = 0;
  double all = 0;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      if (std::hypot(x + 0.5 - image.width / 2.0, y + 0.5 - image.height / 2.0) > radius) continue;
      all += 1;
      open += image.pixel(x, y)[3] < 0.99F ? 1 : 0;
    }
  }
  return open / all;
}

TEST(Levels, NoLevelHasHoles) {
  SurfelCloud plane = jittered_plane(180, 1.5, 0.35);
  SurfelCloud sphere = fibonacci_sphere(30000, 1);
  for (SurfelCloud* cloud : {&plane, &sphere}) {
    const SurfelCloud lod = build_hierarchy(*cloud, {});
    const Camera camera = camera_at(4, 128);
    std::size_t before = cloud->size() + 1;
    for (const double error : {0.0, 0.7, RenderOptions::kLodError, 2.0, 4.0, 8.0}) {
      RenderOptions options;
      options.lod_error = error;
      const Picture picture = render(lod, camera, true, options);
      EXPECT_LE(holes(picture.image, 40), 2e-3) << error;
      EXPECT_LE(picture.statistics.splats, before) << error;
      before = picture.statistics.splats;
    }
    EXPECT_LT(before, cloud->size() / 10);
  }
}

TEST(Levels, ErrorOfNothingIsThePictureWithoutLevels) {
  SurfelCloud cloud = fibonacci_sphere(8000, 1);
  paint(cloud);
  const SurfelCloud lod = build_hierarchy(cloud, {});
  const Camera camera = camera_at(4, 96);
  RenderOptions finest;
  finest.lod_error = 0;
  const Image on = render(lod, camera, true, finest).image;
  const Image off = render(lod, camera, false).image;
  EXPECT_EQ(on.data, off.data);
  const double psnr = image_error(render(cloud, camera, false).image, off).psnr;
  EXPECT_GT(psnr, 80);  // The original's clusters come in another order.
}

TEST(Levels, PictureIsCloseToTheOneWithout) {
  SurfelCloud cloud = fibonacci_sphere(60000, 1);
  paint(cloud);
  const SurfelCloud lod = build_hierarchy(cloud, {});
  for (const double distance : {4.0, 7.0, 12.0}) {
    const Camera camera = camera_at(distance, 96);
    const Picture on = render(lod, camera, true);
    const Picture off = render(lod, camera, false);
    EXPECT_LT(on.statistics.splats, 0.7 * static_cast<double>(off.statistics.splats)) << distance;
    EXPECT_GT(image_error(on.image, off.image).psnr, 42) << distance;
  }
}

TEST(Levels, CostFollowsThePixels) {
  // Twice the surfels, the same picture: about as many splats.
  const Camera camera = camera_at(4, 64);
  std::vector<double> splats;
  for (const int count : {20000, 40000, 80000}) {
    const SurfelCloud lod = build_hierarchy(fibonacci_sphere(count, 1), {.reduction = 2});
    splats.push_back(static_cast<double>(render(lod, camera, true).statistics.splats));
  }
  EXPECT_LT(splats[1], 1.3 * splats[0]);
  EXPECT_LT(splats[2], 1.3 * splats[1]);
}

/// Largest and mean change of a colour from frame to frame of a slow zoom.
TEST(Levels, SlowZoomDoesNotPop) {
  SurfelCloud cloud = fibonacci_sphere(40000, 1);
  paint(cloud);
  const SurfelCloud lod = build_hierarchy(cloud, {.reduction = 4});
  const auto changes = [&](bool levels) {
    std::vector<double> rmse;
    Image before;
    std::size_t least = cloud.size();
    std::size_t most = 0;
    for (int frame = 0; frame < 25; ++frame) {
      const Picture p = render(lod, camera_at(6.2 * std::pow(1.01, frame), 64), levels);
      if (frame > 0) rmse.push_back(image_error(p.image, before).rmse);
      before = p.image;
      least = std::min(least, p.statistics.splats);
      most = std::max(most, p.statistics.splats);
    }
    if (levels) {
      EXPECT_LT(least, 0.8 * static_cast<double>(most));  // Levels did change.
    }
    return *std::max_element(rmse.begin(), rmse.end());
  };
  EXPECT_LT(changes(true), 1.5 * changes(false));
}

TEST(Levels, WorkInOrthographicProjectionAndBands) {
  SurfelCloud cloud = jittered_plane(150, 1, 0.35);
  paint(cloud);
  const SurfelCloud lod = build_hierarchy(cloud, {});
  CameraOptions view;
  view.eye = Vec3d(1, 2, 5);
  view.target = Vec3d(0, 0, 0);
  view.ortho = 3;
  view.width = view.height = 80;
  const Camera camera = make_camera(view, SceneExtent{});
  const Picture on = render(lod, camera, true);
  EXPECT_LE(on.statistics.splats, cloud.size() / 3);
  // The border of a plane is no silhouette: where it ends is known to half a spacing only.
  const Image off = render(lod, camera, false).image;
  ImageErrorOptions inside;
  inside.inside_only = true;
  EXPECT_GT(image_error(on.image, off, inside).psnr, 40);
  RenderOptions small;
  small.batch = 256;
  EXPECT_GT(image_error(render(lod, camera, true, small).image, on.image).psnr, 60);
}

TEST(Levels, FarAwayScenesAreTheSame) {
  SurfelCloud cloud = fibonacci_sphere(8000, 1);
  paint(cloud);
  SurfelCloud lod = build_hierarchy(cloud, {});
  Camera camera = camera_at(6, 64);
  const Image here = render(lod, camera, true).image;
  const Vec3d shift(1 << 24, -(1 << 23), 1 << 22);
  lod.origin += shift;
  camera.eye += shift;
  EXPECT_EQ(render(lod, camera, true).image.data, here.data);
}

TEST(Levels, MethodsWithGroupsRefuseThem) {
  SurfelCloud cloud = fibonacci_sphere(600, 1);
  cloud.group.assign(cloud.size(), 0);
  const SurfelCloud lod = build_hierarchy(cloud, {});
  RenderOptions options;
  options.method = compositing_method(Method::kDeferred);
  RenderColumns needed = columns_of(Method::kDeferred);
  const Scene scene;
  RenderCloud finest(lod, needed);
  EXPECT_NO_THROW(Renderer(finest, scene, options));
  needed.levels = true;
  RenderCloud levels(lod, needed);
  EXPECT_THROW(Renderer(levels, scene, options), Error);
}

TEST(Levels, UnusableSurfelsAreRefused) {
  SurfelCloud lod = build_hierarchy(fibonacci_sphere(600, 1), {});
  lod.variance_u[0] = NAN;
  EXPECT_THROW(RenderCloud(lod, {.levels = true}), Error);
  EXPECT_NO_THROW(RenderCloud{lod});  // The finest level is sound.
  lod.tree[0].first_child = 0;
  EXPECT_THROW(RenderCloud{lod}, Error);
}

}  // namespace
}  // namespace surfel::test
