// The fits that solve systems, end to end: fit_texture() and fit_colors().

#include <Eigen/Core>
#include <cmath>
#include <limits>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/texture/render_system.h>
#include <surfel/texture/texture_fit.h>

#include "support/dense_algebra.h"
#include "texture_support.h"

namespace surfel {
namespace {

using test::eigenvalues;
using test::noise_image;
using test::one_map;
using test::solve_definite;

/// Jittered grid of n x n surfels over a unit square that carries the image once; sigma by the
/// spacing.
SurfelCloud grid(int n, double kappa) {
  SurfelCloud cloud;
  const float h = 1.0F / static_cast<float>(n);
  for (int j = 0; j < n; ++j) {
    for (int i = 0; i < n; ++i) {
      const auto k = static_cast<std::uint64_t>(j) * n + i;
      const auto jitter = [&](int axis) {
        return 0.6F * static_cast<float>(random_uniform(7, k, axis) - 0.5);
      };
      const Vec2f p((static_cast<float>(i) + 0.5F + jitter(0)) * h,
                    (static_cast<float>(j) + 0.5F + jitter(1)) * h);
      cloud.position.emplace_back(p.x(), p.y(), 0.0F);
      cloud.uv.push_back(p);
    }
  }
  cloud.normal.assign(cloud.size(), Vec3f(0, 0, 1));
  cloud.dpdu.assign(cloud.size(), Vec3f(1, 0, 0));
  cloud.dpdv.assign(cloud.size(), Vec3f(0, 1, 0));
  cloud.variance.assign(cloud.size(), static_cast<float>(kappa * kappa) * h * h);
  cloud.area.assign(cloud.size(), h * h);
  return cloud;
}

TextureFitOptions fit_of(TextureFitKind kind) {
  TextureFitOptions options;
  options.kind = kind;
  return options;
}

float largest_difference(const SurfelCloud& a, const SurfelCloud& b) {
  float most = 0;
  for (std::size_t k = 0; k < a.size(); ++k) {
    most = std::max(most, (a.coefficient[k] - b.coefficient[k]).cwiseAbs().maxCoeff());
  }
  return most;
}

TextureFitOptions gram_fit(GramRightSide side) {
  TextureFitOptions options = fit_of(TextureFitKind::kGram);
  options.right_side = side;
  options.reconstruction = 1;
  return options;
}

/// R of SS01 (11) for a plane, written out: every pair, the whole matrix.
Eigen::MatrixXd dense_gram(const SurfelCloud& cloud) {
  const std::size_t n = cloud.size();
  Eigen::MatrixXd R(n, n);
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < n; ++j) {
      const double v = static_cast<double>(cloud.variance[i]) + cloud.variance[j];
      const double d2 =
          (cloud.position[i].cast<double>() - cloud.position[j].cast<double>()).squaredNorm();
      R(i, j) = static_cast<double>(cloud.area[i]) * cloud.area[j] * std::exp(-d2 / (2 * v)) /
                (2 * M_PI * v);
    }
  }
  return R;
}

/// The integral of sum_i c_i n_i, the texture that a repeated image stands for on a plane of
/// grid(), times the normalised Gaussian of `variance` unit^2 about `place`, texel by texel; n has
/// the standard deviation `reconstruction` texels. At variance 0: the texture at the place.
Eigen::RowVector3d texture_under(const Image& image, const Vec2d& place, double variance,
                                 double reconstruction) {
  const Vec2d s(place.x() * image.width, (1 - place.y()) * image.height);
  const double v = variance * image.width * image.width + reconstruction * reconstruction;
  const double reach = 8 * std::sqrt(v);
  Eigen::RowVector3d sum = Eigen::RowVector3d::Zero();
  for (int y = static_cast<int>(std::floor(s.y() - reach)); y <= s.y() + reach; ++y) {
    for (int x = static_cast<int>(std::floor(s.x() - reach)); x <= s.x() + reach; ++x) {
      const double g = std::exp(-(Vec2d(x + 0.5, y + 0.5) - s).squaredNorm() / (2 * v));
      const float* texel = image.pixel(test::walk(x, image.width, WrapMode::kRepeat),
                                       test::walk(y, image.height, WrapMode::kRepeat));
      for (int c = 0; c < 3; ++c) sum[c] += g * static_cast<double>(texel[c]);
    }
  }
  return sum / (2 * M_PI * v);
}

