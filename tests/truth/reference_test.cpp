#include <Eigen/Geometry>
#include <algorithm>
#include <numbers>
#include <type_traits>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/scene/framing.h>
#include <surfel/truth/disc_hierarchy.h>
#include <surfel/truth/reference.h>
#include <surfel/truth/supersample.h>

#include "render/scenes.h"
#include "truth/pictures.h"

namespace surfel::test {
namespace {

/// Options with which a picture shows single rays: one through each pixel's centre, filtered with
/// itself alone, unlit.
RenderOptions single_rays(double cutoff = 1) {
  RenderOptions options;
  options.cutoff = cutoff;
  options.lowpass = 0.1;
  options.lit = false;
  return options;
}

Image render_reference(const SurfelCloud& cloud, const Camera& camera, const RenderOptions& options,
                       int samples, const Scene& scene = {}) {
  const RenderCloud surfels(cloud);
  return ReferenceRenderer(surfels, scene, options, {samples}).render(camera);
}

/// Where the ray of a picture's coordinates meets the plane through `point`, world coordinates.
Vec3d on_plane(const Camera& camera, double x, double y, const Vec3d& point, const Vec3d& normal) {
  const ViewRay ray = view_ray(camera, x, y);
  const Vec3d from = camera.eye + ray.origin;
  return from + normal.dot(point - from) / normal.dot(ray.direction) * ray.direction;
}

double sum_of_alpha(const Image& image) {
  double sum = 0;
  for (std::size_t i = 3; i < image.data.size(); i += 4) sum += image.data[i];
  return sum;
}

void expect_color(const Image& image, int x, int y, const Rgba& expected, double tolerance) {
  const float* p = image.pixel(x, y);
  EXPECT_NEAR(p[0], expected.red, tolerance);
  EXPECT_NEAR(p[1], expected.green, tolerance);
  EXPECT_NEAR(p[2], expected.blue, tolerance);
  EXPECT_NEAR(p[3], expected.alpha, tolerance);
}

const Vec3f kRedColor(1, 0, 0);
const Vec3f kGreenColor(0, 1, 0);
const Vec3f kTowardsEye(0, 0, 1);

TEST(Reference, DiscFrontOnCoversItsArea) {
  SurfelCloud cloud;
  const double variance = 0.02;
  add_surfel(cloud, {0.1F, -0.05F, 0}, kTowardsEye, static_cast<float>(variance), 1, {1, 1, 1});
  RenderOptions options = single_rays();
  options.coverage_threshold = 1e-6;  // Covered wherever the kernel reaches.
  options.lowpass = 1;
  for (const double cutoff : {1.0, 3.0}) {
    options.cutoff = cutoff;
    const double disc = std::numbers::pi * 2 * cutoff * variance;
    const Camera camera = camera_at(3, 48);
    const double pixels = disc * std::pow(camera.focal_x / 3, 2);
    EXPECT_NEAR(sum_of_alpha(render_reference(cloud, camera, options, 16)) / pixels, 1, 1e-3);
    const Camera parallel = orthographic_camera(2, 48);
    const double parallel_pixels = disc * std::pow(parallel.focal_x, 2);
    EXPECT_NEAR(sum_of_alpha(render_reference(cloud, parallel, options, 16)) / parallel_pixels, 1,
                1e-3);
  }
}

TEST(Reference, AnisotropicDiscIsAnEllipseAlongItsTangent) {
  SurfelCloud cloud;
  const Vec3f normal = Vec3f(0, 0.6F, 0.8F);
  add_surfel(cloud, {0, 0, 0}, normal, 1, 0.5F, {1, 1, 1});
  const Vec3d tangent(0.6, 0.64, -0.48);
  cloud.tangent.push_back(tangent.cast<float>());
  cloud.variance_u.push_back(0.04F);
  cloud.variance_v.push_back(0.0025F);
  RenderOptions options = single_rays(2);
  options.coverage_threshold = 1e3;  // Alpha is the sum of r / tau.
  const Camera camera = camera_at(3, 65);
  const Image image = render_reference(cloud, camera, options, 1);
  int inside = 0;
  for (int y = 0; y < 65; ++y) {
    for (int x = 0; x < 65; ++x) {
      const Vec3d q = on_plane(camera, x + 0.5, y + 0.5, Vec3d(0, 0, 0), normal.cast<double>());
      const double u = tangent.dot(q) / 0.2;
      const double v = normal.cast<double>().cross(tangent).dot(q) / 0.05;
      const double beta = 0.5 * (u * u + v * v);
      if (std::abs(beta - 2) < 1e-4) continue;
      const double r = 0.5 * std::exp(-beta) / (2 * std::numbers::pi * 0.2 * 0.05);
      EXPECT_NEAR(image.pixel(x, y)[3], beta < 2 ? r / 1e3 : 0, 1e-8) << x << ", " << y;
      inside += beta < 2;
    }
  }
  EXPECT_GT(inside, 80);
}

TEST(Reference, CoverageIsTheSumOfKernelsOverTheThreshold) {
  SurfelCloud cloud;
  for (int i = 0; i < 3; ++i) add_surfel(cloud, {0, 0, 0}, kTowardsEye, 0.09F, 0.2F, {1, 1, 1});
  RenderOptions options = single_rays();
  options.coverage_threshold = 2;
  const Image image = render_reference(cloud, camera_at(3, 33), options, 1);
  EXPECT_NEAR(image.pixel(16, 16)[3], 3 * 0.2 / (2 * std::numbers::pi * 0.09) / 2, 1e-6);
  EXPECT_EQ(image.pixel(0, 0)[3], 0);
}

TEST(Reference, PlaneOfOneColorIsThatColorAndOpaque) {
  SurfelCloud cloud = jittered_plane(40, 1, 0.35);
  std::fill(cloud.coefficient.begin(), cloud.coefficient.end(), Vec3f(0.2F, 0.5F, 0.9F));
  RenderOptions options;
  options.lit = false;
  const Image image = render_reference(cloud, camera_at(2, 48), options, 4);
  for (int y = 0; y < 48; ++y) {
    for (int x = 0; x < 48; ++x) expect_color(image, x, y, {0.2F, 0.5F, 0.9F, 1}, 1e-5);
  }
}

TEST(Reference, OverlappingDiscsAreTheirWeightedMean) {
  SurfelCloud cloud;
  add_surfel(cloud, {-0.1F, 0, 0}, kTowardsEye, 0.04F, 0.04F, kRedColor);
  add_surfel(cloud, {0.15F, 0.1F, 0}, kTowardsEye, 0.09F, 0.05F, kGreenColor);
  RenderOptions options = single_rays();
  options.coverage_threshold = 1e-6;
  const Camera camera = camera_at(3, 64);
  const Image image = render_reference(cloud, camera, options, 1);
  int both = 0;
  for (int y = 0; y < 64; ++y) {
    for (int x = 0; x < 64; ++x) {
      const Vec3d q = on_plane(camera, x + 0.5, y + 0.5, Vec3d(0, 0, 0), Vec3d(0, 0, 1));
      const double beta_red = (q - cloud.world(0)).squaredNorm() / (2 * 0.04);
      const double beta_green = (q - cloud.world(1)).squaredNorm() / (2 * 0.09);
      if (beta_red > 0.999 || beta_green > 0.999) continue;
      const double red = std::exp(-beta_red);  // area / V = 1
      const double green = 0.05 / 0.09 * std::exp(-beta_green);
      expect_color(image, x, y,
                   {static_cast<float>(red / (red + green)),
                    static_cast<float>(green / (red + green)), 0, 1},
                   1e-5);
      ++both;
    }
  }
  EXPECT_GT(both, 20);
}

/// Red disc in front of a green one of the same size, `distance` apart; the middle pixel.
Rgba middle_of_two(double distance, const RenderOptions& options, float alpha = 1,
                   const Vec3f& normal_behind = kTowardsEye, const Scene& scene = {}) {
  SurfelCloud cloud;
  add_surfel(cloud, Vec3d(0, 0, distance).cast<float>(), kTowardsEye, 0.09F, 0.09F, kRedColor);
  add_surfel(cloud, {0, 0, 0}, normal_behind, 0.09F, 0.09F, kGreenColor);
  cloud.alpha.assign(2, alpha);
  const Image image = render_reference(cloud, camera_at(5, 33), options, 1, scene);
  const float* p = image.pixel(16, 16);
  return {p[0], p[1], p[2], p[3]};
}

TEST(Reference, SurfacesMixOnlyWithinEpsilonOfEachOther) {
  RenderOptions options = single_rays();
  options.coverage_threshold = 0.01;
  const double reach = std::sqrt(2.0) * 0.3;
  for (const double epsilon : {0.5, 1.0}) {
    options.depth_epsilon = epsilon;
    const Rgba close = middle_of_two(0.98 * epsilon * reach, options);
    EXPECT_NEAR(close.red, 0.5, 1e-6);
    EXPECT_NEAR(close.green, 0.5, 1e-6);
    const Rgba apart = middle_of_two(1.02 * epsilon * reach, options);
    EXPECT_NEAR(apart.red, 1, 1e-6);
    EXPECT_NEAR(apart.green, 0, 1e-6);
  }
}

TEST(Reference, SurfacesAreSeparatedFrontToBack) {
  // Each is within epsilon of the next one, and the last one not of the first two's mean.
  SurfelCloud cloud;
  const double reach = std::sqrt(2.0) * 0.3;
  for (const double distance : {0.0, 1.8, 0.9}) {
    const Vec3f color(distance == 0 ? 1 : 0, distance == 0.9 ? 1 : 0, distance == 1.8 ? 1 : 0);
    add_surfel(cloud, Vec3d(0, 0, -distance * reach).cast<float>(), kTowardsEye, 0.09F, 0.09F,
               color);
  }
  RenderOptions options = single_rays();
  options.coverage_threshold = 0.01;
  const Image image = render_reference(cloud, camera_at(5, 33), options, 1);
  expect_color(image, 16, 16, {0.5F, 0.5F, 0, 1}, 1e-6);
}

TEST(Reference, SidesOfASurfaceDoNotMix) {
  RenderOptions options = single_rays();
  options.coverage_threshold = 0.01;
  const Rgba sides = middle_of_two(0.01, options, 1, -kTowardsEye);
  EXPECT_NEAR(sides.red, 1, 1e-6);
  EXPECT_NEAR(sides.green, 0, 1e-6);
}

TEST(Reference, CullingLeavesOutBackFaces) {
  SurfelCloud cloud;
  add_surfel(cloud, {0, 0, 0}, -kTowardsEye, 0.09F, 0.09F, kGreenColor);
  RenderOptions options = single_rays();
  options.coverage_threshold = 0.01;
  EXPECT_NEAR(render_reference(cloud, camera_at(5, 9), options, 1).pixel(4, 4)[3], 1, 1e-6);
  options.cull_back = true;
  EXPECT_EQ(render_reference(cloud, camera_at(5, 9), options, 1).pixel(4, 4)[3], 0);
}

TEST(Reference, TransparentSurfacesAreCompositedFrontToBack) {
  RenderOptions options = single_rays();
  options.coverage_threshold = 0.01;
  const Rgba half = middle_of_two(1, options, 0.5F);
  EXPECT_NEAR(half.red, 0.5, 1e-6);
  EXPECT_NEAR(half.green, 0.25, 1e-6);
  EXPECT_NEAR(half.alpha, 0.75, 1e-6);

  Scene scene;
  scene.materials[0].opacity = 0.5F;
  options.background = {0, 0, 1, 0.5F};
  const Rgba quarter = middle_of_two(1, options, 0.5F, kTowardsEye, scene);
  EXPECT_NEAR(quarter.red, 0.25, 1e-6);
  EXPECT_NEAR(quarter.green, 0.75 * 0.25, 1e-6);
  EXPECT_NEAR(quarter.blue, 0.75 * 0.75 * 0.5, 1e-6);
  EXPECT_NEAR(quarter.alpha, 1 - 0.75 * 0.75 * 0.5, 1e-6);
}

TEST(Reference, SurfacesBeyondTheLayersOfTheFastRendererAreKept) {
  SurfelCloud cloud;
  for (int i = 0; i < 80; ++i) {
    add_surfel(cloud, {0, 0, -static_cast<float>(i)}, kTowardsEye, 0.01F, 0.01F, {1, 1, 1});
    cloud.alpha.push_back(0.01F);
  }
  RenderOptions options = single_rays();
  options.coverage_threshold = 0.01;
  EXPECT_NEAR(render_reference(cloud, camera_at(5, 9), options, 1).pixel(4, 4)[3],
              1 - std::pow(0.99, 80), 1e-5);
}

TEST(Reference, UnknownNormalFacesTheEye) {
  const Vec3f place(0.6F, -0.4F, 0.2F);
  const RenderOptions options = single_rays();
  for (const Camera& camera : {camera_at(3, 64), orthographic_camera(3, 64)}) {
    const Vec3d to_eye =
        camera.orthographic ? Vec3d(0, 0, 1) : Vec3d(camera.eye - place.cast<double>());
    SurfelCloud unknown;
    add_surfel(unknown, place, {0, 0, 0}, 0.04F, 0.04F, {1, 1, 1});
    SurfelCloud known;
    add_surfel(known, place, to_eye.normalized().cast<float>(), 0.04F, 0.04F, {1, 1, 1});
    const Image a = render_reference(unknown, camera, options, 4);
    EXPECT_GT(sum_of_alpha(a), 10);
    EXPECT_GT(psnr(a, render_reference(known, camera, options, 4)), 80);
  }
}

TEST(Reference, NothingIsSeenBeforeTheNearPlane) {
  // A floor 1 below the eye, one disc so large that it reaches far behind the eye.
  SurfelCloud cloud;
  add_surfel(cloud, {0, -1, 0}, {0, 1, 0}, 100, 100, {1, 1, 1});
  RenderOptions options = single_rays();
  options.coverage_threshold = 1e-3;
  Camera camera = camera_at(0.5, 64, 90);
  for (const double near : {0.0, 2.0}) {
    camera.near = near;
    const Image image = render_reference(cloud, camera, options, 1);
    for (int y = 0; y < 64; ++y) {
      // The pixel's ray falls by (y + 1/2 - 32) / 32 per unit of depth.
      const double z = 32 / (y + 0.5 - 32);
      const bool on_disc = std::hypot(0.5 - z, z / 64) < std::sqrt(200);
      EXPECT_EQ(image.pixel(32, y)[3], z > near && on_disc ? 1 : 0) << y << " " << z;
    }
  }
}

TEST(Reference, EdgeOnDiscsAndEmptyCloudsAreNotSeen) {
  SurfelCloud cloud;
  add_surfel(cloud, {0, 0, 0}, {0, 1, 0}, 0.1F, 0.1F, {1, 1, 1});
  EXPECT_EQ(sum_of_alpha(render_reference(cloud, camera_at(3, 33), single_rays(), 1)), 0);
  EXPECT_EQ(sum_of_alpha(render_reference({}, camera_at(3, 33), single_rays(), 1)), 0);
}

TEST(Reference, SamplesAreShadedAtTheirOwnPlaces) {
  // A point light so near that its cosine changes within a pixel.
  SurfelCloud cloud;
  add_surfel(cloud, {0, 0, 0}, kTowardsEye, 10, 10, {1, 1, 1});
  Scene scene;
  scene.ambient.setZero();
  scene.lights = {{Light::Type::kPoint, {0, 0, 0.05}, {1, 1, 1}}};
  RenderOptions options;
  options.coverage_threshold = 1e-3;
  options.lowpass = 0.1;
  const Camera camera = camera_at(3, 32);
  const Image image = render_reference(cloud, camera, options, 16, scene);
  // The mean of Lambert's cosines over the pixel's filter.
  double expected = 0;
  double sum = 0;
  for (int j = -6; j < 6; ++j) {
    for (int i = -6; i < 6; ++i) {
      const Vec2d offset((i + 0.5) / 16, (j + 0.5) / 16);
      const double weight = std::exp(-0.5 * offset.squaredNorm() / 0.01);
      const Vec3d q =
          on_plane(camera, 16.5 + offset.x(), 16.5 + offset.y(), Vec3d(0, 0, 0), Vec3d(0, 0, 1));
      const Vec3d to_light = Vec3d(0, 0, 0.05) - q;
      expected += weight * to_light.normalized().z();
      sum += weight;
    }
  }
  EXPECT_NEAR(image.pixel(16, 16)[0], expected / sum, 1e-4);
}

TEST(Reference, SameBytesForAnyNumberOfThreads) {
  SurfelCloud cloud = fibonacci_sphere(3000, 1);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    cloud.coefficient[i].x() = static_cast<float>(random_uniform(1, i, 0));
  }
  const Camera camera = camera_at(2.5, 40);
  std::vector<Image> images;
  for (const int threads : {1, 2, 5}) {
    set_thread_count(threads);
    images.push_back(render_reference(cloud, camera, {}, 4));
  }
  set_thread_count(0);
  EXPECT_GT(sum_of_alpha(images[0]), 300);
  EXPECT_EQ(images[0].data, images[1].data);
  EXPECT_EQ(images[0].data, images[2].data);
}

SurfelCloud colorful_sphere() {
  SurfelCloud cloud = fibonacci_sphere(1000, 1);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    for (std::uint64_t c = 0; c < 3; ++c) {
      cloud.coefficient[i][static_cast<int>(c)] = static_cast<float>(random_uniform(5, i, c));
    }
  }
  return cloud;
}

