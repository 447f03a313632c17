#include <cmath>
#include <limits>
#include <random>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/texture/texture_fit.h>

#include "texture_support.h"

namespace surfel {
namespace {

using test::brute_force;
using test::make_image;
using test::noise_image;
using test::one_map;
using test::two_charts;

/// Surfels at random places of a flat square of side 1 that carries the whole image, or, where
/// `reach` is not 1, so many of it.
SurfelCloud flat_surfels(std::size_t count, float sigma, float reach = 1) {
  SurfelCloud cloud;
  std::mt19937 generator(1);
  std::uniform_real_distribution<float> uniform(0, 1);
  for (std::size_t k = 0; k < count; ++k) {
    const Vec2f p(uniform(generator), uniform(generator));
    cloud.position.emplace_back(p.x(), p.y(), 0.0F);
    cloud.uv.emplace_back(p * reach);
  }
  cloud.normal.assign(count, Vec3f(0, 0, 1));
  cloud.dpdu.assign(count, Vec3f(1 / reach, 0, 0));
  cloud.dpdv.assign(count, Vec3f(0, 1 / reach, 0));
  cloud.variance.assign(count, sigma * sigma);
  return cloud;
}

Image half_red_half_green(int size, bool alpha = false) {
  return make_image(size, size, [=](int x, int y) {
    const float a = alpha && y % 2 ? 0.5F : 1.0F;
    return x < size / 2 ? Eigen::Vector4f(1, 0, 0, a) : Eigen::Vector4f(0, 1, 0, a);
  });
}

Vec3f half_color(bool left) { return left ? Vec3f(1, 0, 0) : Vec3f(0, 1, 0); }

TEST(TextureFitOptions, DefaultsAreValidAndBadValuesAreNamed) {
  EXPECT_TRUE(TextureFitOptions{}.problems().empty());
  for (const double bad : {0.0, -1.0, 17.0, std::numeric_limits<double>::quiet_NaN()}) {
    TextureFitOptions options;
    options.reconstruction = bad;
    ASSERT_EQ(options.problems().size(), 1U);
    EXPECT_NE(options.problems()[0].find("reconstruction"), std::string::npos);
    options = {};
    options.prefilter = bad;
    ASSERT_EQ(options.problems().size(), 1U);
    EXPECT_NE(options.problems()[0].find("prefilter"), std::string::npos);
    options = {};
    options.max_aspect = bad == 17 ? 0.5 : bad;
    EXPECT_EQ(options.problems().size(), 1U);
  }
}

TEST(EwaFit, IsTheDoubleSumOverTheTexelsAtEveryScale) {
  const Image image = noise_image(120, 80, 3);
  for (const WrapMode wrap : {WrapMode::kRepeat, WrapMode::kMirror, WrapMode::kClamp}) {
    for (const float sigma : {0.0F, 0.01F, 0.04F, 0.15F}) {
      SurfelCloud cloud = flat_surfels(25, sigma, 1.5F);
      TextureSet textures = one_map(image, wrap);
      fit_texture(cloud, textures, {.reconstruction = 1});
      for (std::size_t k = 0; k < cloud.size(); ++k) {
        TexelKernel kernel;
        kernel.center = Vec2d(cloud.uv[k].x() * 120, (1 - cloud.uv[k].y()) * 80);
        kernel.variance =
            Vec2d(std::pow(sigma * 1.5 * 120, 2) + 1, std::pow(sigma * 1.5 * 80, 2) + 1)
                .asDiagonal();
        const Vec3f expected = brute_force(image, wrap, kernel).color;
        EXPECT_LT((cloud.coefficient[k] - expected).cwiseAbs().maxCoeff(), 1e-3) << sigma;
      }
    }
  }
}

/// The mean of bilinear lookups under a surfel's Gaussian, by a fine grid of places.
Vec3f mean_lookup(const Image& image, const Vec2d& center, const Vec2d& deviation) {
  constexpr int kSteps = 40;
  Eigen::Array3d sum = Eigen::Array3d::Zero();
  double total = 0;
  for (int j = -kSteps; j <= kSteps; ++j) {
    for (int i = -kSteps; i <= kSteps; ++i) {
      const Vec2d t(4.0 * i / kSteps, 4.0 * j / kSteps);
      const Vec2d at = center + deviation.cwiseProduct(t) - Vec2d(0.5, 0.5);
      const double x = std::floor(at.x());
      const double y = std::floor(at.y());
      for (const double v : {y, y + 1}) {
        for (const double u : {x, x + 1}) {
          const double weight = std::exp(-t.squaredNorm() / 2) * (1 - std::abs(at.x() - u)) *
                                (1 - std::abs(at.y() - v));
          const int column = (static_cast<int>(u) % image.width + image.width) % image.width;
          const int row = (static_cast<int>(v) % image.height + image.height) % image.height;
          sum += weight * Eigen::Map<const Eigen::Array3f>(image.pixel(column, row)).cast<double>();
          total += weight;
        }
      }
    }
  }
  return (sum / total).cast<float>().matrix();
}

TEST(EwaFit, InterpolatesTexelsBilinearlyByDefault) {
  // From points to kernels of 1.5 texels, narrow along one axis, and wide along both.
  const Image image = noise_image(12, 8, 3);
  for (const float sigma : {0.0F, 0.02F, 0.04F, 0.08F, 0.125F}) {
    SurfelCloud cloud = flat_surfels(40, sigma, 1.0F);
    TextureSet textures = one_map(image);
    fit_texture(cloud, textures, {});
    double square = 0;
    for (std::size_t k = 0; k < cloud.size(); ++k) {
      const Vec2d center = texel_position(cloud.uv[k], 12, 8);
      const Vec3f expected = mean_lookup(image, center, {sigma * 12.0, sigma * 8.0});
      square += (cloud.coefficient[k] - expected).squaredNorm() / 3;
    }
    EXPECT_LT(std::sqrt(square / 40), sigma == 0 ? 1e-6 : 0.015) << sigma;
  }
}

TEST(EwaFit, LookupsAtTheBorderOfARepeatedImageFindItsOtherSide) {
  SurfelCloud cloud = flat_surfels(1, 0);
  cloud.uv[0] = {0.01F, 0.5F};
  const Image image = noise_image(8, 8, 3);
  const Vec3f expected = mean_lookup(image, texel_position(cloud.uv[0], 8, 8), {0, 0});
  for (const bool whole : {true, false}) {
    // Half of the image is a chart whose other side another chart has.
    TriangleMesh mesh;
    const float right = whole ? 1 : 0.5F;
    mesh.position = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
    mesh.face = {{0, 1, 2}, {0, 2, 3}};
    mesh.wedge_uv = {{Vec2f(0, 0), Vec2f(right, 0), Vec2f(right, 1)},
                     {Vec2f(0, 0), Vec2f(right, 1), Vec2f(0, 1)}};
    TextureSet textures = one_map(image);
    textures.charts.emplace(mesh);
    fit_texture(cloud, textures, {});
    const float error = (cloud.coefficient[0] - expected).norm();
    if (whole) {
      EXPECT_LT(error, 1e-6F);
    } else {
      const Vec3f inside(image.pixel(0, 4)[0], image.pixel(0, 4)[1], image.pixel(0, 4)[2]);
      const Vec3f above(image.pixel(0, 3)[0], image.pixel(0, 3)[1], image.pixel(0, 3)[2]);
      EXPECT_LT((cloud.coefficient[0] - (inside + above) / 2).norm(), 1e-5F);
    }
  }
}

TEST(EwaFit, PrefilterScalesTheSurfelsVariance) {
  for (const double prefilter : {0.25, 0.5, 2.0}) {
    SurfelCloud scaled = flat_surfels(50, 0.05F);
    SurfelCloud other = scaled;
    for (float& variance : other.variance) variance *= static_cast<float>(prefilter);
    TextureSet textures = one_map(noise_image(128, 128, 6));
    fit_texture(scaled, textures, {.prefilter = prefilter});
    fit_texture(other, textures, {});
    EXPECT_EQ(scaled.variance[0], 0.05F * 0.05F);
    for (std::size_t k = 0; k < scaled.size(); ++k) {
      EXPECT_LT((scaled.coefficient[k] - other.coefficient[k]).norm(), 1e-5);
    }
  }
  // The other fits start from the coefficients of whole kernels.
  EXPECT_EQ(
      (TextureFitOptions{.kind = TextureFitKind::kRender, .prefilter = 0.5}).problems().size(), 1U);
}

TEST(EwaFit, ExactAgreesWithThePyramid) {
  SurfelCloud fast = flat_surfels(200, 0.07F);
  SurfelCloud slow = fast;
  TextureSet textures = one_map(noise_image(256, 256, 4));
  EXPECT_EQ(fit_texture(slow, textures, {.exact = true}).levels, 1);
  EXPECT_GT(fit_texture(fast, textures, {}).levels, 2);
  double worst = 0;
  for (std::size_t k = 0; k < fast.size(); ++k) {
    worst =
        std::max<double>(worst, (fast.coefficient[k] - slow.coefficient[k]).cwiseAbs().maxCoeff());
  }
  EXPECT_LT(worst, 1e-3);
  EXPECT_GT(worst, 0);
}

TEST(EwaFit, ReconstructionSetsTheKernelOfAPoint) {
  const Image image = noise_image(16, 16, 5);
  for (const double reconstruction : {0.4, 1.0, 2.0}) {
    SurfelCloud cloud = flat_surfels(10, 0);
    TextureSet textures = one_map(image);
    fit_texture(cloud, textures, {.reconstruction = reconstruction});
    for (std::size_t k = 0; k < cloud.size(); ++k) {
      const TexelKernel kernel{texel_position(cloud.uv[k], 16, 16),
                               reconstruction * reconstruction * Mat2d::Identity()};
      EXPECT_LT((cloud.coefficient[k] - brute_force(image, WrapMode::kRepeat, kernel).color).norm(),
                1e-3);
    }
  }
}

TEST(EwaFit, ChartsOfDifferentColourDoNotBleedAtAnyScale) {
  const TriangleMesh mesh = two_charts();
  for (const bool alpha : {false, true}) {
    for (const float sigma : {0.002F, 0.02F, 0.1F, 0.7F}) {
      SurfelCloud cloud = flat_surfels(400, sigma);
      TextureSet textures = one_map(half_red_half_green(64, alpha));
      textures.charts.emplace(mesh);
      const TextureFitReport report = fit_texture(cloud, textures, {});
      EXPECT_EQ(report.charts, 2U);
      EXPECT_EQ(report.outside_charts, 0U);
      for (std::size_t k = 0; k < cloud.size(); ++k) {
        const bool left = cloud.position[k].x() < 0.5F;
        EXPECT_LT((cloud.coefficient[k] - half_color(left)).norm(), 2 * kPartialCoverage)
            << sigma << ' ' << cloud.position[k].transpose();
        if (alpha && sigma > 0.05F) {
          EXPECT_NEAR(cloud.alpha[k], 0.75, 0.02);
        }
      }
    }
  }
}

TEST(EwaFit, ChartsChangeNothingWhereKernelsDoNotReachTheBorder) {
  const TriangleMesh mesh = two_charts();
  SurfelCloud with = flat_surfels(500, 0.02F);
  SurfelCloud without = with;
  TextureSet textures = one_map(noise_image(128, 128, 9));
  fit_texture(without, textures, {});
  textures.charts.emplace(mesh);
  fit_texture(with, textures, {});
  int compared = 0;
  for (std::size_t k = 0; k < with.size(); ++k) {
    const Vec2f uv = with.uv[k];
    if (std::abs(uv.x() - 0.5F) < 0.15F || (uv.array() < 0.15F).any() ||
        (uv.array() > 0.85F).any()) {
      continue;
    }
    ++compared;
    EXPECT_LT((with.coefficient[k] - without.coefficient[k]).cwiseAbs().maxCoeff(), 1e-5);
  }
  EXPECT_GT(compared, 50);
}

TEST(EwaFit, ChartsBeyondTheUnitSquareSeeTheRepeatedImage) {
  TriangleMesh mesh = two_charts();
  for (auto& face : mesh.wedge_uv) {
    for (Vec2f& uv : face) uv += Vec2f(3, -2);
  }
  SurfelCloud cloud = flat_surfels(100, 0.02F);
  for (Vec2f& uv : cloud.uv) uv += Vec2f(3, -2);
  TextureSet textures = one_map(half_red_half_green(64));
  textures.charts.emplace(mesh);
  EXPECT_EQ(fit_texture(cloud, textures, {}).outside_charts, 0U);
  for (std::size_t k = 0; k < cloud.size(); ++k) {
    const bool left = cloud.position[k].x() < 0.5F;
    EXPECT_LT((cloud.coefficient[k] - half_color(left)).norm(), 2 * kPartialCoverage);
  }
}

TEST(EwaFit, ChartsThatRepeatTheImageManyTimesAreNotMasked) {
  TriangleMesh mesh = two_charts();
  for (auto& face : mesh.wedge_uv) {
    for (Vec2f& uv : face) uv *= 1000;
  }
  SurfelCloud cloud = flat_surfels(100, 0.00002F, 1000);
  TextureSet textures = one_map(half_red_half_green(64));
  textures.charts.emplace(mesh);
  EXPECT_EQ(fit_texture(cloud, textures, {}).charts_too_large, 2U);
  for (const Vec3f& w : cloud.coefficient) EXPECT_NEAR(w.x() + w.y(), 1, 1e-5);
}

TEST(EwaFit, UnusableSurfelsGetAColourAndAreCounted) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  SurfelCloud cloud = flat_surfels(6, 0.01F);
  cloud.uv[1] = Vec2f(nan, 0);
  cloud.dpdu[2] = Vec3f(0, 0, 0);
  cloud.variance[3] = nan;
  cloud.dpdu[4] = Vec3f(1e-6F, 0, 0);
  cloud.position[5] = Vec3f(nan, nan, nan);
  TextureSet textures = one_map(half_red_half_green(16));
  const TriangleMesh mesh = two_charts();
  textures.charts.emplace(mesh);
  const TextureFitReport report = fit_texture(cloud, textures, {});
  EXPECT_EQ(report.without_uv, 1U);
  EXPECT_EQ(report.without_kernel, 3U);
  EXPECT_TRUE(cloud.coefficient[1].isApprox(Vec3f(0.5F, 0.5F, 0), 1e-5F));
  for (const Vec3f& w : cloud.coefficient) {
    EXPECT_TRUE(w.allFinite());
    EXPECT_NEAR(w.sum(), 1, 1e-5);
  }
}

TEST(EwaFit, KernelsAreWidenedToTheLargestAspect) {
  SurfelCloud cloud = flat_surfels(10, 0.1F);
  cloud.dpdu.assign(10, Vec3f(0.0005F, 0, 0));
  TextureSet textures = one_map(noise_image(64, 64, 2));
  EXPECT_EQ(fit_texture(cloud, textures, {}).widened, 10U);
  EXPECT_EQ(fit_texture(cloud, textures, {.max_aspect = 10000}).widened, 0U);
}

TEST(EwaFit, KernelsThatCoverALargeImageManyTimesAreCheap) {
  // A double sum would take 10^12 texels; the test would not end.
  SurfelCloud cloud = flat_surfels(20000, 3.0F);
  TextureSet textures = one_map(half_red_half_green(1024));
  fit_texture(cloud, textures, {});
  for (const Vec3f& w : cloud.coefficient) EXPECT_TRUE(w.isApprox(Vec3f(0.5F, 0.5F, 0), 1e-3F));
}

TEST(EwaFit, MaterialsChooseTheirMapAndAlphaIsOneWhereAMapHasNone) {
  SurfelCloud cloud = flat_surfels(4, 0.01F);
  cloud.material = {0, 1, 2, 1};
  TextureSet textures;
  textures.maps.push_back(TextureMap::constant({0.1F, 0.2F, 0.3F}));
  textures.maps.emplace_back(
      make_image(8, 8, [](int, int) { return Eigen::Vector4f(1, 1, 1, 0.5F); }), WrapMode::kRepeat);
  textures.maps.push_back(TextureMap::constant({3, 2, 1}));
  textures.map_of_material = {0, 1, 2};
  EXPECT_TRUE(fit_texture(cloud, textures, {}).alpha);
  EXPECT_TRUE(cloud.coefficient[0].isApprox(Vec3f(0.1F, 0.2F, 0.3F)));
  EXPECT_TRUE(cloud.coefficient[2].isApprox(Vec3f(3, 2, 1)));
  EXPECT_EQ(cloud.alpha[0], 1);
  EXPECT_NEAR(cloud.alpha[1], 0.5, 1e-6);
}

TEST(EwaFit, LeavesOtherColumnsAloneAndForgetsTheBasisOfOlderCoefficients) {
  SurfelCloud cloud = flat_surfels(3, 0.01F);
  cloud.color.assign(3, Vec3f(0.5F, 0.25F, 0));
  cloud.basis_cutoff = 1;
  const SurfelCloud before = cloud;
  TextureSet textures = one_map(noise_image(4, 4, 1));
  const TextureFitReport report = fit_texture(cloud, textures, {});
  EXPECT_EQ(cloud.color, before.color);
  EXPECT_EQ(cloud.uv, before.uv);
  EXPECT_TRUE(cloud.alpha.empty());
  EXPECT_FALSE(cloud.basis_cutoff);
  for (const Vec3f& w : cloud.coefficient) {
    EXPECT_TRUE((w.array() >= report.coefficient_min.array()).all());
    EXPECT_TRUE((w.array() <= report.coefficient_max.array()).all());
  }
}

TEST(EwaFit, IsTheSameForAnyNumberOfThreads) {
  const TriangleMesh mesh = two_charts();
  std::vector<Array<Vec3f>> results;
  for (const int threads : {1, 2, 5}) {
    set_thread_count(threads);
    SurfelCloud cloud = flat_surfels(20000, 0.03F);
    TextureSet textures = one_map(noise_image(700, 700, 4));
    textures.charts.emplace(mesh);
    fit_texture(cloud, textures, {});
    results.push_back(cloud.coefficient);
  }
  set_thread_count(0);
  EXPECT_EQ(results[0], results[1]);
  EXPECT_EQ(results[0], results[2]);
}

TEST(EwaFit, NamesTheColumnThatIsMissingAndWhoMakesIt) {
  const auto message = [](SurfelCloud cloud, TextureSet textures) -> std::string {
    try {
      fit_texture(cloud, textures, {}, "a.ply");
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  };
  const auto contains = [](const std::string& text, const std::string& part) {
    return text.find(part) != std::string::npos;
  };
  const Image image = noise_image(2, 2, 1);
  SurfelCloud cloud = flat_surfels(2, 1);
  EXPECT_EQ(message(cloud, one_map(image)), "");
  SurfelCloud no_uv = cloud;
  no_uv.uv.clear();
  EXPECT_TRUE(contains(message(no_uv, one_map(image)), "a.ply: the surfels have no texture"));
  SurfelCloud no_derivatives = cloud;
  no_derivatives.dpdv.clear();
  EXPECT_TRUE(contains(message(no_derivatives, one_map(image)), "surfel-from-mesh"));
  SurfelCloud no_variance = cloud;
  no_variance.variance.clear();
  EXPECT_TRUE(contains(message(no_variance, one_map(image)), "variance"));

  TextureSet two = one_map(image);
  two.map_of_material = {0, 0};
  EXPECT_TRUE(contains(message(cloud, std::move(two)), "material"));
  two = one_map(image);
  two.map_of_material = {0, 0};
  cloud.material = {1, 2};
  EXPECT_TRUE(contains(message(cloud, std::move(two)), "surfel 1 has material 2"));
}

TEST(EwaFit, AcceptsACloudWithoutSurfels) {
  SurfelCloud cloud;
  TextureSet textures = one_map(noise_image(2, 2, 1));
  EXPECT_EQ(fit_texture(cloud, textures, {}).surfels, 0U);
}

}  // namespace
}  // namespace surfel
