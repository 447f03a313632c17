#include <Eigen/LU>
#include <algorithm>
#include <numbers>
#include <type_traits>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/scene/framing.h>
#include <surfel/surface/coverage_threshold.h>
#include <surfel/truth/source_ewa.h>
#include <surfel/truth/supersample.h>

#include "render/scenes.h"
#include "truth/pictures.h"

namespace surfel::test {
namespace {

Image render_source(const SurfelCloud& cloud, const Camera& camera, RenderOptions options = {}) {
  options.lit = false;
  const RenderCloud surfels(cloud);
  const Scene scene;
  return SourceEwaRenderer(surfels, scene, options).render(camera);
}

/// Options under which alpha is the sum of rho, divided by this.
constexpr double kTau = 1e3;
RenderOptions showing_rho(double cutoff, double lowpass) {
  RenderOptions options;
  options.cutoff = cutoff;
  options.lowpass = lowpass;
  options.coverage_threshold = kTau;
  return options;
}

SurfelCloud single(const Vec3f& position, const Vec3f& normal, float deviation_u,
                   float deviation_v) {
  SurfelCloud cloud;
  add_surfel(cloud, position, normal.normalized(), deviation_u * deviation_u, 0.5F, {1, 1, 1});
  cloud.tangent.push_back(cloud.normal[0].unitOrthogonal());
  cloud.variance_u.push_back(deviation_u * deviation_u);
  cloud.variance_v.push_back(deviation_v * deviation_v);
  return cloud;
}

/// Equation (8) as it is printed, with the inverse of a Jacobian from finite differences.
struct Equation8 {
  double beta, rho;
  double z;  ///< Of the hit.
};
Equation8 equation_8(const SurfelInCamera& surfel, const Camera& camera, double lowpass, double x,
                     double y) {
  const Vec3d bitangent = surfel.normal.cross(surfel.tangent);
  double z = 0;
  const auto plane = [&](double px, double py) -> Vec2d {  // m^-1(x) - u_k
    const Vec3d image((px - camera.center_x) / camera.focal_x,
                      (py - camera.center_y) / camera.focal_y, 1);
    const Vec3d origin = camera.orthographic ? Vec3d(image.x(), image.y(), 0) : Vec3d(0, 0, 0);
    const Vec3d direction = camera.orthographic ? Vec3d(0, 0, 1) : image;
    z = surfel.normal.dot(surfel.position - origin) / surfel.normal.dot(direction);
    const Vec3d offset = origin + z * direction - surfel.position;
    return {surfel.tangent.dot(offset), bitangent.dot(offset)};
  };
  constexpr double kStep = 1e-4;
  Eigen::Matrix2d inverse_J;
  inverse_J << (plane(x + kStep, y) - plane(x - kStep, y)) / (2 * kStep),
      (plane(x, y + kStep) - plane(x, y - kStep)) / (2 * kStep);
  const Eigen::Matrix2d M =
      Eigen::Matrix2d(Vec2d(surfel.variance_u, surfel.variance_v).asDiagonal()) +
      lowpass * lowpass * inverse_J * inverse_J.transpose();
  const Vec2d u = plane(x, y);
  const double beta = 0.5 * u.dot(M.inverse() * u);
  return {beta, surfel.area * std::exp(-beta) / (2 * std::numbers::pi * std::sqrt(M.determinant())),
          z};
}

void expect_equation_8(const SurfelCloud& cloud, const Camera& camera, double cutoff,
                       double lowpass) {
  const Image image = render_source(cloud, camera, showing_rho(cutoff, lowpass));
  const SurfelInCamera surfel = in_camera(cloud, 0, camera);
  int inside = 0;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const Equation8 expected = equation_8(surfel, camera, lowpass, x + 0.5, y + 0.5);
      if (std::abs(expected.beta - cutoff) < 1e-4) continue;
      // Behind the eye there is nothing, and towards the horizon kernels are cut off.
      if (!(expected.z > 0 && expected.z < 1.5 * surfel.position.z())) continue;
      const double rho = expected.beta < cutoff ? expected.rho : 0;
      ASSERT_NEAR(image.pixel(x, y)[3] * kTau, rho, 1e-5 * std::max(1.0, rho)) << x << ", " << y;
      inside += rho > 0;
    }
  }
  EXPECT_GT(inside, 2);
}