TEST(Reference, ConvergesWithTheSamples) {
  RenderOptions options;
  options.lit = false;
  struct Case {
    std::string name;
    SurfelCloud cloud;
    Camera camera;
  };
  for (const Case& c : {Case{"plane", jittered_plane(12, 1, 0.35), camera_at(3.5, 24)},
                        Case{"sphere", colorful_sphere(), camera_at(3.4, 24)}}) {
    std::vector<Image> images;
    for (const int samples : {4, 8, 16, 32}) {
      images.push_back(render_reference(c.cloud, c.camera, options, samples));
    }
    const double coarse = psnr(images[0], images[1]);
    const double middle = psnr(images[1], images[2]);
    const double fine = psnr(images[2], images[3]);
    RecordProperty(c.name + "_4_8", std::to_string(coarse));
    RecordProperty(c.name + "_8_16", std::to_string(middle));
    RecordProperty(c.name + "_16_32", std::to_string(fine));
    EXPECT_GT(coarse, 40);
    EXPECT_GT(middle, coarse);
    EXPECT_GT(fine, middle);
    EXPECT_GT(fine, 60);  // A sixteenth of a pixel is as good as infinitely fine.
  }
}

TEST(Reference, BadOptionsAreRefused) {
  EXPECT_TRUE(ReferenceOptions{}.problems().empty());
  EXPECT_EQ(ReferenceOptions{0}.problems().size(), 1U);
  EXPECT_EQ(ReferenceOptions{65}.problems().size(), 1U);
  const RenderCloud cloud{SurfelCloud{}};
  const Scene scene;
  EXPECT_THROW(ReferenceRenderer(cloud, scene, {}, {0}), Error);
  RenderOptions options;
  options.cutoff = -1;
  EXPECT_THROW(ReferenceRenderer(cloud, scene, options, {}), Error);
}

