#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/texture/filtered_checker.h>
#include <surfel/texture/filtered_noise.h>
#include <surfel/texture/solid_texture.h>

namespace surfel {
namespace {

constexpr std::array kSolidPatterns{SolidPattern::kChecker, SolidPattern::kNoise,
                                    SolidPattern::kMarble, SolidPattern::kWood};

/// Places and turned kernels, some along the axes.
class Kernels {
 public:
  Vec3d place(double size) { return size * Vec3d(uniform(), uniform(), uniform()); }
  KernelAxes axes(double deviation, double ratio) {
    Eigen::Quaterniond turn(normal_(generator_), normal_(generator_), normal_(generator_),
                            normal_(generator_));
    turn.normalize();
    if (++made_ % 6 == 0) turn.setIdentity();
    KernelAxes axes;
    axes << deviation * (turn * Vec3d::UnitX()), ratio * deviation * (turn * Vec3d::UnitY());
    return axes;
  }
  double uniform() { return uniform_(generator_); }

 private:
  std::mt19937 generator_{3};
  std::normal_distribution<double> normal_;
  std::uniform_real_distribution<double> uniform_{0, 1};
  int made_ = 0;
};

/// The mean over the Gaussian by n x n points, one at a random place in every cell of a grid.
template <class Function>
double integral(const Vec3d& place, const KernelAxes& axes, int n, Kernels& random,
                const Function& function) {
  constexpr double kHalf = 4.5;
  double sum = 0;
  double weights = 0;
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) {
      const Vec2d z(2 * kHalf * (i + random.uniform()) / n - kHalf,
                    2 * kHalf * (j + random.uniform()) / n - kHalf);
      const double weight = std::exp(-z.squaredNorm() / 2);
      sum += weight * function(Vec3d(place + axes * z));
      weights += weight;
    }
  }
  return sum / weights;
}

SolidTexture black_and_white(SolidPattern pattern, int octaves = 8) {
  SolidTextureOptions options;
  options.pattern = pattern;
  options.feature_size = 1;
  options.octaves = octaves;
  options.dark = Vec3f(0, 0, 0);
  options.light = Vec3f(1, 1, 1);
  return {options, Bounds{}};
}

double checker_at(const Vec3d& p) {
  const double cubes = std::floor(p.x()) + std::floor(p.y()) + std::floor(p.z());
  return std::fmod(cubes, 2) == 0 ? 1 : -1;
}

TEST(FilteredChecker, IsTheIntegralOverTheGaussian) {
  Kernels random;
  for (const double deviation : {0.05, 0.2, 0.38, 0.42, 0.8, 2.0}) {
    for (const double ratio : {1.0, 0.2}) {
      for (int k = 0; k < 8; ++k) {
        const Vec3d place = random.place(6) - Vec3d::Constant(3);
        const KernelAxes axes = random.axes(deviation, ratio);
        // The integral's own error is about 0.001.
        EXPECT_NEAR(filtered_checker(place, axes), integral(place, axes, 400, random, checker_at),
                    0.008)
            << deviation << ' ' << ratio << ' ' << place.transpose();
      }
    }
  }
}

TEST(FilteredChecker, IsASquareWaveUnderANormalDistributionBesideOneBorder) {
  // Across x = 1 at 0.1, with the plane along y and x; the next borders are out of reach.
  KernelAxes axes;
  axes << 0.1, 0, 0, 0.001, 0, 0;
  const double beyond = 0.5 * std::erfc(0.1 / 0.1 / std::sqrt(2.0));
  EXPECT_NEAR(filtered_checker({0.9, 0.5, 0.5}, axes), 1 - 2 * beyond, 1e-9);
}

TEST(FilteredChecker, DoesNotDependOnTheAxesThatNameTheGaussian) {
  Kernels random;
  for (const double deviation : {0.1, 1.0}) {
    const Vec3d place = random.place(2);
    const KernelAxes axes = random.axes(deviation, 0.5);
    KernelAxes turned;
    turned << 0.6 * axes.col(0) + 0.8 * axes.col(1), 0.8 * axes.col(0) - 0.6 * axes.col(1);
    EXPECT_NEAR(filtered_checker(place, axes), filtered_checker(place, turned), 1e-9);
  }
}

