#include <algorithm>
#include <type_traits>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/render/ewa_kernel.h>
#include <surfel/scene/framing.h>
#include <surfel/surface/coverage_threshold.h>

#include "render/scenes.h"

namespace surfel::test {
namespace {

/// One splat against eq. (6) in double: largest difference over the picture, relative to the peak.
double error_of_single_splat(const SurfelCloud& cloud, const Camera& camera, double cutoff,
                             double lowpass) {
  RenderOptions options;
  options.cutoff = cutoff;
  options.lowpass = lowpass;
  options.kernel = Kernel::kAffine;
  const Image image = render_unlit(cloud, camera, options);
  const auto kernel = make_ewa_kernel(in_camera(cloud, 0, camera), camera, lowpass);
  double worst = 0;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const Eigen::Vector2d pixel(x + 0.5, y + 0.5);
      const double beta = kernel->beta(pixel);
      if (std::abs(beta - cutoff) < 1e-3) continue;  // The edge itself may round either way.
      const double expected = beta < cutoff ? kernel->rho(pixel) : 0;
      worst = std::max(worst, std::abs(expected - image.pixel(x, y)[kSumOfRho]));
    }
  }
  return worst / kernel->amplitude;
}

SurfelCloud single(const Vec3f& position, const Vec3f& normal, float deviation) {
  SurfelCloud cloud;
  add_surfel(cloud, position, normal.normalized(), deviation * deviation, deviation * deviation,
             {1, 1, 1});
  return cloud;
}

constexpr double kSplatTolerance = 1e-4;  // Of the peak; float arithmetic and the polynomial exp().

TEST(Renderer, SingleSplatFrontOnMatchesEquation6) {
  const Camera camera = camera_at(2, 128);
  for (const float deviation : {1e-4F, 0.01F, 0.1F, 0.3F}) {
    EXPECT_LT(
        error_of_single_splat(single({0.013F, -0.02F, 0}, {0, 0, 1}, deviation), camera, 4, 1),
        kSplatTolerance);
  }
}

TEST(Renderer, SingleSplatSlantedMatchesEquation6) {
  const Camera camera = camera_at(2, 128);
  for (const float x : {0.5F, 1.0F, 3.0F, 11.0F}) {
    EXPECT_LT(error_of_single_splat(single({0.1F, 0.1F, 0}, {x, 0.7F * x, 1}, 0.15F), camera, 2, 1),
              kSplatTolerance)
        << x;
  }
}

TEST(Renderer, SingleSplatAnisotropicMatchesEquation6) {
  const Camera camera = camera_at(2, 128);
  SurfelCloud cloud = single({0.1F, 0, 0}, {0.4F, -0.3F, 1}, 0.1F);
  cloud.tangent.push_back(cloud.normal[0].unitOrthogonal());
  cloud.variance_u.push_back(0.04F);
  cloud.variance_v.push_back(0.0004F);
  for (const double lowpass : {0.5, 1.0, 3.0}) {
    EXPECT_LT(error_of_single_splat(cloud, camera, 3, lowpass), kSplatTolerance);
  }
}

TEST(Renderer, SingleSplatAtTheBorderMatchesEquation6) {
  const Camera camera = camera_at(2, 100);  // Not a multiple of the tile.
  for (const Vec3f& p : {Vec3f(0.73F, 0, 0), Vec3f(-0.73F, 0.72F, 0), Vec3f(0, -0.75F, 0)}) {
    EXPECT_LT(error_of_single_splat(single(p, {0.2F, 0, 1}, 0.1F), camera, 2, 1), kSplatTolerance);
  }
}

TEST(Renderer, OrthographicSplatMatchesEquation6) {
  CameraOptions options;
  options.eye = Vec3d(0, 0, 5);
  options.target = Vec3d(0, 0, 0);
  options.ortho = 2;
  options.width = options.height = 128;
  const Camera camera = make_camera(options, SceneExtent{});
  EXPECT_LT(error_of_single_splat(single({0.2F, 0.3F, 0}, {1, 0.5F, 1}, 0.1F), camera, 2, 1),
            kSplatTolerance);
}