/// c of SS01 (11), written out.
Eigen::MatrixXd published_right_side(const SurfelCloud& cloud, const Image& image,
                                     double reconstruction) {
  Eigen::MatrixXd c(cloud.size(), 3);
  for (std::size_t k = 0; k < cloud.size(); ++k) {
    c.row(static_cast<Eigen::Index>(k)) =
        static_cast<double>(cloud.area[k]) *
        texture_under(image, cloud.position[k].head<2>().cast<double>(),
                      static_cast<double>(cloud.variance[k]), reconstruction);
  }
  return c;
}

double largest_difference(const SurfelCloud& cloud, const Eigen::MatrixXd& w) {
  double most = 0;
  for (std::size_t k = 0; k < cloud.size(); ++k) {
    const Eigen::RowVector3d expected = w.row(static_cast<Eigen::Index>(k));
    most = std::max(
        most, (cloud.coefficient[k].cast<double>().transpose() - expected).cwiseAbs().maxCoeff());
  }
  return most;
}

/// Squares of `square` surfel spacings on an image for grid(n).
Image checkered(int n, int texels_per_spacing, int square) {
  const int size = n * texels_per_spacing;
  const int side = square * texels_per_spacing;
  return test::make_image(size, size, [&](int x, int y) {
    const float value = (x / side + y / side) % 2 == 0 ? 0.0F : 1.0F;
    return Eigen::Vector4f(value, value, value, 1);
  });
}

/// Root mean square of sum_i c_i n_i - sum_k w_k r_k [SS01 (10)], red, over the middle of grid().
double plain_sum_error(const SurfelCloud& cloud, const Image& image) {
  constexpr int kSide = 60;  // Points.
  double sum = 0;
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      const Vec2d p(0.25 + (x + 0.5) * 0.5 / kSide, 0.25 + (y + 0.5) * 0.5 / kSide);
      double value = 0;
      for (std::size_t k = 0; k < cloud.size(); ++k) {
        const auto v = static_cast<double>(cloud.variance[k]);
        const double d2 = (cloud.position[k].head<2>().cast<double>() - p).squaredNorm();
        value += static_cast<double>(cloud.coefficient[k].x() * cloud.area[k]) *
                 std::exp(-d2 / (2 * v)) / (2 * M_PI * v);
      }
      const double error = value - texture_under(image, p, 0, 1)[0];
      sum += error * error;
    }
  }
  return std::sqrt(sum) / kSide;
}

TEST(CoefficientFit, ConstantTexturesGiveConstantCoefficients) {
  const Vec3f color(0.2F, 0.5F, 0.9F);
  TextureSet textures;
  textures.maps.push_back(TextureMap::constant(color));
  for (const TextureFitOptions& options :
       {gram_fit(GramRightSide::kNormalised), fit_of(TextureFitKind::kRender)}) {
    for (const double kappa : {0.5, 0.8, 1.0}) {
      SurfelCloud cloud = grid(24, kappa);
      fit_texture(cloud, textures, options);
      for (const Vec3f& w : cloud.coefficient) ASSERT_LT((w - color).norm(), 1e-5F) << kappa;
    }
  }
}

struct TexelCase {
  int texels;             ///< Along the plane of 30 x 30 surfels.
  double reconstruction;  ///< Texels.
  bool exact;
  double error;  ///< Of c_k / a_k, by the image's range.
};

class PublishedGram : public testing::TestWithParam<TexelCase> {};

TEST_P(PublishedGram, IsEquation11WrittenOut) {
  SurfelCloud cloud = grid(30, 0.7);
  const Image image = noise_image(GetParam().texels, GetParam().texels, 5);
  TextureSet textures = one_map(image);
  TextureFitOptions options = fit_of(TextureFitKind::kGram);
  options.tolerance = 1e-12;
  options.reconstruction = GetParam().reconstruction;
  options.exact = GetParam().exact;
  const TextureFitReport report = fit_texture(cloud, textures, options);
  ASSERT_TRUE(report.system);
  EXPECT_EQ(report.system->lambda, 0);

  const Eigen::MatrixXd R = dense_gram(cloud);
  const Eigen::MatrixXd c = published_right_side(cloud, image, GetParam().reconstruction);
  Eigen::MatrixXd w(cloud.size(), 3);
  for (std::size_t k = 0; k < cloud.size(); ++k) {
    w.row(static_cast<Eigen::Index>(k)) = cloud.coefficient[k].cast<double>().transpose();
  }
  const double area = static_cast<double>(cloud.area[0]);
  EXPECT_LT((test::product(R, w) - c).cwiseAbs().maxCoeff(), GetParam().error * area);
  // R^-1, whose norm is some 2e3 / area, may enlarge the error.
  const Eigen::MatrixXd solution = solve_definite(R, c);
  EXPECT_LT((w - solution).cwiseAbs().maxCoeff(), 400 * GetParam().error);
}