TEST(FilteredChecker, LongAndFarKernelsAreFinite) {
  KernelAxes axes;
  axes << 1e6, 0, 0, 1e-6, 0, 0;
  EXPECT_LE(std::abs(filtered_checker({0.5, 0.5, 0.5}, axes)), 0.01);
  EXPECT_EQ(filtered_checker({1e300, 0, 0}, axes), 0);
  axes *= 1e9;
  EXPECT_LE(std::abs(filtered_checker({0.5, 0.5, 0.5}, axes)), 0.01);
}

TEST(FilteredNoise, ConstantsAreTheNoises) {
  Kernels random;
  double square = 0;
  double slope = 0;
  constexpr int kPlaces = 200000;
  for (int k = 0; k < kPlaces; ++k) {
    const NoiseValue<3> noise =
        independent_noise(random.place(1000), static_cast<std::uint64_t>(k % 7));
    square += noise.value * noise.value / kPlaces;
    slope += noise.gradient.squaredNorm() / 3 / kPlaces;
  }
  EXPECT_NEAR(square, kNoiseVariance, 0.01 * kNoiseVariance);
  EXPECT_NEAR(slope / square, kNoiseBandwidth, 0.02 * kNoiseBandwidth);
}

TEST(FilteredNoise, ResponseIsTheRegressionOfTheAverageOnTheNoise) {
  for (const double deviation : {0.1, 0.3, 0.6, 1.0}) {
    Kernels random;
    double products = 0;
    double squares = 0;
    for (int k = 0; k < 60000; ++k) {
      const Vec3d place = random.place(1000);
      const KernelAxes axes = random.axes(deviation, 1);
      // A random point of the Gaussian stands for all of it.
      const double radius = std::sqrt(-2 * std::log(1 - random.uniform()));
      const double angle = 6.283185307179586 * random.uniform();
      const Vec3d beside = place + radius * (axes * Vec2d(std::cos(angle), std::sin(angle)));
      const double noise = independent_noise(place, 1).value;
      products += noise * independent_noise(beside, 1).value;
      squares += noise * noise;
    }
    KernelAxes axes;
    axes << deviation, 0, 0, deviation, 0, 0;
    EXPECT_NEAR(noise_response(axes), products / squares, 0.025) << deviation;
  }
}

TEST(FilteredNoise, HasAMeanSquareOfOneAndTheVarianceThatAveragingTakes) {
  const SolidNoise spectrum{6, 0.6, Vec3d(1, 2, 0.5), 9};
  Kernels random;
  const FilteredNoise at_points(spectrum, KernelAxes::Zero());
  double square = 0;
  for (int k = 0; k < 20000; ++k) {
    const NoiseMoments moments = at_points.at(random.place(500));
    EXPECT_EQ(moments.variance, 0);
    square += moments.mean * moments.mean / 20000;
  }
  EXPECT_NEAR(square, 1, 0.05);
  for (const double deviation : {0.05, 0.3, 2.0, 100.0}) {
    KernelAxes axes;
    axes << deviation, 0, 0, deviation, 0, 0;
    const FilteredNoise averaged(spectrum, axes);
    double within = 0;
    double kept = 0;
    for (int k = 0; k < 4000; ++k) {
      const NoiseMoments moments = averaged.at(random.place(500));
      within += (moments.variance + (axes.transpose() * moments.gradient).squaredNorm()) / 4000;
      kept += moments.mean * moments.mean / 4000;
    }
    // Noise is spread about its average: together both have the noise's mean square.
    EXPECT_LE(within + kept, 1.05) << deviation;
    EXPECT_GE(within + kept, 0.75) << deviation;
    if (deviation == 100) {
      EXPECT_EQ(kept, 0);
      EXPECT_NEAR(within, 1, 1e-3);
    }
  }
}

