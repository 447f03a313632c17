// The renderer of two geometry passes that SP06 compares with, against its definition.

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/render/ewa_kernel.h>
#include <surfel/sp06/methods.h>

#include "render/scenes.h"

namespace surfel::test {
namespace {

/// The unlit picture with all AOVs; kernels are affine, as make_ewa_kernel() makes them.
Image two_pass(const SurfelCloud& cloud, const Camera& camera, RenderOptions options = {}) {
  options.method = compositing_method(Method::kTwoPass);
  options.kernel = Kernel::kAffine;
  return render_unlit(cloud, camera, options);
}

/// A surfel's kernel and plane.
struct PlainSplat {
  EwaKernel kernel;
  DepthPlane plane;
  double reach = 0;  ///< Most difference of a fragment's depth from the centre's.
  bool front = false;
  Vec3f color;
};

std::vector<PlainSplat> plain_splats(const SurfelCloud& cloud, const Camera& camera,
                                     double cutoff) {
  std::vector<PlainSplat> splats;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const SurfelInCamera s = in_camera(cloud, i, camera);
    PlainSplat splat;
    splat.kernel = *make_ewa_kernel(s, camera, 1);
    splat.plane = depth_plane(s, camera);
    const double z = camera.orthographic ? 1 : s.position.z();
    const Vec3d ray = camera.orthographic ? Vec3d(0, 0, 1) : Vec3d(s.position / s.position.norm());
    const double pixel_on_plane = z / camera.focal_y / std::abs(s.normal.dot(ray));
    splat.reach =
        std::sqrt(2 * cutoff * (s.variance_u + pixel_on_plane * pixel_on_plane)) / (z * z);
    splat.front = s.normal.dot(ray) < 0;
    splat.color = cloud.coefficient[i];
    splats.push_back(splat);
  }
  return splats;
}

/// SP06 (1) in one pixel.
struct PlainPixel {
  Vec3d color{0, 0, 0};
  double weight = 0;
  bool certain = true;  ///< No comparison is within rounding.
};

PlainPixel plain_pixel(const std::vector<PlainSplat>& splats, const Vec2d& at, double cutoff) {
  constexpr double kRounding = 1e-4;
  struct Found {
    double depth, rho;
    const PlainSplat* splat;
  };
  PlainPixel pixel;
  std::vector<Found> fragments;
  for (const PlainSplat& splat : splats) {
    const double beta = splat.kernel.beta(at);
    if (std::abs(beta - cutoff) < kRounding) pixel.certain = false;
    if (beta >= cutoff) continue;
    const double slope = splat.plane.gradient.dot(at - splat.kernel.center);
    fragments.push_back({splat.plane.value + std::clamp(slope, -splat.reach, splat.reach),
                         splat.kernel.rho(at), &splat});
  }
  if (fragments.empty()) return pixel;
  std::sort(fragments.begin(), fragments.end(),
            [](const Found& a, const Found& b) { return a.depth > b.depth; });
  const Found& nearest = fragments.front();
  for (const Found& f : fragments) {
    const double behind = nearest.depth - f.depth;
    const double epsilon = f.splat->reach / std::sqrt(std::max(1.0, cutoff));
    if (std::abs(behind - epsilon) < kRounding * epsilon) pixel.certain = false;
    if (f.splat->front != nearest.splat->front) {
      // Either may be the nearest.
      if (behind < kRounding * epsilon) pixel.certain = false;
      continue;
    }
    if (behind > epsilon) continue;
    pixel.color += f.rho * f.splat->color.cast<double>();
    pixel.weight += f.rho;
  }
  pixel.color /= pixel.weight;
  return pixel;
}

/// Compares the first layer of all pixels. Returns how many are covered and certain.
int expect_definition(const SurfelCloud& cloud, const Camera& camera, double cutoff) {
  RenderOptions options;
  options.layers = 1;
  options.cutoff = cutoff;
  const Image image = two_pass(cloud, camera, options);
  const auto splats = plain_splats(cloud, camera, cutoff);
  int count = 0;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const PlainPixel expected = plain_pixel(splats, {x + 0.5, y + 0.5}, cutoff);
      const float* const p = image.pixel(x, y);
      if (!expected.certain || expected.weight < 1e-3) continue;
      EXPECT_NEAR(p[kSumOfRho], expected.weight, 1e-4 * expected.weight) << x << ", " << y;
      for (int c = 0; c < 3; ++c) {
        EXPECT_NEAR(p[c] / p[3], expected.color[c], 1e-4) << x << ", " << y;
      }
      ++count;
    }
  }
  return count;
}