/// Surfels of all kinds at random: sizes over two decades, a tenth of the normals unknown.
RenderCloud random_cloud(std::size_t count, bool anisotropic) {
  SurfelCloud cloud;
  const auto uniform = [](std::size_t i, std::uint64_t dimension) {
    return static_cast<float>(2 * random_uniform(11, i, dimension) - 1);
  };
  for (std::size_t i = 0; i < count; ++i) {
    const Vec3f normal = i % 10 == 0
                             ? Vec3f(0, 0, 0)
                             : Vec3f(uniform(i, 3), uniform(i, 4), uniform(i, 5)).normalized();
    const float deviation = 0.1F * std::pow(10.0F, uniform(i, 6) - 1);
    add_surfel(cloud, {uniform(i, 0), uniform(i, 1), uniform(i, 2)}, normal, deviation * deviation,
               1, {1, 1, 1});
    if (anisotropic) {
      cloud.tangent.push_back(normal.isZero() ? Vec3f(1, 0, 0) : Vec3f(normal.unitOrthogonal()));
      cloud.variance_u.push_back(deviation * deviation);
      cloud.variance_v.push_back(0.01F * deviation * deviation);
    }
  }
  return RenderCloud(cloud);
}

TEST(DiscHierarchy, FindsWhatBruteForceFinds) {
  constexpr std::size_t kCount = 2000;
  const double reach = 1.5;
  for (const bool anisotropic : {false, true}) {
    const RenderCloud cloud = random_cloud(kCount, anisotropic);
    const DiscHierarchy hierarchy(cloud, reach, DiscHierarchy::Bound::kDisc);
    std::size_t hits = 0;
    std::size_t visits = 0;
    for (std::uint64_t k = 0; k < 2000; ++k) {
      const auto uniform = [&](std::uint64_t d) { return 2 * random_uniform(13, k, d) - 1; };
      // From inside and outside, some along an axis.
      const Vec3d origin = 2 * Vec3d(uniform(0), uniform(1), uniform(2));
      const Vec3d direction = k % 5 == 0
                                  ? Vec3d(Vec3d::Unit(static_cast<int>(k / 5 % 3)) * -origin.sum())
                                  : Vec3d(0.5 * Vec3d(uniform(3), uniform(4), uniform(5)) - origin);
      std::vector<int> visited(kCount, 0);
      hierarchy.for_each({origin, direction, 0, 0}, [&](std::uint32_t i) { ++visited[i]; });
      for (std::size_t i = 0; i < kCount; ++i) {
        ASSERT_LE(visited[i], 1);
        visits += static_cast<std::size_t>(visited[i]);
        const Vec3d center(cloud.x[i], cloud.y[i], cloud.z[i]);
        Vec3d normal(cloud.normal_x[i], cloud.normal_y[i], cloud.normal_z[i]);
        if (normal.isZero()) normal = (origin - center).normalized();
        const double t = normal.dot(center - origin) / normal.dot(direction);
        const Vec3d offset = origin + t * direction - center;
        double u = offset.norm();
        double v = 0;
        if (anisotropic && cloud.normal_x[i] != 0) {
          const Vec3d tangent(cloud.tangent_x[i], cloud.tangent_y[i], cloud.tangent_z[i]);
          u = tangent.dot(offset);
          v = normal.cross(tangent).dot(offset) / cloud.deviation_v[i] * cloud.deviation_u[i];
        }
        if (!(t > 0 && std::hypot(u, v) < reach * cloud.deviation_u[i])) continue;
        ++hits;
        EXPECT_EQ(visited[i], 1) << "ray " << k << ", surfel " << i;
      }
    }
    EXPECT_GT(hits, 500U);
    EXPECT_LT(visits, 2000 * kCount / 10);  // It is no brute force itself.
  }
}