// Kernels end where exp(-10) of their volume is left. At 0.25 texels, one texel beyond the end
// would have a weight of exp(-10) / (2 pi 0.25^2) = 1.2e-4.
INSTANTIATE_TEST_SUITE_P(
    TexelDensities, PublishedGram,
    testing::Values(TexelCase{200, 1, true, 5e-5}, TexelCase{200, 1, false, 1e-3},
                    TexelCase{64, 1, false, 5e-5}, TexelCase{8, 1, false, 5e-5},
                    TexelCase{30, 0.5, false, 5e-5}, TexelCase{8, 0.25, false, 2e-4}));

TEST(CoefficientFit, PublishedGramIsBestForThePlainSum) {
  constexpr int kSide = 20;
  const Image image = checkered(kSide, 2, 4);
  TextureSet textures = one_map(image);
  for (const double kappa : {0.5, 0.7, 0.85}) {
    SurfelCloud cloud = grid(kSide, kappa);
    fit_texture(cloud, textures, gram_fit(GramRightSide::kNormalised));
    const double normalised = plain_sum_error(cloud, image);
    fit_texture(cloud, textures, gram_fit(GramRightSide::kPublished));
    const double published = plain_sum_error(cloud, image);
    EXPECT_LT(published, (kappa < 0.6 ? 0.8 : 0.5) * normalised) << kappa;
    const Eigen::MatrixXd w =
        solve_definite(dense_gram(cloud), published_right_side(cloud, image, 1));
    for (std::size_t k = 0; k < cloud.size(); ++k) {
      cloud.coefficient[k] = w.row(static_cast<Eigen::Index>(k)).transpose().cast<float>();
    }
    EXPECT_NEAR(published, plain_sum_error(cloud, image), 1e-3 * published) << kappa;
  }
}

TEST(CoefficientFit, NormalisedGramIsTheDenseSolution) {
  SurfelCloud cloud = grid(30, 0.7);
  TextureSet textures = one_map(noise_image(64, 64, 5));
  SurfelCloud ewa = cloud;
  fit_texture(ewa, textures, {.reconstruction = 1});
  TextureFitOptions options = gram_fit(GramRightSide::kNormalised);
  options.tolerance = 1e-12;
  const TextureFitReport report = fit_texture(cloud, textures, options);
  ASSERT_TRUE(report.system);
  EXPECT_EQ(report.system->lambda, 0);

  const Eigen::MatrixXd R = dense_gram(cloud);
  Eigen::MatrixXd c(cloud.size(), 3);
  for (Eigen::Index k = 0; k < R.rows(); ++k) {
    c.row(k) =
        R.row(k).sum() * ewa.coefficient[static_cast<std::size_t>(k)].cast<double>().transpose();
  }
  const Eigen::MatrixXd w = solve_definite(R, c);
  // Single precision of the colours that both start from, times the condition's root.
  EXPECT_LT(largest_difference(cloud, w), 1e-6 * w.cwiseAbs().maxCoeff());
  const Eigen::VectorXd spectrum = eigenvalues(R);
  const double condition = spectrum.maxCoeff() / spectrum.minCoeff();
  EXPECT_NEAR(report.system->condition() / condition, 1, 0.3);
}

TEST(CoefficientFit, TexelsFinerThanSurfelsAreSoftenedToTheKernelOfThePaper) {
  TextureSet textures = one_map(noise_image(64, 64, 5));
  const auto fitted = [&](int side, std::optional<double> reconstruction) {
    SurfelCloud cloud = grid(side, 0.7);
    TextureFitOptions options = fit_of(TextureFitKind::kRender);
    options.reconstruction = reconstruction;
    fit_texture(cloud, textures, options);
    return cloud.coefficient;
  };
  const auto difference = [](const Array<Vec3f>& a, const Array<Vec3f>& b) {
    float most = 0;
    for (std::size_t k = 0; k < a.size(); ++k) most = std::max(most, (a[k] - b[k]).norm());
    return most;
  };
  // Standard deviations of 1.9 and of 0.4 texels.
  EXPECT_LT(difference(fitted(24, {}), fitted(24, 1)), 1e-4F);
  EXPECT_GT(difference(fitted(110, {}), fitted(110, 1)), 0.1F);
}

