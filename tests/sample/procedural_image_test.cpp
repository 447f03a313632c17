#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/sample/procedural_image.h>
#include <surfel/sample/procedural_sky.h>
#include <surfel/scene/lat_long.h>

namespace surfel {
namespace {

TEST(ProceduralTexture, CheckerAlternatesAlsoBelowZero) {
  ProceduralTextureOptions options;
  options.frequency = 4;
  const ProceduralTexture checker = procedural_texture("checker", options);
  for (int i = -8; i < 8; ++i) {
    for (int j = -8; j < 8; ++j) {
      const Vec3f expected = (i + j) % 2 == 0 ? options.dark : options.light;
      EXPECT_EQ(checker((i + 0.5) / 4, (j + 0.5) / 4), expected) << i << ' ' << j;
    }
  }
}

TEST(ProceduralTexture, SiemensStarHasItsSpokes) {
  ProceduralTextureOptions options;
  options.frequency = 7;
  const ProceduralTexture star = procedural_texture("siemens", options);
  int changes = 0;
  bool light = star(0.9, 0.5 + 1e-6).x() > 0;
  constexpr int kSteps = 10000;
  for (int i = 1; i <= kSteps; ++i) {
    const double angle = 6.283185307179586 * i / kSteps + 1e-5;
    const bool now = star(0.5 + 0.4 * std::cos(angle), 0.5 + 0.4 * std::sin(angle)).x() > 0;
    changes += now != light;
    light = now;
  }
  EXPECT_EQ(changes, 14);
  EXPECT_EQ(star(0.01, 0.01), options.dark);
}

TEST(ProceduralTexture, NoiseStaysInRangeAndFollowsItsSeed) {
  ProceduralTextureOptions options;
  const ProceduralTexture one = procedural_texture("noise", options);
  options.seed = 2;
  const ProceduralTexture two = procedural_texture("noise", options);
  double difference = 0;
  for (int i = 0; i < 1000; ++i) {
    const Vec3f color = one(i * 0.0137, i * 0.0071);
    EXPECT_GE(color.minCoeff(), 0);
    EXPECT_LE(color.maxCoeff(), 1);
    difference += (color - two(i * 0.0137, i * 0.0071)).norm();
  }
  EXPECT_GT(difference, 100);
}

TEST(ProceduralTexture, RefusesUnknownNamesAndBadFrequencies) {
  EXPECT_THROW(procedural_texture("marble"), Error);
  ProceduralTextureOptions options;
  EXPECT_TRUE(options.problems().empty());
  options.frequency = 0;
  EXPECT_THROW(procedural_texture("checker", options), Error);
}

TEST(Rasterize, TopRowIsVOneAndPixelsAreMeans) {
  const ProceduralTexture ramp = [](double u, double v) {
    return Vec3d(u, v, u * u).cast<float>().eval();
  };
  const Image image = rasterize(ramp, 4, 2, 8);
  ASSERT_EQ(image.data.size(), 4u * 2 * 4);
  EXPECT_NEAR(image.pixel(1, 0)[0], 0.375f, 1e-6f);
  EXPECT_NEAR(image.pixel(1, 0)[1], 0.75f, 1e-6f);
  EXPECT_NEAR(image.pixel(3, 1)[1], 0.25f, 1e-6f);
  EXPECT_NEAR(image.pixel(3, 0)[2], 0.7708f, 1e-3f);  // Mean of u^2 over [3/4, 1].
  EXPECT_EQ(image.pixel(2, 1)[3], 1);
  EXPECT_THROW(rasterize(ramp, 0, 2), Error);
}

TEST(ProceduralSky, IsBrightAboveAndCheckeredBelow) {
  const Image sky = procedural_sky(64, 32);
  ASSERT_EQ(sky.data.size(), 64U * 32 * 4);
  float brightest = 0;
  for (const float value : sky.data) {
    ASSERT_TRUE(std::isfinite(value));
    EXPECT_GE(value, 0);
    brightest = std::max(brightest, value);
  }
  EXPECT_GT(brightest, 5);  // The sun, seen as a lat-long map's row is: +y on top.
  const Vec3f up = procedural_sky_radiance({0, 1, 0});
  EXPECT_LT((Eigen::Map<const Vec3f>(sky.pixel(9, 0)) - up).norm(), 0.2F);
  EXPECT_NE(procedural_sky_radiance({0.25, -1, 0.25}), procedural_sky_radiance({0.75, -1, 0.25}));
  EXPECT_EQ(procedural_sky_radiance({0.25, -1, 0.25}), procedural_sky_radiance({0.5, -2, 0.5}));
  EXPECT_THROW(procedural_sky(64, 64), Error);
}

TEST(ProceduralSky, PixelsAreMeansOfATentTwoPixelsWide) {
  constexpr int kHeight = 256;
  constexpr int kStep = 5;  // Not all pixels, for the time it takes.
  constexpr int kPoints = 16;
  const Image sky = procedural_sky(2 * kHeight, kHeight);
  double sum = 0;
  int count = 0;
  for (int y = 0; y < kHeight; y += kStep) {
    for (int x = y % 3; x < 2 * kHeight; x += kStep, ++count) {
      Vec3d mean(0, 0, 0);
      double total = 0;
      for (int i = 0; i < kPoints * kPoints; ++i) {
        const double dx = 2 * (i % kPoints + 0.5) / kPoints - 1;
        const double dy = 2 * (i / kPoints + 0.5) / kPoints - 1;
        const double w = (1 - std::abs(dx)) * (1 - std::abs(dy));
        mean += w * procedural_sky_radiance(lat_long_direction((x + 0.5 + dx) / (2 * kHeight),
                                                               (y + 0.5 + dy) / kHeight))
                        .cast<double>();
        total += w;
      }
      mean /= total;
      const Vec3d pixel = Eigen::Map<const Vec3f>(sky.pixel(x, y)).cast<double>();
      // Few points see an edge, or the far squares of the floor, a little differently.
      EXPECT_LT((pixel - mean).norm(), 0.1 + 0.15 * mean.norm()) << x << ' ' << y;
      sum += (pixel - mean).norm();
    }
  }
  EXPECT_LT(sum / count, 0.01);
}

}  // namespace
}  // namespace surfel