/// The plane's picture against the brute-force sum of eq. (9) in double, away from its border.
void expect_equation_9(const SurfelCloud& cloud, const Camera& camera, double cutoff, int margin) {
  RenderOptions options;
  options.cutoff = cutoff;
  const Image image = render_unlit(cloud, camera, options);
  std::vector<EwaKernel> kernels;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    kernels.push_back(*make_ewa_kernel(in_camera(cloud, i, camera), camera, 1));
  }
  double worst = 0;
  for (int y = margin; y < image.height - margin; y += 3) {
    for (int x = margin; x < image.width - margin; x += 3) {
      double sum = 0;
      Vec3d color(0, 0, 0);
      bool on_edge = false;
      for (std::size_t i = 0; i < kernels.size(); ++i) {
        const Eigen::Vector2d pixel(x + 0.5, y + 0.5);
        const double beta = kernels[i].beta(pixel);
        on_edge = on_edge || std::abs(beta - cutoff) < 2e-6;
        if (beta >= cutoff) continue;
        sum += kernels[i].rho(pixel);
        color += kernels[i].rho(pixel) * cloud.coefficient[i].cast<double>();
      }
      if (on_edge) continue;
      ASSERT_GT(sum, 0);
      const float* p = image.pixel(x, y);
      ASSERT_GT(p[3], 0.5F);
      for (int c = 0; c < 3; ++c) {
        worst = std::max(worst, std::abs(p[c] / p[3] - color[c] / sum));
      }
    }
  }
  EXPECT_LT(worst, 1e-3);
}

TEST(Renderer, MagnifiedPlaneMatchesEquation9) {
  expect_equation_9(jittered_plane(24, 1, 0.35), camera_at(2.2, 96), 1, 4);
  expect_equation_9(jittered_plane(24, 1, 0.35), camera_at(2.2, 96), 4, 4);
}

TEST(Renderer, MinifiedPlaneMatchesEquation9) {
  expect_equation_9(jittered_plane(64, 1, 0.35), camera_at(8, 96, 16), 1, 12);
  expect_equation_9(jittered_plane(64, 1, 0.35), camera_at(30, 48, 6), 2, 14);
}

TEST(Renderer, SumOfKernelsHasTheMeanAndMinimumOfTheTruncation) {
  // The mean is that of a Gaussian cut off at beta = c, 1 - e^-c; the minima were measured on
  // jittered grids, and the default coverage thresholds rest on them.
  const SurfelCloud cloud = jittered_plane(96, 1, 0.35, 3);
  struct Case {
    double cutoff, mean, minimum;
  };
  for (const Case& c : {Case{1, 0.63, 0.39}, Case{2, 0.86, 0.69}, Case{4, 0.98, 0.84}}) {
    RenderOptions options;
    options.cutoff = c.cutoff;
    const Image image = render_unlit(cloud, camera_at(2.2, 256), options);
    double sum = 0;
    float least = 10;
    int count = 0;
    for (int y = 20; y < 236; ++y) {
      for (int x = 20; x < 236; ++x) {
        const float q = image.pixel(x, y)[kSumOfRho];
        sum += q;
        least = std::min(least, q);
        ++count;
      }
    }
    EXPECT_NEAR(sum / count, c.mean, 0.015) << c.cutoff;
    EXPECT_NEAR(least, c.minimum, 0.08) << c.cutoff;
  }
}

