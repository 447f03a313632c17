// Surfaces seen at grazing angles, and surfaces that cross or lie close to one another.

#include <cmath>
#include <numbers>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <surfel/base/random.h>

#include "render/scenes.h"

namespace surfel::test {
namespace {

constexpr double kRadian = std::numbers::pi / 180;

/// A jittered grid of surfels `spacing` apart over a rectangle in z = 0.
/// \param noise  how far surfels are off the plane, spacings; normals are off by as many radians.
SurfelCloud rectangle(double half_x, double half_y, double spacing, const Vec3f& color,
                      double noise = 0, std::uint64_t seed = 1) {
  SurfelCloud cloud;
  const auto s2 = static_cast<float>(spacing * spacing);
  std::uint64_t k = 0;
  for (double y = -half_y; y < half_y; y += spacing) {
    for (double x = -half_x; x < half_x; x += spacing, ++k) {
      const auto random = [&](std::uint64_t which) {
        return 2 * random_uniform(seed, k, which) - 1;
      };
      const Vec3d p(x + (0.5 + 0.3 * random(0)) * spacing, y + (0.5 + 0.3 * random(1)) * spacing,
                    noise * spacing * random(2));
      const Vec3d n(noise * random(3), noise * random(4), 1);
      add_surfel(cloud, p.cast<float>(), n.normalized().cast<float>(), 0.7F * s2, s2, color);
    }
  }
  return cloud;
}

void add_turned(SurfelCloud& cloud, const SurfelCloud& more, double degrees, const Vec3d& offset) {
  const Eigen::AngleAxisd turn(degrees * kRadian, Vec3d::UnitY());
  for (std::size_t i = 0; i < more.size(); ++i) {
    add_surfel(cloud, (turn * (more.position[i].cast<double>() + offset)).cast<float>(),
               (turn * more.normal[i].cast<double>()).cast<float>(), more.variance[i], more.area[i],
               more.coefficient[i]);
  }
}

/// One pixel of the picture is one unit of the scene at the origin.
Camera unit_camera(int size, double degrees, bool ortho) {
  CameraOptions options;
  const double distance = 20000;
  const double cosine = std::cos(degrees * kRadian);
  const double sine = std::sin(degrees * kRadian);
  options.eye = distance * Vec3d(0, -cosine, sine);
  options.target = Vec3d(0, 0, 0);
  options.up = Vec3d(0, sine, cosine);
  if (ortho) options.ortho = size;
  options.fov = 2 * std::atan(size / (2 * distance)) / kRadian;
  options.width = options.height = size;
  return make_camera(options, SceneExtent{});
}

/// The least alpha of a plane's inner pixels, seen at an angle to it.
float least_alpha(double degrees, double spacing, double cutoff, bool ortho, double noise = 0) {
  const double half_length = 12 / std::sin(degrees * kRadian);
  const SurfelCloud cloud = rectangle(12, half_length, spacing, {1, 1, 1}, noise);
  RenderOptions options;
  options.cutoff = cutoff;
  const Image image = render_unlit(cloud, unit_camera(32, degrees, ortho), options);
  float least = 1;
  for (int y = 12; y < 20; ++y) {
    for (int x = 10; x < 22; ++x) least = std::min(least, image.pixel(x, y)[3]);
  }
  return least;
}

TEST(CloseSurfaces, NoOpaquePlaneIsSeenThroughAtAnyAngle) {
  for (const double degrees : {0.2, 0.5, 1.0, 2.0, 3.0, 5.0, 10.0, 45.0, 89.0}) {
    for (const double spacing : {0.25, 0.5, 1.0, 2.0}) {
      if (12 * 12 / std::sin(degrees * kRadian) > 12000 * spacing * spacing) continue;
      for (const double cutoff : {1.0, 4.0}) {
        for (const bool ortho : {true, false}) {
          EXPECT_GE(least_alpha(degrees, spacing, cutoff, ortho), 0.999F)
              << degrees << " degrees, " << spacing << " pixels, cutoff " << cutoff << ' ' << ortho;
        }
      }
    }
  }
}

/// A white plane before a black one, both turned by 50 degrees.
TEST(CloseSurfaces, TheNearerOfTwoParallelPlanesIsSeen) {
  for (const double apart : {0.5, 1.0, 2.0}) {
    SurfelCloud cloud;
    add_turned(cloud, rectangle(40, 25, 0.5, {1, 1, 1}), 50, {0, 0, 0});
    add_turned(cloud, rectangle(40, 25, 0.5, {0, 0, 0}, 0, 2), 50, {0, 0, -apart});
    for (const double cutoff : {1.0, 2.0, 4.0}) {
      RenderOptions options;
      options.cutoff = cutoff;
      const Image image = render_unlit(cloud, unit_camera(32, 90, false), options);
      for (int y = 6; y < 26; ++y) {
        for (int x = 6; x < 26; ++x) {
          ASSERT_GE(image.pixel(x, y)[0], 0.99F) << apart << ' ' << cutoff << ' ' << x << ' ' << y;
        }
      }
    }
  }
}

/// Where planes cross, either is seen on its side of the line, as far as the pixel filter sees it:
/// the share of the right one is Phi of the distance.
TEST(CloseSurfaces, CrossingPlanesShareThePixelsAtTheLine) {
  for (const double degrees : {5.0, 20.0, 60.0}) {
    SurfelCloud cloud;
    add_turned(cloud, rectangle(40, 25, 0.5, {1, 1, 1}), 0, {0, 0, 0});
    add_turned(cloud, rectangle(40, 25, 0.5, {0, 0, 0}, 0, 2), degrees, {0, 0, 0});
    for (const double cutoff : {1.0, 2.0, 4.0}) {
      RenderOptions options;
      options.cutoff = cutoff;
      const Image image = render_unlit(cloud, unit_camera(32, 90, false), options);
      double squares = 0;
      int count = 0;
      for (int x = 4; x < 28; ++x) {
        const double truth = 0.5 * std::erfc(-(x + 0.5 - 16) / std::numbers::sqrt2);
        for (int y = 6; y < 26; ++y, ++count) {
          const double error = image.pixel(x, y)[0] - truth;
          squares += error * error;
        }
      }
      const double error = std::sqrt(squares / count);
      // At 5 degrees the planes are less than a tenth of a pixel apart beside the line.
      EXPECT_LT(error, degrees < 10 ? 0.03 : 0.003) << degrees << ' ' << cutoff;
    }
  }
}

TEST(CloseSurfaces, NoisyPlanesDoNotFallApart) {
  for (const double noise : {0.1, 0.3}) {
    for (const double spacing : {0.5, 1.0}) {
      for (const double cutoff : {1.0, 4.0}) {
        EXPECT_GE(least_alpha(60, spacing, cutoff, false, noise), 0.999F)
            << noise << ' ' << spacing;
      }
    }
  }
}

}  // namespace
}  // namespace surfel::test