TEST(SourceEwa, SplatMatchesEquation8AsPrinted) {
  const Camera camera = camera_at(2, 64);
  for (const double lowpass : {0.5, 1.0, 3.0}) {
    expect_equation_8(single({0.1F, -0.1F, 0}, {0, 0, 1}, 0.1F, 0.1F), camera, 2, lowpass);
    expect_equation_8(single({0.1F, 0, 0}, {0.4F, -0.3F, 1}, 0.2F, 0.05F), camera, 3, lowpass);
    expect_equation_8(single({-0.2F, 0.3F, 0}, {2, 1, 1}, 0.15F, 0.1F), camera, 1, lowpass);
    expect_equation_8(single({0, 0, 0}, {0.1F, 0.2F, 1}, 1e-4F, 1e-4F), camera, 2, lowpass);
    expect_equation_8(single({0.1F, 0, 0}, {0.4F, -0.3F, 1}, 0.2F, 0.05F),
                      orthographic_camera(2, 64), 3, lowpass);
  }
}

TEST(SourceEwa, IsScreenSpaceEwaWhereTheProjectionIsAffine) {
  // Front-on, or seen in parallel, J_x is the same all over the plane: (6) and (8) are equal.
  for (const auto& [cloud, camera] :
       {std::pair(single({0.1F, -0.2F, 0}, {0, 0, 1}, 0.1F, 0.02F), camera_at(2, 64)),
        std::pair(single({0.1F, -0.2F, 0}, {1, 0.5F, 1}, 0.2F, 0.05F),
                  orthographic_camera(2, 64))}) {
    const Image image = render_source(cloud, camera, showing_rho(2, 1));
    const auto kernel = make_ewa_kernel(in_camera(cloud, 0, camera), camera, 1);
    for (int y = 0; y < 64; ++y) {
      for (int x = 0; x < 64; ++x) {
        const Vec2d pixel(x + 0.5, y + 0.5);
        const double beta = kernel->beta(pixel);
        if (std::abs(beta - 2) < 1e-6) continue;
        EXPECT_NEAR(image.pixel(x, y)[3] * kTau, beta < 2 ? kernel->rho(pixel) : 0, 1e-5);
      }
    }
  }
}

TEST(SourceEwa, PlaneFrontOnIsThatOfTheFastRenderer) {
  const SurfelCloud cloud = jittered_plane(48, 1, 0.35);
  for (const double distance : {2.2, 8.0}) {
    const Camera camera = camera_at(distance, 96);
    RenderOptions options;  // Edges as in section 7, without what the fast renderer does to them.
    options.coverage_threshold = coverage_threshold(options.cutoff);
    const double same =
        psnr(render_source(cloud, camera, options), render_unlit(cloud, camera, options));
    RecordProperty("psnr_at_" + std::to_string(distance), std::to_string(same));
    EXPECT_GT(same, 60);
  }
}

/// Eye at the origin that looks along -z.
Camera towards_horizon(int size, double fov) {
  CameraOptions options;
  options.eye = Vec3d(0, 0, 0);
  options.target = Vec3d(0, 0, -1);
  options.fov = fov;
  options.width = options.height = size;
  return make_camera(options, SceneExtent{});
}

/// Disc on the floor 1 below it.
SurfelCloud floor_disc(float z, float deviation) {
  return single({0, -1, z}, {0, 1, 0}, deviation, deviation);
}