TEST(Renderer, PlaneHasTheRightDepthAndNormal) {
  SurfelCloud cloud = jittered_plane(64, 1, 0.35);
  const Eigen::AngleAxisf turn(1.1F, Vec3f::UnitY());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    cloud.position[i] = turn * cloud.position[i];
    cloud.normal[i] = turn * cloud.normal[i];
  }
  const Camera camera = camera_at(3, 128);
  const Image image = render_unlit(cloud, camera);
  int seen = 0;
  for (int y = 0; y < 128; ++y) {
    for (int x = 0; x < 128; ++x) {
      const float* p = image.pixel(x, y);
      if (p[3] < 1) continue;
      ++seen;
      // Where the pixel's ray meets the plane.
      const Vec3d ray((x + 0.5 - 64) / camera.focal_x, (y + 0.5 - 64) / camera.focal_y, 1);
      const Vec3d n = camera.camera_from_world * (turn * Vec3f::UnitZ()).cast<double>();
      const double z = (camera.camera_from_world * -camera.eye).dot(n) / ray.dot(n);
      EXPECT_NEAR(p[kZ], z, 0.004) << x << ", " << y;
      EXPECT_NEAR(p[kZFirst], p[kZ], 1e-6);
      EXPECT_NEAR(p[kNormal], std::sin(1.1), 1e-3);
    }
  }
  EXPECT_GT(seen, 1000);
}

TEST(Renderer, SphereIsClosedAndItsSilhouetteAntialiased) {
  const SurfelCloud cloud = fibonacci_sphere(20000, 1);
  const Camera camera = camera_at(4, 128);
  const Image image = render_unlit(cloud, camera);
  const double radius = camera.focal_x * std::tan(std::asin(1 / 4.0));
  double area = 0;
  int partial = 0;
  for (int y = 0; y < 128; ++y) {
    for (int x = 0; x < 128; ++x) {
      const float alpha = image.pixel(x, y)[3];
      const double r = std::hypot(x + 0.5 - 64, y + 0.5 - 64);
      if (r < radius - 5) {
        EXPECT_NEAR(alpha, 1.0F, 1e-4F) << x << ", " << y;
      } else if (r < radius - 3) {
        EXPECT_GT(alpha, 0.97F) << x << ", " << y;
      }
      if (r > radius + 4) {
        EXPECT_EQ(alpha, 0.0F);
      }
      partial += alpha > 0.02F && alpha < 0.98F;
      area += alpha;
    }
  }
  EXPECT_GT(partial, 2 * M_PI * radius * 0.8);  // About one or two partial pixels along the rim.
  const double rim = area / (M_PI * radius * radius);
  EXPECT_NEAR(rim, 1, 0.07);  // Splats reach beyond the silhouette by a part of a pixel.
}

TEST(Renderer, SameBytesForAnyNumberOfThreads) {
  const SurfelCloud cloud = fibonacci_sphere(30000, 1);
  const Camera camera = camera_at(2.5, 200);
  std::vector<Image> images;
  for (const int threads : {1, 2, 5}) {
    set_thread_count(threads);
    images.push_back(render_unlit(cloud, camera));
  }
  set_thread_count(0);
  EXPECT_EQ(images[0].data, images[1].data);
  EXPECT_EQ(images[0].data, images[2].data);
}

TEST(Renderer, ShuffledInputGivesTheSamePicture) {
  const SurfelCloud cloud = fibonacci_sphere(30000, 1);
  Array<std::uint32_t> order(cloud.size());
  for (std::uint32_t i = 0; i < order.size(); ++i) order[i] = i;
  std::sort(order.begin(), order.end(),
            [](std::uint32_t a, std::uint32_t b) { return random_bits(7, a) < random_bits(7, b); });
  const Camera camera = camera_at(2.5, 200);
  const Image a = render_unlit(cloud, camera);
  const Image b = render_unlit(cloud.gathered(order), camera);
  EXPECT_EQ(a.data, b.data);
}

TEST(Renderer, SmallBatchesGiveTheSamePicture) {
  const SurfelCloud cloud = fibonacci_sphere(30000, 1);
  const Camera camera = camera_at(2.5, 200);
  RenderOptions small;
  small.batch = 1024;
  const Image a = render_unlit(cloud, camera);
  const Image b = render_unlit(cloud, camera, small);
  // Batches are front to back, too, but more coarsely than a tile's list: only at the silhouette,
  // where many surfaces meet in a pixel and are merged, their edges unseen, may that be seen.
  int differ = 0;
  for (std::size_t i = 0; i < a.data.size(); i += 10) {
    float worst = 0;
    for (int c = 0; c < 4; ++c) worst = std::max(worst, std::abs(a.data[i + c] - b.data[i + c]));
    differ += worst > 1 / 255.0F;
    ASSERT_LT(worst, 0.25F);
  }
  EXPECT_LT(differ, 200 * 200 / 200);
}

