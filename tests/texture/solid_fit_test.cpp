#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/render/renderer.h>
#include <surfel/store/render_cloud.h>
#include <surfel/texture/texture_fit.h>
#include <surfel/truth/image_error.h>

#include "render/scenes.h"

namespace surfel {
namespace {

/// A jittered grid of n x n surfels on the unit square of a slanted plane far away.
SurfelCloud slanted_plane(int n) {
  SurfelCloud cloud;
  cloud.origin = Vec3d(3e6, -2e6, 1e5);
  std::mt19937 generator(2);
  std::uniform_real_distribution<float> uniform(0, 1);
  const Vec3f along(0.8F, 0, -0.6F);
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) {
      const float u = (static_cast<float>(i) + uniform(generator)) / static_cast<float>(n);
      const float v = (static_cast<float>(j) + uniform(generator)) / static_cast<float>(n);
      cloud.position.emplace_back(u * along + Vec3f(0, v, 0));
    }
  }
  const float spacing = 1 / static_cast<float>(n);
  cloud.normal.assign(cloud.size(), Vec3f(0.6F, 0, 0.8F));
  cloud.variance.assign(cloud.size(), 0.5F * spacing * spacing);
  cloud.area.assign(cloud.size(), spacing * spacing);
  return cloud;
}

SolidTexture solid(const SurfelCloud& cloud, SolidPattern pattern) {
  SolidTextureOptions options;
  options.pattern = pattern;
  return {options, cloud.bounds()};
}

TEST(SolidFit, CoefficientsAreMeansOverTheSurfelsGaussians) {
  SurfelCloud cloud = slanted_plane(20);
  const Vec3f t(0, 1, 0);
  cloud.tangent.assign(cloud.size(), t);
  cloud.variance_u.assign(cloud.size(), 0.01F);
  cloud.variance_v.assign(cloud.size(), 0.0004F);
  const SolidTexture texture = solid(cloud, SolidPattern::kMarble);
  const TextureFitReport report = fit_solid(cloud, texture, {});
  EXPECT_EQ(report.surfels, cloud.size());
  EXPECT_EQ(report.without_kernel, 0U);
  KernelAxes axes;
  axes.col(0) = 0.1 * Vec3d(0, 1, 0);
  axes.col(1) = 0.02 * Vec3d(0.6, 0, 0.8).cross(Vec3d(0, 1, 0));
  for (std::size_t k = 0; k < cloud.size(); ++k) {
    const Vec3f expected = texture.filtered(cloud.world(k), axes);
    ASSERT_TRUE(cloud.coefficient[k].isApprox(expected, 1e-4F)) << k;
  }
}

TEST(SolidFit, SurfelsWithoutAKernelHaveTheColourAtTheirPlace) {
  SurfelCloud cloud = slanted_plane(8);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  cloud.normal[0] = Vec3f(0, 0, 0);
  cloud.variance[1] = nan;
  cloud.position[2] = Vec3f(nan, 0, 0);
  const SolidTexture texture = solid(cloud, SolidPattern::kWood);
  const TextureFitReport report = fit_solid(cloud, texture, {});
  EXPECT_EQ(report.without_kernel, 3U);
  EXPECT_EQ(cloud.coefficient[0], texture.evaluate(cloud.world(0)));
  EXPECT_EQ(cloud.coefficient[1], texture.evaluate(cloud.world(1)));
  EXPECT_EQ(cloud.coefficient[2], texture.mean());
}

TEST(SolidFit, BytesDoNotDependOnTheThreads) {
  for (const TextureFitKind kind :
       {TextureFitKind::kEwa, TextureFitKind::kGram, TextureFitKind::kRender}) {
    Array<Vec3f> first;
    for (const int threads : {1, 3}) {
      set_thread_count(threads);
      SurfelCloud cloud = slanted_plane(24);
      TextureFitOptions options;
      options.kind = kind;
      fit_solid(cloud, solid(cloud, SolidPattern::kMarble), options);
      if (first.empty()) first = cloud.coefficient;
      EXPECT_EQ(cloud.coefficient, first);
    }
    set_thread_count(0);
  }
}

TEST(SolidFit, RenderFitIsNearerToThePointsThanEwa) {
  SurfelCloud cloud = slanted_plane(40);
  SolidTextureOptions options;
  options.pattern = SolidPattern::kChecker;
  options.feature_size = 0.12;
  const SolidTexture texture(options, cloud.bounds());
  TextureFitOptions fit;
  fit.kind = TextureFitKind::kRender;
  const TextureFitReport report = fit_solid(cloud, texture, fit);
  ASSERT_TRUE(report.system.has_value());
  EXPECT_TRUE(report.system->converged);
  EXPECT_LT(report.system->error, 0.85 * report.system->error_ewa);
  EXPECT_EQ(cloud.basis_cutoff, fit.cutoff);
}

/// The plane's surfels with the colours at their places instead of means, and what a renderer makes
/// of them in ambient light.
void color_by_points(SurfelCloud& cloud, const SolidTexture& texture) {
  for (std::size_t k = 0; k < cloud.size(); ++k) {
    cloud.coefficient[k] = texture.evaluate(cloud.world(k));
  }
}

Image picture(const SurfelCloud& cloud, int size) {
  RenderCloud store(cloud);
  Scene scene;
  scene.ambient = Vec3f(1, 1, 1);
  scene.lights.clear();
  return Renderer(store, scene, RenderOptions{}).render(test::square_camera(size));
}

TEST(SolidFit, MeansAreNearerToTheTruthThanPointsAndDependLessOnThePlaces) {
  constexpr int kSide = 48;
  // Planes go on beyond the picture, so that no edges are seen, whose places depend on the samples.
  constexpr int kBeyond = 8;
  const float half = static_cast<float>(kSide + kBeyond) / kSide;
  for (const char* name : {"checker", "noise", "marble", "wood"}) {
    SolidTextureOptions options = solid_texture_options(name);
    options.feature_size = 2.0 / kSide;  // A spacing, and a pixel of the pictures.
    options.center = Vec3d(0.01, 0.02, 0.013);
    options.dark = Vec3f(0, 0, 0);
    options.light = Vec3f(1, 1, 1);
    const SolidTexture texture(options, Bounds{});
    SurfelCloud fine = test::jittered_plane(6 * (kSide + kBeyond), half, 0.5, 9);
    color_by_points(fine, texture);
    const Image truth = picture(fine, kSide);
    std::vector<Image> means;
    std::vector<Image> points;
    for (const std::uint64_t sampling : {1, 2}) {
      SurfelCloud cloud = test::jittered_plane(kSide + kBeyond, half, 0.5, sampling);
      for (float& variance : cloud.variance) variance *= 0.49F;
      fit_solid(cloud, texture, {});
      means.push_back(picture(cloud, kSide));
      color_by_points(cloud, texture);
      points.push_back(picture(cloud, kSide));
    }
    EXPECT_GE(image_error(means[0], truth).psnr, image_error(points[0], truth).psnr + 1) << name;
    EXPECT_GE(image_error(means[0], means[1]).psnr, image_error(points[0], points[1]).psnr + 12)
        << name;
  }
}

TEST(SolidFit, NeedsAVariance) {
  SurfelCloud cloud = slanted_plane(2);
  const SolidTexture texture = solid(cloud, SolidPattern::kNoise);
  cloud.variance.clear();
  EXPECT_THROW(fit_solid(cloud, texture, {}), Error);
  SurfelCloud empty;
  EXPECT_EQ(fit_solid(empty, texture, {}).surfels, 0U);
}

}  // namespace
}  // namespace surfel