TEST(CoefficientFit, ColorsHaveTheNormalisedRightSideOnly) {
  SurfelCloud cloud = grid(12, 0.7);
  for (const Vec2f& p : cloud.uv) cloud.color.push_back(Vec3f::Constant(p.x() < 0.5F ? 0 : 1));
  SurfelCloud same = cloud;
  fit_colors(cloud, fit_of(TextureFitKind::kGram));
  fit_colors(same, gram_fit(GramRightSide::kNormalised));
  EXPECT_EQ(largest_difference(cloud, same), 0);
  EXPECT_THROW(fit_colors(cloud, gram_fit(GramRightSide::kPublished)), Error);
}

TEST(CoefficientFit, SolversAgree) {
  TextureSet textures = one_map(noise_image(64, 64, 5));
  for (const TextureFitKind kind : {TextureFitKind::kGram, TextureFitKind::kRender}) {
    TextureFitOptions options = fit_of(kind);
    options.tolerance = 1e-10;
    SurfelCloud clouds[2] = {grid(12, 0.7), grid(12, 0.7)};
    for (const FitSolver solver : {FitSolver::kConjugateGradients, FitSolver::kCeres}) {
      options.solver = solver;
      const TextureFitReport report =
          fit_texture(clouds[solver == FitSolver::kCeres ? 1 : 0], textures, options);
      EXPECT_TRUE(report.system->converged);
      EXPECT_LT(report.system->residual, 1e-9);
    }
    EXPECT_LT(largest_difference(clouds[0], clouds[1]), 1e-5F);
  }
}

TEST(CoefficientFit, RobustFitsKeepOutliersFromBleeding) {
  // Specks much smaller than the surfels.
  const Image clean = test::make_image(64, 64, [](int x, int y) {
    const float wave = 0.5F + 0.4F * std::sin(0.1F * static_cast<float>(x + y));
    return Eigen::Vector4f(wave, 0.5F, 1 - wave, 1);
  });
  Image image = clean;
  for (int i = 0; i < 64 * 64; i += 211) {
    for (int c = 0; c < 3; ++c) image.pixel(i % 64, i / 64)[c] = 8;
  }
  TextureSet textures = one_map(clean);
  TextureSet outliers = one_map(image);
  const SurfelCloud start = grid(12, 0.8);
  const auto error = [&](bool robust) {
    TextureFitOptions options = fit_of(TextureFitKind::kRender);
    options.robust = robust;
    SurfelCloud expected = start;
    fit_texture(expected, textures, options);
    SurfelCloud cloud = start;
    const TextureFitReport report = fit_texture(cloud, outliers, options);
    EXPECT_EQ(report.system->robust.has_value(), robust);
    double sum = 0;
    for (std::size_t k = 0; k < cloud.size(); ++k) {
      sum += static_cast<double>((cloud.coefficient[k] - expected.coefficient[k]).norm());
    }
    return sum;
  };
  EXPECT_GT(error(false), 0);
  EXPECT_LT(error(true), 0.9 * error(false));
}

TEST(CoefficientFit, OutliersAmongColorsAreFoundAndDoNotBleed) {
  SurfelCloud cloud = grid(30, 0.9);
  for (const Vec2f& p : cloud.uv) {
    cloud.color.push_back(Vec3f::Constant(0.3F + 0.1F * std::sin(9 * p.x())));
  }
  const SurfelCloud clean = cloud;
  const auto outlier = [](std::size_t k) { return random_uniform(3, k, 0) < 0.05; };
  for (std::size_t k = 0; k < cloud.size(); ++k) {
    if (outlier(k)) cloud.color[k] = Vec3f(3, 0, 3);
  }
  const auto difference = [&](bool robust) {
    TextureFitOptions options = fit_of(TextureFitKind::kRender);
    SurfelCloud expected = clean;
    fit_colors(expected, options);
    options.robust = robust;
    SurfelCloud fitted = cloud;
    const TextureFitReport report = fit_colors(fitted, options);
    EXPECT_TRUE(!robust || report.system->robust->down_weighted >= cloud.size() / 40);
    // What the outliers themselves become is not what they do to others.
    double sum = 0;
    for (std::size_t k = 0; k < cloud.size(); ++k) {
      if (outlier(k)) continue;
      sum += static_cast<double>((fitted.coefficient[k] - expected.coefficient[k]).squaredNorm());
    }
    return std::sqrt(sum / static_cast<double>(cloud.size()));
  };
  const double plain = difference(false);
  EXPECT_GT(plain, 0.1);
  EXPECT_LT(difference(true), 0.3 * plain);
}