/// Sum of alpha over the picture: the area that is covered, pixels.
double covered_area(const Image& image) {
  double area = 0;
  for (std::size_t i = 3; i < image.data.size(); i += image.channels.size()) area += image.data[i];
  return area;
}

/// The picture moved by some pixels shows the same, though other pixels are at the borders of
/// tiles.
TEST(Renderer, PicturesDoNotDependOnWhereTilesLie) {
  constexpr int kSize = 200;
  for (const float alpha : {1.0F, 0.5F}) {
    // Splats are smaller than the pixel filter: edges are looked for.
    SurfelCloud cloud = fibonacci_sphere(200000, 0.8);
    cloud.alpha.assign(cloud.size(), alpha);
    const Camera camera = camera_at(2.6, kSize);
    const Image still = render_unlit(cloud, camera);
    for (const auto& [dx, dy] : {std::pair(5, 3), std::pair(1, 8)}) {
      Camera moved = camera;
      moved.center_x += dx;
      moved.center_y += dy;
      const Image image = render_unlit(cloud, moved);
      double worst = 0;
      for (int y = 4; y < kSize - 12; ++y) {
        for (int x = 4; x < kSize - 12; ++x) {
          for (int c = 0; c < 4; ++c) {
            const double difference = still.pixel(x, y)[c] - image.pixel(x + dx, y + dy)[c];
            worst = std::max(worst, std::abs(difference));
          }
        }
      }
      EXPECT_LT(worst, 1e-3) << alpha << " " << dx << " " << dy;
    }
  }
}

TEST(Renderer, SilhouettesAreWhereTheSurfaceEnds) {
  // Of a sphere and of a square, both with samples half a pixel apart: their radius and half side,
  // from the area that is covered, are measured 0.12 to 0.16 and 0.2 to 0.36 pixels too large,
  // where q / tau alone (section 7) makes them 0.37 to 0.73 too large.
  const Camera camera = camera_at(3, 200);
  const double radius = camera.focal_x * std::tan(std::asin(1 / 3.0));
  const double half_side = camera.focal_x / 3;
  const SurfelCloud sphere = fibonacci_sphere(200000, 1);
  const SurfelCloud square = jittered_plane(440, 1, 0.35);
  for (const double cutoff : {1.0, 2.0, 4.0}) {
    RenderOptions options;
    options.cutoff = cutoff;
    const double r = std::sqrt(covered_area(render_unlit(sphere, camera, options)) / M_PI);
    const double s = std::sqrt(covered_area(render_unlit(square, camera, options))) / 2;
    EXPECT_NEAR(r, radius, 0.2) << cutoff;
    EXPECT_NEAR(s, half_side, 0.4) << cutoff;
    options.coverage_threshold = coverage_threshold(cutoff);
    EXPECT_GT(std::sqrt(covered_area(render_unlit(sphere, camera, options)) / M_PI), r + 0.1);
  }
}