TEST(SolidTexture, AverageIsTheIntegralOfThePoints) {
  Kernels random;
  for (const SolidPattern pattern : kSolidPatterns) {
    const SolidTexture texture = black_and_white(pattern);
    const auto at = [&](const Vec3d& p) { return static_cast<double>(texture.evaluate(p)[0]); };
    for (const double deviation : {0.02, 0.1, 0.4, 1.5}) {
      constexpr int kTimes = 24;
      double error2 = 0;
      double point2 = 0;
      for (int k = 0; k < kTimes; ++k) {
        const Vec3d place = random.place(30);
        const KernelAxes axes = random.axes(deviation, 0.7);
        const double truth = integral(place, axes, 24, random, at);
        const double error = static_cast<double>(texture.filtered(place, axes)[0]) - truth;
        error2 += error * error / kTimes;
        point2 += std::pow(at(place) - truth, 2) / kTimes;
      }
      // Shares of the range of colours; the integral's own error is up to 0.01.
      EXPECT_LE(std::sqrt(error2), 0.06) << static_cast<int>(pattern) << ' ' << deviation;
      EXPECT_LE(error2, 0.25 * point2) << static_cast<int>(pattern) << ' ' << deviation;
    }
  }
}

TEST(SolidTexture, LargeKernelsHaveTheMeanOfAllSpace) {
  for (const SolidPattern pattern : kSolidPatterns) {
    const SolidTexture texture = black_and_white(pattern);
    Kernels random;
    double sum = 0;
    for (int k = 0; k < 20000; ++k) {
      sum += static_cast<double>(texture.evaluate(random.place(200))[0]) / 20000;
    }
    EXPECT_NEAR(sum, static_cast<double>(texture.mean()[0]), 0.012) << static_cast<int>(pattern);
    double before = 1;
    for (const double deviation : {0.1, 1.0, 10.0, 1000.0}) {
      double largest = 0;
      for (int k = 0; k < 40; ++k) {
        KernelAxes axes;
        axes << deviation, 0, 0, 0.8 * deviation, 0.3 * deviation, 0;
        const Vec3f color = texture.filtered(random.place(30), axes);
        largest = std::max(largest, std::abs(static_cast<double>(color[0] - texture.mean()[0])));
      }
      EXPECT_LE(largest, before + 1e-3) << static_cast<int>(pattern) << ' ' << deviation;
      before = largest;
    }
    EXPECT_LE(before, 0.002) << static_cast<int>(pattern);
  }
}

TEST(SolidTexture, StaysBetweenItsColors) {
  SolidTextureOptions options;
  options.feature_size = 0.3;
  options.dark = Vec3f(0.1F, 0.5F, 0.2F);
  options.light = Vec3f(0.4F, 0.3F, 0.2F);
  for (const SolidPattern pattern : kSolidPatterns) {
    options.pattern = pattern;
    const SolidTexture texture(options, Bounds{});
    Kernels random;
    for (int k = 0; k < 300; ++k) {
      const Vec3f color = texture.filtered(random.place(10), random.axes(0.03 * (k % 20), 0.5));
      EXPECT_GE(color[0], 0.1F);
      EXPECT_LE(color[0], 0.4F);
      EXPECT_GE(color[1], 0.3F);
      EXPECT_LE(color[1], 0.5F);
      EXPECT_EQ(color[2], 0.2F);
    }
  }
}