TEST(CoefficientFit, RefinedVariancesAreWritten) {
  TextureSet textures = one_map(noise_image(6, 6, 5));
  SurfelCloud start = grid(20, 0.9);
  start.area.clear();
  SurfelCloud cloud = start;
  TextureFitOptions options = fit_of(TextureFitKind::kRender);
  options.refine_variance = true;
  options.coverage = 0.31;
  const TextureFitReport report = fit_texture(cloud, textures, options);
  ASSERT_TRUE(report.system && report.system->variance);
  EXPECT_LT(report.system->error, 0.95 * report.system->error_before);
  float most = 1;
  for (std::size_t k = 0; k < cloud.size(); ++k) {
    most = std::max(most, cloud.variance[k] / start.variance[k]);
    ASSERT_EQ(cloud.area[k], start.variance[k]);  // The amplitude that it had.
  }
  EXPECT_NEAR(std::sqrt(most), report.system->variance->sigma_max, 1e-5);
  cloud.color.assign(cloud.size(), Vec3f::Zero());
  EXPECT_THROW(fit_colors(cloud, options), Error);
}

TEST(CoefficientFit, RenderIsNoWorseAtThePointsAndNotesItsCutoff) {
  TextureSet textures = one_map(noise_image(16, 16, 5));
  for (const double cutoff : {1.0, 4.0}) {
    SurfelCloud cloud = grid(40, 0.8);
    TextureFitOptions options = fit_of(TextureFitKind::kRender);
    options.cutoff = cutoff;
    const TextureFitReport report = fit_texture(cloud, textures, options);
    ASSERT_TRUE(report.system);
    EXPECT_LT(report.system->error, 0.7 * report.system->error_ewa);
    EXPECT_TRUE(report.system->converged);
    EXPECT_EQ(cloud.basis_cutoff, cutoff);
  }
}

TEST(CoefficientFit, BoundsHold) {
  TextureSet textures = one_map(noise_image(64, 64, 5));
  for (const TextureFitKind kind : {TextureFitKind::kGram, TextureFitKind::kRender}) {
    SurfelCloud cloud = grid(30, 0.8);
    TextureFitOptions options = fit_of(kind);
    options.bounds = {0, 1};
    const TextureFitReport report = fit_texture(cloud, textures, options);
    EXPECT_GE(report.coefficient_min.minCoeff(), 0);
    EXPECT_LE(report.coefficient_max.maxCoeff(), 1);
    EXPECT_TRUE(report.system->converged);
  }
}