TEST(TwoPass, EqualsBruteForceOfTheDefinition) {
  // Surfels of both sides are strewn in a box.
  SurfelCloud cloud;
  for (int i = 0; i < 700; ++i) {
    const auto random = [&](int k) { return random_uniform(11, i, k); };
    // Not so steep that its gradient is bounded.
    const Vec3d normal(random(3) - 0.5, random(4) - 0.5, i % 2 == 0 ? 0.5 : -0.5);
    add_surfel(cloud, (Vec3d(random(0), random(1), random(2)) - Vec3d(0.5, 0.5, 0.5)).cast<float>(),
               normal.normalized().cast<float>(), static_cast<float>(0.002 + 0.002 * random(5)),
               0.003F, Vec3d(random(6), random(7), random(8)).cast<float>());
  }
  EXPECT_GT(expect_definition(cloud, camera_at(2.5, 72), 1), 500);
}

TEST(TwoPass, AMagnifiedPlaneIsTheNormalisedSum) {
  // Nothing is behind the plane: SS01 (9).
  const SurfelCloud plane = jittered_plane(24, 1, 0.3);
  EXPECT_GT(expect_definition(plane, square_camera(96), 2), 96 * 96 * 9 / 10);
}

/// Two planes of the same splats, red before blue, that are so many epsilons apart.
Image red_before_blue(double epsilons, int layers) {
  constexpr int kSize = 96;
  SurfelCloud cloud = jittered_plane(40, 1, 0.2);
  const std::size_t count = cloud.size();
  cloud.coefficient.assign(count, Vec3f(1, 0, 0));
  const double pixel = 2.0 / kSize;
  const double epsilon = std::sqrt(2 * (cloud.variance[0] + pixel * pixel));
  for (std::size_t i = 0; i < count; ++i) {
    const Vec3f behind = cloud.position[i] - Vec3f(0, 0, static_cast<float>(epsilons * epsilon));
    add_surfel(cloud, behind, cloud.normal[i], cloud.variance[i], cloud.area[i], {0, 0, 1});
  }
  RenderOptions options;
  options.layers = layers;
  return two_pass(cloud, square_camera(kSize), options);
}

TEST(TwoPass, PlanesWithinEpsilonAreBlendedAndOthersHidden) {
  for (const int layers : {1, 3}) {
    EXPECT_LT(worst_error(red_before_blue(1.05, layers), {1, 0, 0, 1}), 1e-5) << layers;
    EXPECT_LT(worst_error(red_before_blue(0.95, layers), {0.5F, 0, 0.5F, 1}), 1e-5) << layers;
  }
}

TEST(TwoPass, OtherSideWithinEpsilonIsAnotherSurface) {
  SurfelCloud cloud = jittered_plane(40, 1, 0.2);
  cloud.coefficient.assign(cloud.size(), Vec3f(0, 1, 0));
  const std::size_t count = cloud.size();
  for (std::size_t i = 0; i < count; ++i) {
    add_surfel(cloud, cloud.position[i] - Vec3f(0, 0, 1e-3F), -cloud.normal[i], cloud.variance[i],
               cloud.area[i], {1, 1, 1});
  }
  EXPECT_LT(worst_error(two_pass(cloud, square_camera(96)), {0, 1, 0, 1}), 1e-5);
}

/// The same pixels of the picture, though other pixels are at the borders of tiles and of the SIMD
/// vectors' patches.
TEST(TwoPass, DoesNotDependOnWhereTilesLie) {
  constexpr int kSize = 96;
  const SurfelCloud sphere = fibonacci_sphere(3000, 0.8, {0.4F, 0.7F, 0.9F});
  const Camera camera = camera_at(2.6, kSize);
  const Image still = two_pass(sphere, camera);
  for (const auto& [dx, dy] : {std::pair(5, 3), std::pair(1, 8), std::pair(-7, -9)}) {
    Camera moved = camera;
    moved.center_x += dx;
    moved.center_y += dy;
    const Image image = two_pass(sphere, moved);
    double worst = 0;
    for (int y = 16; y < kSize - 16; ++y) {
      for (int x = 16; x < kSize - 16; ++x) {
        for (int c = 0; c < 4; ++c) {
          worst = std::max<double>(worst,
                                   std::abs(still.pixel(x, y)[c] - image.pixel(x + dx, y + dy)[c]));
        }
      }
    }
    EXPECT_LT(worst, 1e-3) << dx << ", " << dy;
  }
}

}  // namespace
}  // namespace surfel::test