TEST(DiscHierarchy, FindsAllBallsThatABeamMeets) {
  constexpr std::size_t kCount = 2000;
  const RenderCloud cloud = random_cloud(kCount, false);
  const DiscHierarchy hierarchy(cloud, 1.5, DiscHierarchy::Bound::kBall);
  std::size_t hits = 0;
  std::size_t visits = 0;
  for (std::uint64_t k = 0; k < 300; ++k) {
    const auto uniform = [&](std::uint64_t d) { return 2 * random_uniform(17, k, d) - 1; };
    const Beam beam{2 * Vec3d(uniform(0), uniform(1), uniform(2)),
                    Vec3d(uniform(3), uniform(4), uniform(5)), k % 3 == 0 ? 0 : 0.05,
                    k % 2 == 0 ? 0 : 0.05};
    std::vector<int> visited(kCount, 0);
    hierarchy.for_each(beam, [&](std::uint32_t i) { ++visited[i]; });
    for (std::size_t i = 0; i < kCount; ++i) {
      ASSERT_LE(visited[i], 1);
      visits += static_cast<std::size_t>(visited[i]);
      const Vec3d offset = Vec3d(cloud.x[i], cloud.y[i], cloud.z[i]) - beam.origin;
      const double t = std::max(0.0, offset.dot(beam.direction) / beam.direction.squaredNorm());
      const double distance = (offset - t * beam.direction).norm();
      if (distance > 1.5 * cloud.deviation_u[i] + beam.radius + t * beam.spread) continue;
      ++hits;
      EXPECT_EQ(visited[i], 1) << "beam " << k << ", surfel " << i;
    }
  }
  EXPECT_GT(hits, 300U);
  EXPECT_LT(visits, 300 * kCount / 10);
}

