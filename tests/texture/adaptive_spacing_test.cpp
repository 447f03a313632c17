#include <algorithm>
#include <cmath>
#include <cstring>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/sample/mesh_sampler.h>
#include <surfel/texture/adaptive_spacing.h>

#include "sample/test_meshes.h"
#include "support/test_data.h"
#include "texture/texture_support.h"

namespace surfel {
namespace {

using namespace test;

/// Left half grey, right half a checker of 8 texels a square.
TextureSet half_checker() {
  TextureSet textures;
  textures.maps.emplace_back(make_image(256, 256,
                                        [](int x, int y) {
                                          const bool white = x < 128 || (x / 8 + y / 8) % 2 == 0;
                                          const float grey = white ? 0.8f : 0.1f;
                                          return Eigen::Vector4f(grey, grey, grey, 1);
                                        }),
                             WrapMode::kClamp);
  return textures;
}

AdaptiveSpacingOptions by_error(double error) {
  AdaptiveSpacingOptions options;
  options.max_error = error;
  options.most_probes = 1 << 17;
  options.unit_deviation = 10;  // Borders matter little.
  return options;
}

AdaptiveSpacingOptions by_count(std::size_t count) {
  AdaptiveSpacingOptions options;
  options.count = count;
  options.unit_deviation = 10;
  return options;
}

SurfelCloud sampled(const TriangleMesh& mesh, const SizingField& field) {
  MeshSampleOptions options;
  options.spacing = 1;
  options.field = &field;
  return sample_mesh(mesh, options);
}

/// Root mean square of what EWA's blur takes from the texture, over points of the surface.
double blur_error(const SurfelCloud& cloud, TextureSet& textures) {
  SurfelCloud blurred = cloud;
  for (float& v : blurred.variance) v *= 1.42f;  // Of the coefficients and of the picture.
  SurfelCloud sharp = cloud;
  std::fill(sharp.variance.begin(), sharp.variance.end(), 0.0f);
  fit_texture(blurred, textures, {.reconstruction = 1});
  fit_texture(sharp, textures, {.reconstruction = 1});
  double sum = 0;
  double area = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    sum += cloud.area[i] * (blurred.coefficient[i] - sharp.coefficient[i]).squaredNorm() / 3;
    area += cloud.area[i];
  }
  return std::sqrt(sum / area);
}

TEST(AdaptiveSpacing, SurfelsGoWhereTheTextureHasDetail) {
  const TriangleMesh mesh = surface("plane", 3);
  TextureSet textures = half_checker();
  AdaptiveSpacingReport report;
  const SizingField field = adaptive_spacing(mesh, &textures, by_error(0.05), &report);
  EXPECT_TRUE(report.reached);
  EXPECT_LE(report.error, 0.05);
  EXPECT_GT(report.error, 0.03);
  EXPECT_GT(field.at({-0.8f, 0, 0}), 10 * field.at({0.5f, 0, 0}));
  const SurfelCloud cloud = sampled(mesh, field);
  const auto right = std::count_if(cloud.position.begin(), cloud.position.end(),
                                   [](const Vec3f& p) { return p.x() > -0.05f; });
  EXPECT_GT(static_cast<double>(right), 0.9 * static_cast<double>(cloud.size()));
  EXPECT_NEAR(blur_error(cloud, textures), report.color_error, 0.4 * report.color_error);
}

TEST(AdaptiveSpacing, CountIsNearlyMetByTheFieldItself) {
  const TriangleMesh mesh = surface("plane", 3);
  TextureSet textures = half_checker();
  const SizingField field = adaptive_spacing(mesh, &textures, by_count(5000));
  const auto made = static_cast<double>(sampled(mesh, field).size());
  EXPECT_NEAR(made, 5000, 1000);

  MeshSampleOptions exact;
  exact.count = 5000;
  exact.field = &field;
  EXPECT_EQ(sample_mesh(mesh, exact).size(), 5000u);
}

TEST(AdaptiveSpacing, SmallerErrorsTakeMoreSurfels) {
  const TriangleMesh mesh = surface("plane", 3);
  TextureSet textures = half_checker();
  std::size_t last = 0;
  for (const double error : {0.2, 0.1, 0.05, 0.03}) {
    const std::size_t count =
        sampled(mesh, adaptive_spacing(mesh, &textures, by_error(error))).size();
    EXPECT_GT(count, last) << error;
    last = count;
  }
}

TEST(AdaptiveSpacing, VertexColorsCountAsTextureDoes) {
  TriangleMesh mesh = surface("plane", 64);
  for (const Vec3f& p : mesh.position) {
    mesh.color.push_back(Vec3f::Constant(p.x() > 0 ? 0.5f + 0.5f * std::sin(40 * p.y()) : 0.5f));
  }
  const SizingField field = adaptive_spacing(mesh, nullptr, by_error(0.02));
  EXPECT_GT(field.at({-0.8f, 0, 0}), 4 * field.at({0.5f, 0, 0}));
}

TEST(AdaptiveSpacing, EdgesOfABoxAreFinerThanItsSides) {
  const TriangleMesh mesh = box(Vec3f(1, 1, 1));
  AdaptiveSpacingOptions options;
  options.count = 5000;
  AdaptiveSpacingReport report;
  const SizingField field = adaptive_spacing(mesh, nullptr, options, &report);
  EXPECT_EQ(report.color_error, 0);
  EXPECT_GT(report.shape_error, 0);
  EXPECT_GT(field.at({0.5f, 0.5f, 0}), 3 * field.at({0, 0, 0.5f}));
}

TEST(AdaptiveSpacing, DiagonalIsTheUnitOfDeviationUnlessGiven) {
  AdaptiveSpacingOptions options;
  options.count = 100;
  AdaptiveSpacingReport report;
  adaptive_spacing(box(Vec3f(3, 4, 12)), nullptr, options, &report);
  EXPECT_NEAR(report.unit_deviation, 13.0 / 30, 1e-6);
}

TEST(AdaptiveSpacing, WhatCannotBeReachedIsSaid) {
  const TriangleMesh mesh = box(Vec3f(1, 1, 1));
  AdaptiveSpacingOptions options;
  options.max_error = 1e-7;
  options.most_probes = 1 << 15;
  AdaptiveSpacingReport report;
  adaptive_spacing(mesh, nullptr, options, &report);
  EXPECT_FALSE(report.reached);
  EXPECT_GT(report.error, 1e-7);
}

TEST(AdaptiveSpacing, ThreadsDoNotChangeTheResult) {
  const TriangleMesh mesh = surface("torus", 40);
  TextureSet textures = half_checker();
  set_thread_count(1);
  const SurfelCloud one = sampled(mesh, adaptive_spacing(mesh, &textures, by_count(3000)));
  set_thread_count(5);
  const SurfelCloud five = sampled(mesh, adaptive_spacing(mesh, &textures, by_count(3000)));
  set_thread_count(0);
  ASSERT_EQ(one.size(), five.size());
  EXPECT_EQ(0, std::memcmp(one.position.data(), five.position.data(), one.size() * sizeof(Vec3f)));
  EXPECT_EQ(0, std::memcmp(one.variance.data(), five.variance.data(), one.size() * sizeof(float)));
}

TEST(AdaptiveSpacing, RefusesWhatCannotBe) {
  const TriangleMesh mesh = surface("plane", 3);
  EXPECT_THROW(adaptive_spacing(mesh, nullptr, {}), Error);
  EXPECT_THROW(adaptive_spacing(mesh, nullptr, by_error(0)), Error);
  EXPECT_THROW(adaptive_spacing(mesh, nullptr, by_error(-1)), Error);
  EXPECT_THROW(adaptive_spacing(mesh, nullptr, by_error(std::nan(""))), Error);
  EXPECT_THROW(adaptive_spacing(mesh, nullptr, by_count(0)), Error);
  AdaptiveSpacingOptions both = by_count(10);
  both.max_error = 0.1;
  EXPECT_EQ(both.problems().size(), 1u);
  AdaptiveSpacingOptions unit = by_count(10);
  unit.unit_deviation = 0;
  EXPECT_EQ(unit.problems().size(), 1u);
  EXPECT_TRUE(by_count(10).problems().empty());
  EXPECT_THROW(adaptive_spacing(TriangleMesh{}, nullptr, by_count(10)), Error);
}

}  // namespace
}  // namespace surfel