TEST(CoefficientFit, OddCloudsStayFiniteAndBounded) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  TextureSet textures = one_map(noise_image(32, 32, 5));
  SurfelCloud odd = grid(16, 0.7);
  odd.uv[3] = Vec2f(kNan, 0);
  odd.uv[4] = Vec2f(7.25F, -3.5F);
  odd.normal[5].setZero();
  odd.dpdu[6].setZero();
  odd.variance[7] = 1e-12F;
  odd.position[9] = odd.position[8];  // Duplicates.
  odd.uv[9] = odd.uv[8];
  SurfelCloud one = odd.gathered(Array<std::uint32_t>(1, 40));
  SurfelCloud none;
  SurfelCloud sheets = grid(16, 0.7);
  const SurfelCloud other = sheets;
  for (std::size_t k = 0; k < other.size(); ++k) {
    sheets.position.push_back(other.position[k] + Vec3f(0, 0, 0.01F / 16));
    sheets.normal.push_back(-other.normal[k]);
    sheets.uv.push_back(other.uv[k]);
    sheets.dpdu.push_back(other.dpdu[k]);
    sheets.dpdv.push_back(other.dpdv[k]);
    sheets.variance.push_back(other.variance[k]);
    sheets.area.push_back(other.area[k]);
  }
  for (const TextureFitKind kind : {TextureFitKind::kGram, TextureFitKind::kRender}) {
    for (SurfelCloud cloud : {odd, one, none, sheets}) {
      fit_texture(cloud, textures, fit_of(kind));
      for (const Vec3f& w : cloud.coefficient) {
        ASSERT_TRUE(w.allFinite());
        ASSERT_LT(w.cwiseAbs().maxCoeff(), 1000);
      }
    }
  }
  // The two sheets do not mix: each is as if alone.
  for (const TextureFitKind kind : {TextureFitKind::kGram, TextureFitKind::kRender}) {
    TextureFitOptions options = fit_of(kind);
    options.tolerance = 1e-10;
    SurfelCloud alone = other;
    fit_texture(alone, textures, options);
    fit_texture(sheets, textures, options);
    for (std::size_t k = 0; k < alone.size(); ++k) {
      ASSERT_LT((alone.coefficient[k] - sheets.coefficient[k]).norm(), 1e-3F);
    }
  }
}

/// A tube of `around` surfels, one turn, and of `along` rings.
SurfelCloud tube(int around, int along, double kappa) {
  SurfelCloud cloud;
  const float turn = 2 * static_cast<float>(M_PI);
  const float h = turn / static_cast<float>(around);  // The radius is 1.
  const float length = h * static_cast<float>(along);
  for (int j = 0; j < along; ++j) {
    for (int i = 0; i < around; ++i) {
      const auto k = static_cast<std::uint64_t>(j) * around + i;
      const auto jitter = [&](int axis) {
        return 0.6F * static_cast<float>(random_uniform(7, k, axis) - 0.5);
      };
      const float angle = (static_cast<float>(i) + jitter(0)) * h;
      const float z = (static_cast<float>(j) + jitter(1)) * h;
      const Vec3f normal(std::cos(angle), std::sin(angle), 0);
      cloud.position.push_back(normal + Vec3f(0, 0, z));
      cloud.normal.push_back(normal);
      cloud.uv.emplace_back(angle / turn, z / length);
      cloud.dpdu.emplace_back(-turn * normal.y(), turn * normal.x(), 0.0F);
      cloud.dpdv.emplace_back(0.0F, 0.0F, length);
      cloud.variance.push_back(static_cast<float>(kappa * kappa) * h * h);
      cloud.area.push_back(h * h);
    }
  }
  return cloud;
}

// Surfels 90 degrees apart do not couple, though both do with the ones in between: R is indefinite.
TEST(CoefficientFit, GramConvergesOnThinTubes) {
  TextureSet textures = one_map(noise_image(64, 64, 5));
  for (const GramRightSide side : {GramRightSide::kPublished, GramRightSide::kNormalised}) {
    for (const int around : {5, 8, 12}) {
      SurfelCloud cloud = tube(around, 600, 0.8);
      const TextureFitReport report = fit_texture(cloud, textures, gram_fit(side));
      EXPECT_TRUE(report.system->converged) << around;
      EXPECT_GT(report.system->lambda, 0.01) << around;
      EXPECT_GT(report.coefficient_min.minCoeff(), -3) << around;
      EXPECT_LT(report.coefficient_max.maxCoeff(), 4) << around;
    }
  }
}

TEST(CoefficientFit, SurfelsWithoutUvLeaveTheGramSystem) {
  TextureSet textures = one_map(noise_image(32, 32, 5));
  SurfelCloud cloud = grid(20, 0.7);
  Array<std::uint32_t> with_uv;
  for (std::size_t k = 0; k < cloud.size(); ++k) {
    if (k % 10 == 0) {
      cloud.uv[k].x() = std::numeric_limits<float>::quiet_NaN();
    } else {
      with_uv.push_back(static_cast<std::uint32_t>(k));
    }
  }
  SurfelCloud others = cloud.gathered(with_uv);
  SurfelCloud ewa = cloud;
  fit_texture(ewa, textures, {});
  TextureFitOptions options = fit_of(TextureFitKind::kGram);
  options.tolerance = 1e-10;
  const TextureFitReport report = fit_texture(cloud, textures, options);
  EXPECT_EQ(report.without_uv, 40U);
  EXPECT_EQ(report.system->functions, with_uv.size());
  fit_texture(others, textures, options);
  for (std::size_t i = 0; i < with_uv.size(); ++i) {
    ASSERT_LT((cloud.coefficient[with_uv[i]] - others.coefficient[i]).norm(), 1e-5F);
  }
  for (std::size_t k = 0; k < cloud.size(); k += 10) {
    EXPECT_EQ(cloud.coefficient[k], ewa.coefficient[k]);
  }
}