TEST(Renderer, TheFarSideOfABodyDoesNotShowAtItsSilhouette) {
  // A sphere whose visible side is red and whose far side is blue: no blue is to be seen, nor is
  // the silhouette to depend on the far side. Unevenness of the samples leaves some of it.
  constexpr double kDistance = 3;
  const Camera camera = camera_at(kDistance, 200);
  const double radius = camera.focal_x * std::tan(std::asin(1 / kDistance));
  const double pixel = (kDistance - 1 / kDistance) / camera.focal_x;  // At the rim, scene units.
  struct Limits {
    double spacing, cutoff;
    double blue;   ///< Summed over the picture, by the pixels along the rim; without care 0.2, 0.5.
    double wider;  ///< Than the visible side alone, in the radius, pixels; without care 0.2 to 0.4.
  };
  for (const Limits& at :
       {Limits{0.5, 1, 0.002, 0.02}, Limits{0.5, 4, 0.02, 0.03}, Limits{2, 1, 0.003, 0.04},
        Limits{2, 2, 0.01, 0.02}, Limits{8, 1, 0.02, 0.1}, Limits{8, 4, 0.2, 0.2}}) {
    SurfelCloud cloud =
        fibonacci_sphere(static_cast<int>(4 * M_PI / std::pow(at.spacing * pixel, 2)), 1);
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      const bool visible = cloud.normal[i].z() > 1 / kDistance;
      cloud.coefficient[i] = visible ? Vec3f(1, 0, 0) : Vec3f(0, 0, 1);
    }
    RenderOptions options;
    options.cutoff = at.cutoff;
    const Image image = render_unlit(cloud, camera, options);
    double blue = 0;
    for (std::size_t i = 2; i < image.data.size(); i += image.channels.size()) {
      blue += image.data[i];
    }
    EXPECT_LT(blue / (2 * M_PI * radius), at.blue) << at.spacing << ' ' << at.cutoff;
    options.cull_back = true;
    const double whole = std::sqrt(covered_area(image) / M_PI);
    const double front = std::sqrt(covered_area(render_unlit(cloud, camera, options)) / M_PI);
    EXPECT_NEAR(whole, front, at.wider) << at.spacing << ' ' << at.cutoff;
  }
}

TEST(Renderer, ABackStaysInFrontOfAFrontThatItHides) {
  // The left half of a sheet that faces away lies before a sheet that faces the eye.
  SurfelCloud cloud;
  const auto add = [&](double z, float side, const Vec3f& color) {
    const SurfelCloud sheet = jittered_plane(300, 2, 0.25, 1, z);
    for (std::size_t i = 0; i < sheet.size(); ++i) {
      if (side < 0 && sheet.position[i].x() > 0) continue;
      add_surfel(cloud, sheet.position[i], Vec3f(0, 0, side), sheet.variance[i], sheet.area[i],
                 color);
    }
  };
  add(0, -1, {1, 0, 0});
  add(-0.5, 1, {0, 1, 0});
  for (const double cutoff : {1.0, 4.0}) {
    RenderOptions options;
    options.cutoff = cutoff;
    const Image image = render_unlit(cloud, camera_at(3, 128), options);
    for (int y = 8; y < 120; ++y) {
      for (int x = 8; x < 120; ++x) {
        const float* p = image.pixel(x, y);
        ASSERT_NEAR(p[3], 1, 1e-3) << x << ' ' << y;
        if (std::abs(x - 64) <= 4) continue;
        ASSERT_NEAR(p[x < 64 ? 0 : 1], 1, 1e-3) << x << ' ' << y;
      }
    }
  }
}

TEST(Renderer, NothingShowsThroughWhereOneSurfaceEndsInFrontOfAnother) {
  // What an edge leaves of a pixel is filled by what lies behind it.
  SurfelCloud cloud = jittered_plane(400, 3, 0.35);
  for (Vec3f& p : cloud.position) p.z() -= 2;
  const SurfelCloud sphere = fibonacci_sphere(60000, 0.7);
  for (std::size_t i = 0; i < sphere.size(); ++i) {
    add_surfel(cloud, sphere.position[i], sphere.normal[i], sphere.variance[i], sphere.area[i],
               sphere.coefficient[i]);
  }
  for (const double cutoff : {1.0, 2.0}) {
    RenderOptions options;
    options.cutoff = cutoff;
    const Image image = render_unlit(cloud, camera_at(3, 200), options);
    for (int y = 10; y < 190; ++y) {
      for (int x = 10; x < 190; ++x) ASSERT_GT(image.pixel(x, y)[3], 0.98F) << x << ' ' << y;
    }
  }
}

