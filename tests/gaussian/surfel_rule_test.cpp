// A Gaussian of rank 2 has the kernel of a surfel: what differs between both is the amplitude rule.

#include <cmath>
#include <cstddef>
#include <string>

#include <gtest/gtest.h>
#include <surfel/gaussian/gaussian_renderer.h>

#include "render/scenes.h"

namespace surfel::test {
namespace {

constexpr float kHarmonic0 = 0.28209479F;
/// Where exact kernels end: at 2^-12 of their peak.
const double kCutoff = 12 * std::log(2.0);

/// Flat Gaussians in the places of surfels: red and green are theirs, blue is 1, so that blue sums
/// up kernels. So faint that none hides another.
GaussianCloud faint_gaussians(const SurfelCloud& surfels) {
  GaussianCloud cloud;
  for (std::size_t i = 0; i < surfels.size(); ++i) {
    const float deviation = std::sqrt(surfels.variance[i]);
    cloud.position.push_back(surfels.position[i]);
    cloud.scale.emplace_back(deviation, deviation, 0.0F);
    cloud.rotation.push_back({1, 0, 0, 0});
    cloud.amplitude.push_back(1e-6F);
    const Vec3f& c = surfels.coefficient[i];
    for (const float value : {c.x(), c.y(), 1.0F}) {
      cloud.harmonics.push_back((value - 0.5F) / kHarmonic0);
    }
  }
  return cloud;
}

/// A camera that looks down on the plane z = 0, whose depths in the picture differ by half.
Camera slanted_camera(double distance) {
  Camera camera;
  camera.width = 120;
  camera.height = 90;
  camera.focal_x = camera.focal_y = 150;
  camera.center_x = 60;
  camera.center_y = 45;
  const Vec3d forward = Vec3d(0, 0.7, 1).normalized();
  camera.eye = -distance * forward;
  const Vec3d right(1, 0, 0);
  camera.camera_from_world << right.transpose(), forward.cross(right).transpose(),
      forward.transpose();
  return camera;
}

/// Calls visit(ours, truth) for the pixels inside surfaces, and returns how many there are.
template <class Visit>
std::size_t for_inner_pixels(const Image& ours, const Image& truth, const Visit& visit) {
  std::size_t pixels = 0;
  for (int y = 0; y < truth.height; ++y) {
    for (int x = 0; x < truth.width; ++x) {
      const float* b = truth.pixel(x, y);
      if (b[3] < 1 || b[kSumOfRho] < 0.9F) continue;
      ++pixels;
      visit(ours.pixel(x, y), b);
    }
  }
  return pixels;
}

TEST(SurfelRule, FlatGaussiansDividedByTheirSumGiveTheSurfelsPicture) {
  const SurfelCloud surfels = jittered_plane(60, 1.5, 0.5);
  const GaussianCloud gaussians = faint_gaussians(surfels);
  struct View {
    double distance, least;  ///< dB
  };
  // Magnified, kernels are the plane's; minified, they are the filter's.
  for (const View view : {View{1, 60}, View{4, 60}, View{12, 55}}) {
    const Camera camera = slanted_camera(view.distance);
    RenderOptions options;
    options.kernel = Kernel::kPerspective;
    options.cutoff = kCutoff;
    const Image truth = render_unlit(surfels, camera, options);
    const Image ours =
        GaussianRenderer(gaussians,
                         {.profile = GaussianProfile::kExact, .lowpass = 1, .display = true})
            .render(camera);
    double sum = 0;
    const std::size_t pixels = for_inner_pixels(ours, truth, [&](const float* a, const float* b) {
      for (int c = 0; c < 2; ++c) sum += std::pow(double{a[c]} / double{a[2]} - double{b[c]}, 2);
    });
    ASSERT_GT(pixels, 200u);
    EXPECT_GT(-10 * std::log10(sum / static_cast<double>(2 * pixels)), view.least) << view.distance;
  }
}

TEST(SurfelRule, SurfacesAreDrawnAsTheRendererOfSurfelsDoes) {
  // A plane, and a smaller one before it.
  SurfelCloud surfels = jittered_plane(60, 1.5, 0.5);
  const SurfelCloud before = jittered_plane(24, 0.6, 0.5, 2, -0.4);
  surfels.position.insert(surfels.position.end(), before.position.begin(), before.position.end());
  surfels.normal.insert(surfels.normal.end(), before.normal.begin(), before.normal.end());
  surfels.variance.insert(surfels.variance.end(), before.variance.begin(), before.variance.end());
  surfels.area.insert(surfels.area.end(), before.area.begin(), before.area.end());
  surfels.coefficient.insert(surfels.coefficient.end(), before.coefficient.begin(),
                             before.coefficient.end());
  GaussianCloud gaussians = faint_gaussians(surfels);
  gaussians.rule = AmplitudeRule::kSurfel;
  gaussians.amplitude.assign(gaussians.size(), 1.0F);
  for (std::size_t i = 0; i < gaussians.size(); ++i) {
    gaussians.harmonics[3 * i + 2] = (surfels.coefficient[i].z() - 0.5F) / kHarmonic0;
  }
  for (const double distance : {1.0, 4.0, 12.0}) {
    const Camera camera = slanted_camera(distance);
    RenderOptions options;
    options.kernel = Kernel::kPerspective;
    options.cutoff = kCutoff;
    const Image truth = render_unlit(surfels, camera, options);
    const Image ours =
        GaussianRenderer(
            gaussians,
            {.profile = GaussianProfile::kSurfel, .lowpass = 1, .depth = true, .display = true})
            .render(camera);
    double sum = 0;
    const std::size_t pixels = for_inner_pixels(ours, truth, [&](const float* a, const float* b) {
      EXPECT_EQ(a[3], 1);
      for (int c = 0; c < 3; ++c) sum += std::pow(double{a[c]} - double{b[c]}, 2);
    });
    ASSERT_GT(pixels, 200u);
    const double psnr = -10 * std::log10(sum / static_cast<double>(3 * pixels));
    EXPECT_GT(psnr, 45) << distance;
    RecordProperty("dB_at_" + std::to_string(static_cast<int>(distance)), std::to_string(psnr));
  }
}

}  // namespace
}  // namespace surfel::test
