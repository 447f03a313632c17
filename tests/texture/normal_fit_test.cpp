#include <cmath>
#include <limits>
#include <numbers>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/texture/normal_fit.h>

#include "relief_support.h"
#include "support/message_of.h"
#include "support/test_data.h"
#include "texture_support.h"

namespace surfel::test {
namespace {

constexpr int kTexels = 256;
constexpr double kAmplitude = 0.02;  ///< Of the sine, scene units.

/// Phase of a sine that has eight periods in the image.
double phase(double u) { return 8 * 2 * std::numbers::pi * u; }
double phase_of_texel(int x) { return phase((x + 0.5) / kTexels); }

NormalMaps sine_heights(const std::string& path, double amplitude = kAmplitude) {
  write_relief(path, kTexels, kTexels, true,
               [](int x, int) { return Vec3d(0.5 + 0.5 * std::sin(phase_of_texel(x)), 0, 0); });
  return load_normal_maps({.bump = path, .bump_scale = 2 * amplitude}, nullptr, "");
}

TEST(FitNormals, SineBumpHasTheNormalsOfTheSine) {
  const TemporaryFolder folder;
  NormalMaps maps = sine_heights(folder / "h.pgm");
  SurfelCloud cloud = relief_plane(40, 1e-4F);
  const NormalFitReport report = fit_normals(cloud, maps, {.reconstruction = 0.5});
  EXPECT_EQ(report.mapped, cloud.size());
  ASSERT_EQ(cloud.shading_normal.size(), cloud.size());
  // Differences of two texels and a kernel of half a texel take 2.7 % of a period of 32 texels.
  for (std::size_t k = 0; k < cloud.size(); ++k) {
    const double slope =
        kAmplitude * phase(1) * std::cos(phase(static_cast<double>(cloud.uv[k].x())));
    const Vec3f truth = Vec3d(-slope, 0, 1).normalized().cast<float>();
    EXPECT_LT((cloud.shading_normal[k].normalized() - truth).norm(), 0.025) << k;
    EXPECT_EQ(cloud.normal[k], Vec3f(0, 0, 1));
  }
}

TEST(FitNormals, KernelsWiderThanTheReliefAreFlatAndRough) {
  const TemporaryFolder folder;
  const double slope = kAmplitude * phase(1);
  // Mean of the unit normals over a period, by the midpoint rule.
  double truth = 0;
  for (int i = 0; i < 1000; ++i) {
    truth += 1 / std::hypot(1, slope * std::cos(2 * std::numbers::pi * i / 1000)) / 1000;
  }
  const auto expect_flat = [&](NormalMaps maps, double tolerance) {
    SurfelCloud cloud = relief_plane(6, 0.2F);
    const NormalFitReport report = fit_normals(cloud, maps, {});
    for (const Vec3f& n : cloud.shading_normal) {
      EXPECT_LT(n.head<2>().norm(), 1e-3);
      EXPECT_NEAR(n.z(), truth, tolerance);
    }
    EXPECT_NEAR(report.mean_variance, -std::log(truth), 2 * tolerance);
  };
  // Slopes of a sine, which are no Gaussian.
  expect_flat(sine_heights(folder / "h.pgm"), 0.035);
  const std::string normals = folder / "n.ppm";
  write_relief(normals, kTexels, 1, false, [&](int x, int) {
    return normal_code(Vec3d(-slope * std::cos(phase_of_texel(x)), 0, 1).normalized());
  });
  expect_flat(load_normal_maps({.normal_map = normals}, nullptr, ""), 1e-3);
}

TEST(FitNormals, AConstantTiltLosesNoLengthAtAnySize) {
  const TemporaryFolder folder;
  const std::string path = folder / "n.ppm";
  const Vec3d tilt = Vec3d(0.3, 0.4, 0.8).normalized();
  write_relief(path, 16, 16, false, [&](int, int) { return normal_code(tilt); });
  NormalMaps maps = load_normal_maps({.normal_map = path}, nullptr, "");
  for (const float sigma : {1e-4F, 0.05F, 1.0F}) {
    SurfelCloud cloud = relief_plane(5, sigma);
    // Mirrored in one half, by derivatives that are not perpendicular.
    for (std::size_t k = 0; k < 10; ++k) cloud.dpdu[k] = Vec3f(-1, 0, 0);
    for (std::size_t k = 0; k < 10; ++k) cloud.dpdv[k] = Vec3f(0.5F, 1, 0);
    fit_normals(cloud, maps, {});
    for (std::size_t k = 0; k < cloud.size(); ++k) {
      const Vec3f truth = Vec3d(k < 10 ? -tilt.x() : tilt.x(), tilt.y(), tilt.z()).cast<float>();
      EXPECT_LT((cloud.shading_normal[k] - truth).norm(), 1e-4F) << k;
    }
  }
}

TEST(FitNormals, KernelsStayOnTheirChart) {
  const TemporaryFolder folder;
  const std::string path = folder / "n.ppm";
  const Vec3d left(-0.6, 0, 0.8);
  const Vec3d right(0, 0.6, 0.8);
  write_relief(path, 64, 64, false, [&](int x, int) { return normal_code(x < 32 ? left : right); });
  const TriangleMesh mesh = test::two_charts();
  const auto worst = [&](const TriangleMesh* charts) {
    NormalMaps maps = load_normal_maps({.normal_map = path}, charts, "");
    SurfelCloud cloud = relief_plane(16, 0.05F);
    fit_normals(cloud, maps, {});
    float most = 0;
    for (std::size_t k = 0; k < cloud.size(); ++k) {
      const Vec3d& truth = cloud.uv[k].x() < 0.5F ? left : right;
      most = std::max(most, (cloud.shading_normal[k] - truth.cast<float>()).norm());
    }
    return most;
  };
  EXPECT_LT(worst(&mesh), 1e-3F);
  EXPECT_GT(worst(nullptr), 0.2F);
}

TEST(FitNormals, KeepsAllElseAndLeavesOutWhatHasNoPlaceInTheImage) {
  const TemporaryFolder folder;
  NormalMaps maps = sine_heights(folder / "h.pgm");
  SurfelCloud cloud = relief_plane(4, 0.01F);
  cloud.coefficient.assign(cloud.size(), Vec3f(1, 2, 3));
  cloud.basis_cutoff = 2;
  cloud.uv[3].x() = std::numeric_limits<float>::quiet_NaN();
  cloud.normal[4].setZero();
  cloud.dpdu[5].setZero();
  const NormalFitReport report = fit_normals(cloud, maps, {});
  EXPECT_EQ(report.mapped, cloud.size() - 3);
  EXPECT_EQ(report.without_frame, 3U);
  for (const std::size_t k : {3, 4, 5}) EXPECT_TRUE(cloud.shading_normal[k].isZero()) << k;
  EXPECT_EQ(cloud.coefficient[0], Vec3f(1, 2, 3));
  EXPECT_EQ(cloud.coefficient.size(), cloud.size());
  EXPECT_EQ(cloud.basis_cutoff, 2);
}

TEST(FitNormals, MaterialsWithoutAMapKeepTheirNormals) {
  const TemporaryFolder folder;
  TriangleMesh mesh;
  mesh.position = {Vec3f(0, 0, 0), Vec3f(1, 0, 0), Vec3f(0, 1, 0)};
  mesh.face = {{0, 1, 2}};
  mesh.wedge_uv = {{Vec2f(0, 0), Vec2f(1, 0), Vec2f(0, 1)}};
  mesh.material.resize(2);
  mesh.material[1].bump_map = folder / "h.pgm";
  (void)sine_heights(folder / "h.pgm");
  NormalMaps maps = load_normal_maps({.charts = false}, &mesh, "m.obj");
  SurfelCloud cloud = relief_plane(4, 0.01F);
  cloud.material.assign(cloud.size(), 0);
  cloud.material[7] = 1;
  EXPECT_EQ(fit_normals(cloud, maps, {}).mapped, 1U);
  for (std::size_t k = 0; k < cloud.size(); ++k) {
    EXPECT_EQ(cloud.shading_normal[k].isZero(), k != 7) << k;
  }
  cloud.material.assign(cloud.size(), 0);
  const Array<Vec3f> before = cloud.shading_normal;
  EXPECT_EQ(fit_normals(cloud, maps, {}).unmapped, cloud.size());
  EXPECT_EQ(cloud.shading_normal, before);
  cloud.material.assign(cloud.size(), 2);
  EXPECT_TRUE(message_of([&] { fit_normals(cloud, maps, {}, "s.ply"); }).starts_with("s.ply: "));
}

TEST(FitNormals, WantsNormalsAndPlacesInTheImage) {
  const TemporaryFolder folder;
  NormalMaps maps = sine_heights(folder / "h.pgm");
  SurfelCloud cloud = relief_plane(2, 0.01F);
  cloud.normal = {};
  EXPECT_TRUE(message_of([&] {
                fit_normals(cloud, maps, {}, "s.ply");
              }).starts_with("s.ply: the surfels have no normals"));
  cloud = relief_plane(2, 0.01F);
  cloud.uv = {};
  EXPECT_TRUE(message_of([&] {
                fit_normals(cloud, maps, {}, "s.ply");
              }).starts_with("s.ply: the surfels have no texture coordinates"));
}

TEST(FitNormals, AreTheSameForAnyNumberOfThreads) {
  const TemporaryFolder folder;
  const auto fitted = [&](int threads) {
    set_thread_count(threads);
    NormalMaps maps = sine_heights(folder / "h.pgm");
    SurfelCloud cloud = relief_plane(100, 0.02F);
    fit_normals(cloud, maps, {});
    return cloud.shading_normal;
  };
  const Array<Vec3f> alone = fitted(1);
  EXPECT_EQ(fitted(3), alone);
  set_thread_count(0);
}

}  // namespace
}  // namespace surfel::test