TEST(Renderer, SurfacesThatMeetInAPixelShareItByTheirSums) {
  // A step along the column x = 64 that is seen from above: red on the left, green on the right and
  // further away than epsilon. The pixel filter sees as much of either as lies on its side.
  constexpr int kSize = 128;
  constexpr double kPixel = 2.0 / kSize;
  for (const double cutoff : {2.0, 4.0}) {
    SurfelCloud cloud;
    SurfelCloud plane = jittered_plane(2 * kSize, 1, 0.1);
    for (std::size_t i = 0; i < plane.size(); ++i) {
      Vec3f& p = plane.position[i];
      const bool left = p.x() < 0;
      if (!left) p.z() = -static_cast<float>(2.5 * kPixel);
      add_surfel(cloud, p, plane.normal[i], plane.variance[i] / 4, plane.area[i],
                 left ? Vec3f(1, 0, 0) : Vec3f(0, 1, 0));
    }
    RenderOptions options;
    options.cutoff = cutoff;
    const Image image = render_unlit(cloud, square_camera(kSize), options);
    for (int y = 8; y < kSize - 8; ++y) {
      for (int x = kSize / 2 - 6; x < kSize / 2 + 6; ++x) {
        const float* p = image.pixel(x, y);
        ASSERT_NEAR(p[3], 1, 1e-3) << x << ' ' << y;
        const double z = (kSize / 2 - (x + 0.5)) / std::sqrt(1 + 1.0 / 16);
        // The tail of the further side is hidden where the nearer one is whole.
        ASSERT_NEAR(p[0], std::erfc(-z / std::sqrt(2.0)) / 2, 0.08) << x << ' ' << y;
      }
    }
  }
}

TEST(Renderer, FarSidesOfBodiesDoNotShowInFrontOfOtherSurfaces) {
  // The far side, red, reaches beyond the silhouette of the near side, green, before a blue plane.
  SurfelCloud cloud = jittered_plane(400, 3, 0.35);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    cloud.position[i].z() -= 2;
    cloud.coefficient[i] = Vec3f(0, 0, 1);
  }
  const SurfelCloud sphere = fibonacci_sphere(30000, 0.7);
  const Vec3f eye(0, 0, 3);
  for (std::size_t i = 0; i < sphere.size(); ++i) {
    const bool near_side = sphere.normal[i].dot(eye - sphere.position[i]) > 0;
    add_surfel(cloud, sphere.position[i], sphere.normal[i], sphere.variance[i], sphere.area[i],
               near_side ? Vec3f(0, 1, 0) : Vec3f(1, 0, 0));
  }
  for (const double cutoff : {1.0, 2.0, 4.0}) {
    RenderOptions options;
    options.cutoff = cutoff;
    const Image image = render_unlit(cloud, camera_at(3, 200), options);
    float most = 0;
    for (int y = 10; y < 190; ++y) {
      for (int x = 10; x < 190; ++x) most = std::max(most, image.pixel(x, y)[0]);
    }
    EXPECT_LT(most, 0.1F) << cutoff;
  }
}

TEST(Renderer, ThinStripsSeenFromTheBackStayInFrontOfOtherSurfaces) {
  // Half a pixel wide, so that the strip covers no pixel wholly.
  const Camera camera = camera_at(3, 100);
  const auto spacing = static_cast<float>(0.5 * 3 / camera.focal_x);
  SurfelCloud cloud = jittered_plane(300, 3, 0.35);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    cloud.position[i].z() -= 2;
    cloud.coefficient[i] = Vec3f(0, 0, 1);
  }
  for (int i = -100; i <= 100; ++i) {
    add_surfel(cloud, Vec3f(0.2F * spacing, static_cast<float>(i) * spacing, 0), Vec3f(0, 0, -1),
               spacing * spacing / 4, spacing * spacing, Vec3f(1, 0, 0));
  }
  const Image image = render_unlit(cloud, camera);
  constexpr int kRows = 60;
  float red = 0;
  for (int y = 20; y < 20 + kRows; ++y) {
    for (int x = 40; x < 60; ++x) red += image.pixel(x, y)[0];
  }
  EXPECT_NEAR(red, kRows / 2, 0.1 * kRows / 2);
}