TEST(SolidTexture, FollowsTheBoundsInPlaceAndSize) {
  Bounds bounds;
  bounds.add({-1, -1, -1});
  bounds.add({1, 2, 1});
  const Vec3d shift(5e6, -4e6, 2e6);
  Bounds moved;
  moved.add(shift + 8 * bounds.min);
  moved.add(shift + 8 * bounds.max);
  Kernels random;
  for (const SolidPattern pattern : kSolidPatterns) {
    SolidTextureOptions options;
    options.pattern = pattern;
    const SolidTexture near(options, bounds);
    const SolidTexture far(options, moved);
    EXPECT_NEAR(far.feature_size(), 8 * near.feature_size(), 1e-6);
    for (int k = 0; k < 50; ++k) {
      const Vec3d place = random.place(2) - Vec3d(1, 0.5, 1);
      const KernelAxes axes = random.axes(0.02, 0.8);
      const Vec3f a = near.filtered(place, axes);
      const Vec3f b = far.filtered(shift + 8 * place, 8 * axes);
      EXPECT_TRUE(a.isApprox(b, 1e-4F)) << static_cast<int>(pattern) << a << b;
    }
  }
}

TEST(SolidTexture, SeedsAndOctavesChangeNoiseAlone) {
  SolidTextureOptions options;
  options.feature_size = 1;
  const Vec3d place(0.3, 0.7, 0.2);
  for (const SolidPattern pattern : kSolidPatterns) {
    options.pattern = pattern;
    options.seed = 1;
    options.octaves = 8;
    const Vec3f first = SolidTexture(options, Bounds{}).evaluate(place);
    EXPECT_EQ(first, SolidTexture(options, Bounds{}).evaluate(place));
    options.seed = 2;
    const Vec3f seeded = SolidTexture(options, Bounds{}).evaluate(place);
    options.seed = 1;
    options.octaves = 2;
    const Vec3f smooth = SolidTexture(options, Bounds{}).evaluate(place);
    EXPECT_EQ(first == seeded, pattern == SolidPattern::kChecker);
    EXPECT_EQ(first == smooth, pattern == SolidPattern::kChecker);
  }
}

TEST(SolidTexture, PlacesThatAreNotFiniteHaveTheMean) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const SolidPattern pattern : kSolidPatterns) {
    const SolidTexture texture = black_and_white(pattern, 16);
    EXPECT_EQ(texture.evaluate({nan, 0, 0}), texture.mean());
    EXPECT_EQ(texture.filtered({0, 0, 0}, KernelAxes::Constant(nan)), texture.mean());
    EXPECT_TRUE(texture.evaluate({1e300, -1e300, 1e200}).allFinite());
    EXPECT_TRUE(texture.filtered({1, 2, 3}, KernelAxes::Constant(1e200)).allFinite());
  }
}

TEST(SolidTextureOptions, DefaultsAreValidAndBadValuesAreNamed) {
  EXPECT_TRUE(SolidTextureOptions{}.problems().empty());
  const auto expect_named = [](const SolidTextureOptions& options, const char* field) {
    ASSERT_EQ(options.problems().size(), 1U) << field;
    EXPECT_NE(options.problems()[0].find(field), std::string::npos);
    EXPECT_THROW(SolidTexture(options, Bounds{}), Error);
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const double bad : {0.0, -1.0, nan}) {
    expect_named({.frequency = bad}, "frequency");
    expect_named({.feature_size = bad}, "feature_size");
  }
  expect_named({.frequency = 2, .feature_size = 3}, "feature_size");
  expect_named({.center = Vec3d(0, nan, 0)}, "center");
  expect_named({.octaves = 0}, "octaves");
  expect_named({.octaves = 17}, "octaves");
  expect_named({.dark = Vec3f(0, -1, 0)}, "dark");
  expect_named({.light = Vec3f(0, std::numeric_limits<float>::infinity(), 0)}, "light");
}

TEST(SolidTextureOptions, AreNamedAsImagesAre) {
  EXPECT_EQ(solid_texture_options("wood").pattern, SolidPattern::kWood);
  EXPECT_FALSE(solid_texture_options("wood").frequency);
  EXPECT_EQ(solid_texture_options("checker:2.5").frequency, 2.5);
  for (const char* bad : {"", "oak", "wood:", "wood:x", "wood:1x", "wood:0", "wood:1e7", "wood:-1",
                          "wood:nan", ":3"}) {
    EXPECT_THROW(solid_texture_options(bad), Error) << bad;
  }
}

}  // namespace
}  // namespace surfel