TEST(SourceEwa, HorizonHasFiniteAndLocalKernels) {
  const Camera camera = towards_horizon(65, 60);  // The horizon is the middle row.
  const double focal = camera.focal_y;
  const double cutoff = 2;
  for (const float distance : {3.0F, 100.0F, 1e6F, 1e12F}) {
    const Image image =
        render_source(floor_disc(-distance, 0.1F * distance), camera, showing_rho(cutoff, 1));
    double sum = 0;
    for (int y = 0; y < 65; ++y) {
      for (int x = 0; x < 65; ++x) {
        const float alpha = image.pixel(x, y)[3];
        ASSERT_TRUE(std::isfinite(alpha));
        sum += alpha;
        // Within twice the filter's reach of 2 pixels from the projection of the ball, whose radius
        // is 0.2 of its distance, and nothing above the horizon.
        const double row = 32.5 + focal / distance;
        if (y <= 32 || std::hypot(x + 0.5 - 32.5, y + 0.5 - row) > 0.25 * focal + 4) {
          ASSERT_EQ(alpha, 0) << distance << ": " << x << ", " << y;
        }
      }
    }
    if (distance < 1e3F) {
      EXPECT_GT(sum, 0) << distance;
    }
  }
}

TEST(SourceEwa, EdgeOnSurfelsAndEmptyCloudsAreNotSeen) {
  const Image edge_on =
      render_source(single({0, 0, 0}, {0, 1, 0}, 0.1F, 0.1F), camera_at(3, 33), showing_rho(1, 1));
  for (int x = 0; x < 33; ++x) EXPECT_EQ(edge_on.pixel(x, 16)[3], 0);
  const Image empty = render_source({}, camera_at(3, 33));
  EXPECT_EQ(*std::max_element(empty.data.begin(), empty.data.end()), 0);
}

TEST(SourceEwa, SplatsAcrossTheNearPlaneAreCutThere) {
  // The disc reaches behind the eye; pixels below the horizon see it from z > near on.
  Camera camera = towards_horizon(64, 90);
  camera.near = 2;
  RenderOptions options = showing_rho(1, 1);
  options.coverage_threshold = 1e-5;
  const Image image = render_source(floor_disc(0, 10), camera, options);
  for (int y = 34; y < 64; ++y) {
    const double z = 32 / (y + 0.5 - 32);
    if (z > 10) continue;
    EXPECT_EQ(image.pixel(32, y)[3], z > 2 ? 1 : 0) << z;
  }
}

TEST(SourceEwa, CullingTransparencyAndBackgroundAreThoseOfOtherPictures) {
  SurfelCloud cloud;
  add_surfel(cloud, {0, 0, 1}, {0, 0, 1}, 0.09F, 0.09F, {1, 0, 0});
  add_surfel(cloud, {0, 0, 0}, {0, 0, -1}, 0.09F, 0.09F, {0, 1, 0});
  cloud.alpha.assign(2, 0.5F);
  RenderOptions options;
  options.coverage_threshold = 0.01;
  options.background = {0, 0, 1, 1};
  const Image all = render_source(cloud, camera_at(5, 33), options);
  EXPECT_NEAR(all.pixel(16, 16)[0], 0.5, 1e-6);
  EXPECT_NEAR(all.pixel(16, 16)[1], 0.25, 1e-6);
  EXPECT_NEAR(all.pixel(16, 16)[2], 0.25, 1e-6);
  EXPECT_NEAR(all.pixel(16, 16)[3], 1, 1e-6);
  options.cull_back = true;
  EXPECT_NEAR(render_source(cloud, camera_at(5, 33), options).pixel(16, 16)[1], 0, 1e-6);
}

/// Camera and tiny discs for which the pixel filter alone decides on depths: its reach at the
/// discs, scene units.
constexpr double kDiscDistance = 5;
double filter_reach(const Camera& camera) {
  return std::sqrt(2.0) * kDiscDistance / camera.focal_x;
}
void add_tiny(SurfelCloud& cloud, double z, const Vec3f& normal, float area, const Vec3f& color) {
  add_surfel(cloud, Vec3d(0, 0, z).cast<float>(), normal, 1e-8F, area, color);
}