TEST(Renderer, InteriorsOfJitteredGridsAreCovered) {
  // What finds edges must not take the unevenness of the sums for one.
  for (const double spacing : {0.5, 1.0, 2.0, 5.0}) {
    const Camera camera = camera_at(3, 128);
    const double half = 100 / camera.focal_x * 3;
    const SurfelCloud cloud = jittered_plane(static_cast<int>(200 / spacing), half, 0.35);
    const Image image = render_unlit(cloud, camera);
    for (int y = 0; y < 128; ++y) {
      for (int x = 0; x < 128; ++x) ASSERT_GT(image.pixel(x, y)[3], 0.99F) << x << ' ' << y;
    }
  }
}

TEST(Renderer, CullingBackFacesLeavesClosedSurfacesAsTheyAre) {
  const SurfelCloud cloud = fibonacci_sphere(30000, 1, {0.2F, 0.5F, 0.9F});
  const Camera camera = camera_at(3, 128);
  RenderOptions cull;
  cull.cull_back = true;
  FrameStatistics all;
  FrameStatistics front;
  const Image a = render_unlit(cloud, camera, {}, &all);
  const Image b = render_unlit(cloud, camera, cull, &front);
  EXPECT_LT(front.splats, all.splats * 6 / 10);
  const double radius = camera.focal_x * std::tan(std::asin(1 / 3.0));
  for (int y = 0; y < 128; ++y) {
    for (int x = 0; x < 128; ++x) {
      const double r = std::hypot(x + 0.5 - 64, y + 0.5 - 64);
      if (r > radius - 2) continue;
      // At edges either side's sums tell the opacity.
      const double tolerance = r > radius - 5 ? 6e-3 : 1e-5;
      for (int c = 0; c < 4; ++c) ASSERT_NEAR(a.pixel(x, y)[c], b.pixel(x, y)[c], tolerance);
    }
  }
}

TEST(RenderOptions, DefaultsAreValidAndBadValuesAreRefused) {
  EXPECT_TRUE(RenderOptions{}.problems().empty());
  const auto refused = [](auto change) {
    RenderOptions options;
    change(options);
    return options.problems().size() == 1;
  };
  EXPECT_TRUE(refused([](RenderOptions& o) { o.cutoff = 0; }));
  EXPECT_TRUE(refused([](RenderOptions& o) { o.cutoff = std::nan(""); }));
  EXPECT_TRUE(refused([](RenderOptions& o) { o.lowpass = -1; }));
  EXPECT_TRUE(refused([](RenderOptions& o) { o.layers = 0; }));
  EXPECT_TRUE(refused([](RenderOptions& o) { o.layers = 65; }));
  EXPECT_TRUE(refused([](RenderOptions& o) { o.depth_epsilon = 0; }));
  EXPECT_TRUE(refused([](RenderOptions& o) { o.depth_epsilon = 1e-300; }));
  EXPECT_TRUE(refused([](RenderOptions& o) { o.coverage_threshold = 0; }));
  EXPECT_TRUE(refused([](RenderOptions& o) { o.coverage_threshold = 1e-300; }));
  EXPECT_TRUE(refused([](RenderOptions& o) { o.coverage_threshold = 1e5; }));
  EXPECT_TRUE(refused([](RenderOptions& o) { o.background[3] = 2; }));
  EXPECT_TRUE(refused([](RenderOptions& o) { o.batch = 1; }));
}

// A Renderer keeps references: temporaries do not bind.
static_assert(std::is_constructible_v<Renderer, RenderCloud&, const Scene&, RenderOptions>);
static_assert(!std::is_constructible_v<Renderer, RenderCloud, const Scene&, RenderOptions>);
static_assert(!std::is_constructible_v<Renderer, RenderCloud&, Scene, RenderOptions>);

TEST(Renderer, ScenesAndCamerasThatCannotBeAreRefused) {
  RenderCloud surfels(fibonacci_sphere(100, 1));
  Scene bare;
  bare.materials.clear();
  EXPECT_THROW(Renderer(surfels, bare, {}), Error);
  const Scene scene;
  Renderer renderer(surfels, scene, {});
  EXPECT_NO_THROW(renderer.render(camera_at(3, 16)));
  for (const Camera& camera : unusable_cameras()) EXPECT_THROW(renderer.render(camera), Error);
}

}  // namespace
}  // namespace surfel::test
