#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>

#include <gtest/gtest.h>
#include <surfel/base/color.h>

namespace surfel {
namespace {

// IEC 61966-2-1, written out again in double as the truth.
double decode(double s) { return s <= 0.04045 ? s / 12.92 : std::pow((s + 0.055) / 1.055, 2.4); }
double encode(double l) {
  return l <= 0.0031308 ? 12.92 * l : 1.055 * std::pow(l, 1 / 2.4) - 0.055;
}
int encode_rounded(double linear, int largest) {
  return static_cast<int>(std::lround(std::clamp(encode(linear), 0.0, 1.0) * largest));
}

TEST(Color, DecodesAndEncodesEvery8BitValue) {
  for (int i = 0; i < 256; ++i) {
    const float linear = srgb8_to_linear(static_cast<std::uint8_t>(i));
    EXPECT_EQ(linear, static_cast<float>(decode(i / 255.0))) << i;
    EXPECT_EQ(linear_to_srgb8(linear), i);
  }
}

TEST(Color, DecodesAndEncodesEvery16BitValue) {
  for (int i = 0; i < 65536; ++i) {
    const float linear = srgb16_to_linear(static_cast<std::uint16_t>(i));
    ASSERT_EQ(linear, static_cast<float>(decode(i / 65535.0))) << i;
    ASSERT_EQ(linear_to_srgb16(linear), i);
  }
}

TEST(Color, RoundsTo8BitsExactlyAtTheThresholds) {
  for (int i = 1; i < 256; ++i) {
    const auto threshold = static_cast<float>(decode((i - 0.5) / 255));
    float linear = std::nextafter(std::nextafter(threshold, 0.0F), 0.0F);
    for (int step = 0; step < 5; ++step, linear = std::nextafter(linear, 2.0F)) {
      EXPECT_EQ(linear_to_srgb8(linear), encode_rounded(linear, 255)) << i << " " << linear;
    }
  }
}

/// Between two neighbours among these and the thresholds the encoder does the same: with them every
/// float is tested.
TEST(Color, RoundsTo8BitsExactlyWhereStepsOfItsTableMeet) {
  for (std::uint32_t step = 0; step <= 0x7f80; ++step) {
    const auto first = std::bit_cast<float>(step << 16);
    const float last = std::nextafter(first, -1.0F);
    EXPECT_EQ(linear_to_srgb8(first), encode_rounded(std::min(first, 2.0F), 255)) << first;
    EXPECT_EQ(linear_to_srgb8(last), encode_rounded(std::clamp(last, 0.0F, 2.0F), 255)) << last;
  }
}

TEST(Color, RoundsTo16BitsExactlyAtTheThresholds) {
  for (int i = 1; i < 65536; ++i) {
    const auto threshold = static_cast<float>(decode((i - 0.5) / 65535));
    for (const float linear :
         {std::nextafter(threshold, 0.0F), threshold, std::nextafter(threshold, 2.0F)}) {
      ASSERT_EQ(linear_to_srgb16(linear), encode_rounded(linear, 65535)) << i << " " << linear;
    }
  }
}

TEST(Color, RoundsToNearestBetweenTheThresholds) {
  for (int i = 0; i <= 100000; ++i) {
    const float linear = static_cast<float>(i) / 100000;
    ASSERT_EQ(linear_to_srgb8(linear), encode_rounded(linear, 255)) << linear;
    ASSERT_EQ(linear_to_srgb16(linear), encode_rounded(linear, 65535)) << linear;
  }
}

TEST(Color, ClampsWhatDoesNotFit) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  for (const float low : {-1.0F, -0.0F, -kInfinity, kNan}) {
    EXPECT_EQ(linear_to_srgb8(low), 0);
    EXPECT_EQ(linear_to_srgb16(low), 0);
  }
  for (const float high : {1.0F, 1.5F, kInfinity}) {
    EXPECT_EQ(linear_to_srgb8(high), 255);
    EXPECT_EQ(linear_to_srgb16(high), 65535);
  }
}

TEST(Color, CurveIsOddInvertibleAndKeepsNan) {
  for (float x = -4; x <= 4; x += 0.01F) {
    EXPECT_FLOAT_EQ(linear_to_srgb(srgb_to_linear(x)), x);
    EXPECT_EQ(srgb_to_linear(-x), -srgb_to_linear(x));
  }
  EXPECT_TRUE(std::isnan(srgb_to_linear(std::nanf(""))));
  EXPECT_TRUE(std::isnan(linear_to_srgb(std::nanf(""))));
}

}  // namespace
}  // namespace surfel