TEST(CoefficientFit, SameForAnyNumberOfThreads) {
  TextureSet textures = one_map(noise_image(32, 32, 5));
  for (const TextureFitKind kind : {TextureFitKind::kGram, TextureFitKind::kRender}) {
    SurfelCloud first;
    for (const int threads : {1, 2, 5}) {
      set_thread_count(threads);
      SurfelCloud cloud = grid(60, 0.7);
      fit_texture(cloud, textures, fit_of(kind));
      if (threads == 1) first = cloud;
      ASSERT_EQ(largest_difference(first, cloud), 0);
    }
    set_thread_count(0);
  }
}

TEST(CoefficientFit, ColorsAreTakenAtThePoints) {
  SurfelCloud cloud = grid(40, 0.7);
  for (const Vec2f& p : cloud.uv) {
    cloud.color.push_back(
        Vec3f::Constant(0.5F + 0.4F * std::sin(60 * p.x()) * std::cos(50 * p.y())));
  }
  TextureFitOptions options = fit_of(TextureFitKind::kRender);
  const TextureFitReport report = fit_colors(cloud, options);
  ASSERT_TRUE(report.system);
  EXPECT_EQ(report.system->lambda, kColorRegularization);
  EXPECT_LT(report.system->error, 0.8 * report.system->error_ewa);
  cloud.color[5].x() = std::numeric_limits<float>::infinity();
  EXPECT_THROW(fit_colors(cloud, options), Error);
  cloud.color.clear();
  EXPECT_THROW(fit_colors(cloud, options), Error);
}

TEST(CoefficientFit, UnusableOptionsAreNamed) {
  const auto refused = [](auto change) {
    TextureFitOptions options = fit_of(TextureFitKind::kRender);
    change(options);
    return options.problems().size();
  };
  EXPECT_EQ(refused([](TextureFitOptions&) {}), 0U);
  EXPECT_EQ(refused([](TextureFitOptions& o) { o.tolerance = 0; }), 1U);
  EXPECT_EQ(refused([](TextureFitOptions& o) { o.lambda = 0; }), 1U);
  EXPECT_EQ(refused([](TextureFitOptions& o) { o.lambda = -1; }), 1U);
  EXPECT_EQ(refused([](TextureFitOptions& o) { o.cutoff = 0; }), 1U);
  EXPECT_EQ(refused([](TextureFitOptions& o) { o.right_side = GramRightSide::kPublished; }), 1U);
  EXPECT_EQ(refused([](TextureFitOptions& o) { o.points = 0; }), 1U);
  EXPECT_EQ(refused([](TextureFitOptions& o) { o.bounds = {1, 0}; }), 1U);
  EXPECT_EQ(refused([](TextureFitOptions& o) { o.robust_scale = 0; }), 1U);
  const auto refused_together = [&](bool robust, bool refine, auto change) {
    return refused([&](TextureFitOptions& o) {
      o.robust = robust;
      o.refine_variance = refine;
      change(o);
    });
  };
  EXPECT_EQ(refused_together(true, false, [](TextureFitOptions&) {}), 0U);
  EXPECT_EQ(refused_together(false, true, [](TextureFitOptions&) {}), 0U);
  EXPECT_EQ(refused_together(true, true, [](TextureFitOptions&) {}), 1U);
  for (const bool robust : {false, true}) {
    EXPECT_EQ(refused_together(robust, !robust,
                               [](TextureFitOptions& o) { o.kind = TextureFitKind::kGram; }),
              1U);
    EXPECT_EQ(refused_together(robust, !robust,
                               [](TextureFitOptions& o) {
                                 o.bounds = {0, 1};
                               }),
              1U);
  }
  EXPECT_EQ(refused([](TextureFitOptions& o) {
              o.bounds = {0, 1};
              o.solver = FitSolver::kCeres;
            }),
            1U);
}

}  // namespace
}  // namespace surfel