TEST(SourceEwa, SurfacesMixWithinTheFootprintOfTheFilter) {
  const Camera camera = camera_at(kDiscDistance, 33);
  RenderOptions options;
  options.coverage_threshold = 1e-12;
  for (const double share : {0.95, 1.05}) {
    SurfelCloud cloud;
    add_tiny(cloud, 0, {0, 0, 1}, 1e-8F, {1, 0, 0});
    add_tiny(cloud, -share * filter_reach(camera), {0, 0, 1}, 1e-8F, {0, 1, 0});
    const float green = render_source(cloud, camera, options).pixel(16, 16)[1];
    if (share < 1) {
      EXPECT_GT(green, 0.4);
    } else {
      EXPECT_EQ(green, 0);
    }
  }
}

TEST(SourceEwa, DepthOfGrazingPlanesIsClamped) {
  // One pixel to the right the red plane is more than twice as far as its disc. Its depth is
  // clamped to the filter's reach divided by the least cosine, which is within epsilon of the green
  // disc.
  const Camera camera = camera_at(kDiscDistance, 33);
  RenderOptions options;
  options.coverage_threshold = 1e-12;
  options.depth_epsilon = 1.5;
  SurfelCloud cloud;
  add_tiny(cloud, 0, {0, 0, 1}, 1e-8F, {0, 1, 0});
  add_tiny(cloud, 0, Vec3f(0.99875F, 0, 0.05F), 5e-7F, {1, 0, 0});
  EXPECT_GT(render_source(cloud, camera, options).pixel(17, 16)[0], 0.1);
}

TEST(SourceEwa, MinifiedSlantedPlaneStaysOneSurface) {
  // Depths on the plane differ by more than the discs' radii: the filter's footprint is what
  // counts. Two surfaces would show as a coverage below one.
  SurfelCloud cloud = jittered_plane(96, 1, 0.35);
  const Eigen::AngleAxisf turn(1.2F, Vec3f::UnitY());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    cloud.position[i] = turn * cloud.position[i];
    cloud.normal[i] = turn * cloud.normal[i];
    cloud.coefficient[i] = Vec3f(0.2F, 0.4F, 0.8F);
  }
  const Camera camera = camera_at(6, 48, 30);
  const Image image = render_source(cloud, camera);
  for (int y = 20; y < 28; ++y) {
    for (int x = 22; x < 26; ++x) {
      EXPECT_NEAR(image.pixel(x, y)[3], 1, 1e-6) << x << ", " << y;
      EXPECT_NEAR(image.pixel(x, y)[2], 0.8, 1e-5);
    }
  }
}

TEST(SourceEwa, SameBytesForAnyNumberOfThreads) {
  const SurfelCloud cloud = fibonacci_sphere(3000, 1);
  const Camera camera = camera_at(2.5, 64);
  std::vector<Image> images;
  for (const int threads : {1, 2, 5}) {
    set_thread_count(threads);
    images.push_back(render_source(cloud, camera));
  }
  set_thread_count(0);
  EXPECT_EQ(images[0].data, images[1].data);
  EXPECT_EQ(images[0].data, images[2].data);
}

TEST(SourceEwa, BadOptionsAreRefused) {
  RenderOptions options;
  options.lowpass = -1;
  EXPECT_THROW(render_source({}, camera_at(3, 8), options), Error);
}

// A SourceEwaRenderer keeps references: temporaries do not bind.
static_assert(
    std::is_constructible_v<SourceEwaRenderer, const RenderCloud&, const Scene&, RenderOptions>);
static_assert(
    !std::is_constructible_v<SourceEwaRenderer, RenderCloud, const Scene&, RenderOptions>);
static_assert(
    !std::is_constructible_v<SourceEwaRenderer, const RenderCloud&, Scene, RenderOptions>);

TEST(SourceEwa, ScenesAndCamerasThatCannotBeAreRefused) {
  const RenderCloud cloud(fibonacci_sphere(100, 1));
  Scene bare;
  bare.materials.clear();
  EXPECT_THROW(SourceEwaRenderer(cloud, bare, {}), Error);
  const Scene scene;
  const SourceEwaRenderer renderer(cloud, scene, {});
  EXPECT_NO_THROW(renderer.render(camera_at(3, 16)));
  for (const Camera& camera : unusable_cameras()) EXPECT_THROW(renderer.render(camera), Error);
}

}  // namespace
}  // namespace surfel::test
