// Cameras that fly through surfaces, along them, and out of rooms: nothing may vanish, explode or
// flash. Each frame against the reference's.

#include <algorithm>
#include <cmath>
#include <functional>

#include <gtest/gtest.h>
#include <surfel/scene/framing.h>
#include <surfel/truth/reference.h>

#include "render/scenes.h"

namespace surfel::test {
namespace {

constexpr int kFrames = 24;
constexpr int kViewSize = 56;

/// Colours that vary over a few surfels.
void color_waves(SurfelCloud& cloud, double wave) {
  const auto level = [&](float x) { return static_cast<float>(0.5 + 0.45 * std::sin(x / wave)); };
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3f& p = cloud.position[i];
    cloud.coefficient[i] = {level(p.x()), level(p.y()), level(p.x() + p.y() + p.z())};
  }
}

double rms_difference(const Image& a, const Image& b) {
  double sum = 0;
  for (int y = 0; y < a.height; ++y) {
    for (int x = 0; x < a.width; ++x) {
      for (int c = 0; c < 4; ++c) {
        const double d = a.pixel(x, y)[c] - b.pixel(x, y)[c];
        sum += d * d;
      }
    }
  }
  return std::sqrt(sum / (4.0 * a.width * a.height));
}

struct Flight {
  double largest_ratio = 0;  ///< Of a frame's change to that of the reference's.
  std::size_t holes = 0;     ///< Pixels that the reference covers and the picture does not, and ...
  std::size_t phantoms = 0;  ///< ... the other way round.
};

/// Flies from `from` to `to`, looking along `forward`.
Flight fly(const SurfelCloud& cloud, const Vec3d& from, const Vec3d& to, const Vec3d& forward,
           Kernel kernel = Kernel::kAuto) {
  RenderCloud surfels(cloud);
  const Scene scene;
  RenderOptions options;
  options.lit = false;
  options.kernel = kernel;
  options.layers = 8;
  Renderer fast(surfels, scene, options);
  const ReferenceRenderer reference(surfels, scene, options, {.samples = 4});
  Flight flight;
  Image last;
  Image last_truth;
  for (int i = 0; i < kFrames; ++i) {
    CameraOptions view;
    view.eye = from + (to - from) * (i / (kFrames - 1.0));
    view.target = *view.eye + forward;
    view.up = Vec3d(0.01, 1, 0.02);
    view.fov = 60;
    view.width = view.height = kViewSize;
    const Camera camera = make_camera(view, SceneExtent{});
    Image image = fast.render(camera);
    Image truth = reference.render(camera);
    for (int y = 0; y < kViewSize; ++y) {
      for (int x = 0; x < kViewSize; ++x) {
        const float alpha = image.pixel(x, y)[3];
        const float true_alpha = truth.pixel(x, y)[3];
        flight.holes += true_alpha > 0.99F && alpha < 0.5F ? 1 : 0;
        flight.phantoms += true_alpha < 0.01F && alpha > 0.5F ? 1 : 0;
      }
    }
    if (i > 0) {
      // Where nothing moves, rounding is no flash.
      constexpr double kStill = 2e-3;
      flight.largest_ratio =
          std::max(flight.largest_ratio,
                   rms_difference(image, last) / (rms_difference(truth, last_truth) + kStill));
    }
    last = std::move(image);
    last_truth = std::move(truth);
  }
  return flight;
}

TEST(Flight, ThroughAWall) {
  SurfelCloud wall = jittered_plane(60, 1.5, 0.3);
  color_waves(wall, 0.06);
  for (const Vec3d& forward : {Vec3d(0, 0, -1), Vec3d(0.5, 0.2, -1)}) {
    const Flight flight = fly(wall, {0.013, 0.021, 0.3}, {0.013, 0.021, -0.1}, forward);
    EXPECT_EQ(flight.holes, 0U);
    EXPECT_EQ(flight.phantoms, 0U);
    EXPECT_LT(flight.largest_ratio, 1.2);
  }
}

TEST(Flight, AlongAGrazingWall) {
  SurfelCloud wall = jittered_plane(80, 2, 0.3);
  color_waves(wall, 0.08);
  const Flight flight = fly(wall, {0, -1.2, 0.06}, {0.3, 0.4, 0.02}, {0.2, 1, -0.05});
  EXPECT_EQ(flight.holes, 0U);
  EXPECT_EQ(flight.phantoms, 0U);
  EXPECT_LT(flight.largest_ratio, 1.2);
}

TEST(Flight, OutOfAClosedRoom) {
  SurfelCloud room = fibonacci_sphere(4000, 1);
  color_waves(room, 0.08);
  const Flight flight = fly(room, {0.5, 0.02, 0.01}, {1.05, 0.02, 0.01}, {1, 0.1, 0.05});
  EXPECT_EQ(flight.holes, 0U);
  EXPECT_EQ(flight.phantoms, 0U);
  EXPECT_LT(flight.largest_ratio, 1.2);
}

TEST(Flight, TheAffineKernelFlashes) {
  SurfelCloud room = fibonacci_sphere(4000, 1);
  color_waves(room, 0.08);
  const Flight flight =
      fly(room, {0.5, 0.02, 0.01}, {1.05, 0.02, 0.01}, {1, 0.1, 0.05}, Kernel::kAffine);
  EXPECT_GT(flight.largest_ratio, 1.2);
}

}  // namespace
}  // namespace surfel::test