// A ReferenceRenderer keeps references: temporaries do not bind.
static_assert(
    std::is_constructible_v<ReferenceRenderer, const RenderCloud&, const Scene&, RenderOptions>);
static_assert(
    !std::is_constructible_v<ReferenceRenderer, RenderCloud, const Scene&, RenderOptions>);
static_assert(
    !std::is_constructible_v<ReferenceRenderer, const RenderCloud&, Scene, RenderOptions>);

TEST(Reference, ScenesAndCamerasThatCannotBeAreRefused) {
  const RenderCloud cloud(fibonacci_sphere(100, 1));
  Scene bare;
  bare.materials.clear();
  EXPECT_THROW(ReferenceRenderer(cloud, bare, {}), Error);
  const Scene scene;
  const ReferenceRenderer renderer(cloud, scene, {});
  EXPECT_NO_THROW(renderer.render(camera_at(3, 16)));
  for (const Camera& camera : unusable_cameras()) EXPECT_THROW(renderer.render(camera), Error);
}

TEST(DiscHierarchy, OneDiscFarAwayHidesNoOther) {
  // Rounding in units of the far disc's place would let a beam meet all discs.
  SurfelCloud cloud = fibonacci_sphere(20000, 1);
  cloud.position.back() = {1e15F, 0, 0};
  const RenderCloud surfels(cloud);
  for (const auto bound : {DiscHierarchy::Bound::kDisc, DiscHierarchy::Bound::kBall}) {
    const DiscHierarchy hierarchy(surfels, 1.5, bound);
    std::size_t met = 0;
    hierarchy.for_each({.origin = {0.3, 0.2, 5}, .direction = {0, 0, -1}},
                       [&](std::uint32_t) { ++met; });
    EXPECT_GE(met, 2U);
    EXPECT_LE(met, 100U);
  }
}

}  // namespace
}  // namespace surfel::test
