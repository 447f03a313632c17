#include <numbers>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/texture/texture_map.h>

#include "texture_support.h"

namespace surfel {
namespace {

using test::brute_force;
using test::difference;
using test::make_image;
using test::noise_image;
using test::turned_kernel;

constexpr WrapMode kWraps[] = {WrapMode::kRepeat, WrapMode::kMirror, WrapMode::kClamp};

/// A map with all levels that the kernel asks for.
TextureSample filtered(const Image& image, WrapMode wrap, const TexelKernel& kernel) {
  TextureMap map(image, wrap);
  map.build(GaussianPyramid::level_for(principal_variances(kernel.variance).minor));
  return map.sample(kernel);
}

TEST(TextureMap, ConstantImageStaysConstantAtEveryLevelAndPlace) {
  const Image image = make_image(37, 53, [](int, int) { return Eigen::Vector4f(0.3F, 2, 0, 1); });
  for (const WrapMode wrap : kWraps) {
    for (const double sigma : {0.5, 1.0, 3.0, 11.0, 60.0, 5000.0}) {
      for (const Vec2d& center : {Vec2d(18, 20), Vec2d(0, 53), Vec2d(-4000, 1e9)}) {
        const TextureSample sample =
            filtered(image, wrap, turned_kernel(center, 3 * sigma, sigma, 1));
        EXPECT_NEAR(sample.color.x(), 0.3, 3e-6);
        EXPECT_NEAR(sample.color.y(), 2, 2e-5);
        EXPECT_EQ(sample.color.z(), 0);
        EXPECT_EQ(sample.alpha, 1);
      }
    }
  }
}

TEST(TextureMap, LinearRampGivesTheValueAtTheCentre) {
  // Far enough from the borders, at several levels.
  const Image image = make_image(400, 300, [](int x, int y) {
    return Eigen::Vector4f(static_cast<float>(x + 0.5) / 400, static_cast<float>(y + 0.5) / 300, 0,
                           1);
  });
  for (const double sigma : {1.0, 4.0, 9.0, 20.0}) {
    const Vec2d center(201.3, 148.6);
    const TextureSample sample =
        filtered(image, WrapMode::kClamp, turned_kernel(center, 1.4 * sigma, sigma, 0.4));
    EXPECT_NEAR(sample.color.x(), center.x() / 400, 2e-5) << sigma;
    EXPECT_NEAR(sample.color.y(), center.y() / 300, 2e-5) << sigma;
  }
}

TEST(TextureMap, OneBrightTexelGivesTheGaussianItself) {
  const Image image = make_image(64, 64, [](int x, int y) {
    return Eigen::Vector4f(x == 30 && y == 33 ? 1.0F : 0.0F, 0, 0, 1);
  });
  const TextureMap map(image, WrapMode::kRepeat);
  for (const double aspect : {1.0, 2.5}) {
    for (const double angle : {0.0, 0.7, 2.1}) {
      for (int step = 0; step < 60; ++step) {
        const Vec2d offset(0.37 + 0.11 * step, 2.9 - 0.17 * step);
        const TexelKernel kernel = turned_kernel(Vec2d(30.5, 33.5) + offset, aspect, 1, angle);
        const double peak = 1 / (2 * std::numbers::pi * aspect);
        const double exact = peak * std::exp(-offset.dot(kernel.variance.inverse() * offset) / 2);
        EXPECT_NEAR(map.sample(kernel).color.x(), exact, 1e-4 * peak);
      }
    }
  }
}

TEST(TextureMap, AgreesWithTheDoubleSumInsideAndAcrossBordersForEveryWrap) {
  for (const bool alpha : {false, true}) {
    const Image image = noise_image(41, 27, 7, alpha);
    for (const WrapMode wrap : kWraps) {
      for (const Vec2d& center :
           {Vec2d(20, 13), Vec2d(0.2, 0.1), Vec2d(40.9, 13), Vec2d(41, 27), Vec2d(-95.3, 260.4)}) {
        const TexelKernel kernel = turned_kernel(center, 2.1, 1.2, 0.6);
        EXPECT_LT(difference(filtered(image, wrap, kernel), brute_force(image, wrap, kernel)), 1e-4)
            << center.transpose();
      }
    }
  }
}

TEST(TextureMap, PyramidAgreesWithTheDoubleSum) {
  // White noise and a checkerboard whose period beats with the levels' pitch.
  const Image images[] = {noise_image(256, 256, 3), noise_image(201, 117, 4, true),
                          make_image(190, 190, [](int x, int y) {
                            const float value = (x / 19 + y / 19) % 2 ? 1.0F : 0.0F;
                            return Eigen::Vector4f(value, 1 - value, value, 1);
                          })};
  double worst = 0;
  double sum = 0;
  int count = 0;
  for (const Image& image : images) {
    for (const WrapMode wrap : kWraps) {
      for (const double sigma : {2.3, 2.4, 4.0, 4.8, 7.0, 13.0, 27.0}) {
        for (const double aspect : {1.0, 3.0}) {
          for (const Vec2d& center : {Vec2d(0.5, 0.45), Vec2d(0.03, 0.99), Vec2d(1.2, -0.1)}) {
            const TexelKernel kernel =
                turned_kernel(center.cwiseProduct(Vec2d(image.width, image.height)), aspect * sigma,
                              sigma, 0.3 + sigma);
            const double error =
                difference(filtered(image, wrap, kernel), brute_force(image, wrap, kernel));
            worst = std::max(worst, error);
            sum += error;
            ++count;
          }
        }
      }
    }
  }
  RecordProperty("worst", std::to_string(worst));
  RecordProperty("mean", std::to_string(sum / count));
  EXPECT_LT(worst, 2e-3);
  EXPECT_LT(sum / count, 2e-4);
}

TEST(TextureMap, WorstSineWavesStayWithinTheBoundOfTheHeader) {
  // Waves near a level's sampling frequency, seen by the narrowest kernel that the level gets.
  double worst = 0;
  for (const int level : {1, 2, 3}) {
    const double pitch = 1 << level;
    for (const double frequency : {0.3, 0.4, 0.45, 0.5, 0.55, 0.6, 0.7, 1.0}) {
      const Image image = make_image(256, 4, [&](int x, int) {
        const double phase = 2 * std::numbers::pi * frequency * (x + 0.5) / pitch;
        return Eigen::Vector4f(static_cast<float>(0.5 + 0.5 * std::cos(phase)), 0, 0, 1);
      });
      const double sigma = std::sqrt(1.4001) * pitch;
      for (int step = 0; step < 16; ++step) {
        const TexelKernel kernel = turned_kernel({128 + 0.37 * step, 2}, sigma, sigma, 0);
        worst = std::max(worst, difference(filtered(image, WrapMode::kRepeat, kernel),
                                           brute_force(image, WrapMode::kRepeat, kernel)));
      }
    }
  }
  RecordProperty("worst", std::to_string(worst));
  EXPECT_LT(worst, 1.5e-3);
}

TEST(TextureMap, HugeKernelsSeeTheMeanOrTheBorder) {
  const Image image = make_image(96, 64, [](int x, int) {
    return Eigen::Vector4f(x < 32 ? 1.0F : 0.0F, x == 0 ? 1.0F : 0.0F, 0, 1);
  });
  const TexelKernel kernel = turned_kernel({48, 32}, 3000, 1000, 0);
  for (const WrapMode wrap : {WrapMode::kRepeat, WrapMode::kMirror}) {
    const TextureSample sample = filtered(image, wrap, kernel);
    EXPECT_NEAR(sample.color.x(), 1.0 / 3, 1e-3);
    EXPECT_NEAR(sample.color.y(), 1.0 / 96, 1e-3);
  }
  // Clamped: all that lies to the left of the image's first column has its colour.
  const auto left_of = [&](double x) { return std::erfc((48 - x) / 3000 / std::sqrt(2)) / 2; };
  const TextureSample sample = filtered(image, WrapMode::kClamp, kernel);
  EXPECT_NEAR(sample.color.x(), left_of(32), 2e-3);
  EXPECT_NEAR(sample.color.y(), left_of(1), 2e-3);
}

TEST(TextureMap, ColoursOfTransparentTexelsDoNotBleed) {
  const Image image = make_image(32, 32, [](int x, int) {
    return x < 16 ? Eigen::Vector4f(1, 0, 0, 1) : Eigen::Vector4f(0, 1, 0, 0);
  });
  const TextureMap map(image, WrapMode::kClamp);
  EXPECT_TRUE(map.has_alpha());
  const TextureSample edge = map.sample(turned_kernel({16, 16}, 2, 2, 0));
  EXPECT_EQ(edge.color, Vec3f(1, 0, 0));
  EXPECT_NEAR(edge.alpha, 0.5, 1e-5);
  const TextureSample outside = map.sample(turned_kernel({30, 16}, 1, 1, 0));
  EXPECT_EQ(outside.alpha, 0);
  EXPECT_TRUE(outside.color.allFinite());
}

TEST(TextureMap, OneTexelIsEverywhere) {
  const Image image = make_image(1, 1, [](int, int) { return Eigen::Vector4f(0.25F, 0.5F, 1, 1); });
  for (const WrapMode wrap : kWraps) {
    for (const double sigma : {0.3, 1.0, 40.0, 1e6}) {
      EXPECT_EQ(filtered(image, wrap, turned_kernel({1e7, -3}, 2 * sigma, sigma, 1)).color,
                Vec3f(0.25F, 0.5F, 1));
    }
  }
}

TEST(TextureMap, AbsurdPlacesAreFinite) {
  const Image image = noise_image(33, 9, 5);
  for (const WrapMode wrap : kWraps) {
    for (const double x : {1e15, -1e30, 3e38}) {
      const TextureSample sample = filtered(image, wrap, turned_kernel({x, -x}, 700, 30, 0.5));
      EXPECT_TRUE(sample.color.allFinite());
      EXPECT_LE(sample.color.maxCoeff(), 1);
      EXPECT_GE(sample.color.minCoeff(), 0);
    }
  }
}

TEST(TextureMap, ValuesThatAreNotFiniteDoNotSpread) {
  Image image = noise_image(8, 8, 5);
  image.pixel(3, 3)[0] = std::numeric_limits<float>::quiet_NaN();
  image.pixel(5, 3)[1] = std::numeric_limits<float>::infinity();
  EXPECT_TRUE(filtered(image, WrapMode::kRepeat, turned_kernel({4, 4}, 2, 2, 0)).color.allFinite());
}

TEST(TextureMap, RefusesAnImageWithoutPixelsOrColours) {
  EXPECT_THROW(TextureMap(Image{}, WrapMode::kRepeat), Error);
  Image grey = noise_image(2, 2, 1);
  grey.channels = {"Y"};
  EXPECT_THROW(TextureMap(grey, WrapMode::kRepeat), Error);
}

}  // namespace
}  // namespace surfel
