#include <cmath>

#include <gtest/gtest.h>

#include "io/splat_files.h"

namespace surfel::test {
namespace {

/// A text file of so many Gaussians, all with the same words, in chunks whose x goes from 0 to 1,
/// 10 to 11 and so on.
struct Compressed {
  int count = 1;
  std::uint32_t position = 0;
  std::uint32_t rotation = 0;
  std::uint32_t scale = 0;
  std::uint32_t color = 0;
  bool color_bounds = false;
  int degree = 0;
  int missing_chunks = 0;
  int harmonics_of = -1;  ///< Of the count, unless it is set.

  std::string file() const {
    const int chunks = (count + 255) / 256 - missing_chunks;
    std::string out = "ply\nformat ascii 1.0\nelement chunk " + std::to_string(chunks) + "\n";
    for (const char* names : {"xyz", "scale"}) {
      for (const char* side : {"min_", "max_"}) {
        for (const char axis : {'x', 'y', 'z'}) {
          out += std::string("property float ") + side +
                 (names == std::string("xyz") ? "" : "scale_") + axis + "\n";
        }
      }
    }
    if (color_bounds) {
      for (const char* side : {"min_", "max_"}) {
        for (const char channel : {'r', 'g', 'b'}) {
          out += std::string("property float ") + side + channel + "\n";
        }
      }
    }
    out += "element vertex " + std::to_string(count) + "\n";
    for (const char* name : {"position", "rotation", "scale", "color"}) {
      out += std::string("property uint packed_") + name + "\n";
    }
    const int numbers = 3 * degree * (degree + 2);
    if (numbers > 0) {
      out += "element sh " + std::to_string(harmonics_of < 0 ? count : harmonics_of) + "\n";
      for (int k = 0; k < numbers; ++k) out += "property uchar f_rest_" + std::to_string(k) + "\n";
    }
    out += "end_header\n";
    for (int chunk = 0; chunk < chunks; ++chunk) {
      const std::string x = std::to_string(10 * chunk);
      out += x + " -1 -2 " + std::to_string(10 * chunk + 1) + " 1 2 -1 0 1 1 0 2";
      out += color_bounds ? " -1 0 0 1 2 1\n" : "\n";
    }
    for (int i = 0; i < count; ++i) {
      for (const std::uint32_t word : {position, rotation, scale, color}) {
        out += std::to_string(word) + " ";
      }
      out += "\n";
    }
    for (int i = 0; i < (numbers > 0 ? count : 0); ++i) {
      for (int k = 0; k < numbers; ++k) {
        out += std::to_string(k == 0 ? 0 : k == 1 ? 255 : 100 + k) + " ";
      }
      out += "\n";
    }
    return out;
  }
};

GaussianCloud cloud_of(const Compressed& made) { return gaussians_of(made.file(), "a.ply"); }

TEST(CompressedPly, WordsAreDecodedWithinTheirChunk) {
  // x at its highest, y in the middle (512 of 1023), z at its lowest.
  const GaussianCloud cloud = cloud_of(
      {.count = 300, .position = 2047U << 21 | 512U << 11, .scale = 0, .color = 0xff800033});
  ASSERT_EQ(cloud.size(), 300U);
  EXPECT_NEAR(cloud.position[255][0], 1, 1e-6);
  EXPECT_NEAR(cloud.position[255][1], 1 / 1023.0, 1e-6);
  EXPECT_NEAR(cloud.position[255][2], -2, 1e-6);
  EXPECT_NEAR(cloud.position[256][0], 11, 1e-6);
  EXPECT_FLOAT_EQ(cloud.scale[0][0], std::exp(-1.0F));
  EXPECT_FLOAT_EQ(cloud.scale[0][1], 1);
  EXPECT_FLOAT_EQ(cloud.scale[0][2], std::exp(1.0F));
  EXPECT_FLOAT_EQ(cloud.amplitude[7], 0.2F);
  const auto shown = [&](std::size_t k) {
    return 0.5 + GaussianCloud::kHarmonic0 * cloud.harmonics[k];
  };
  EXPECT_NEAR(shown(0), 1, 1e-6);
  EXPECT_NEAR(shown(1), 128 / 255.0, 1e-6);
  EXPECT_NEAR(shown(2), 0, 1e-6);
  const GaussianCloud bounded = cloud_of({.color = 0xff800033, .color_bounds = true});
  EXPECT_NEAR(0.5 + GaussianCloud::kHarmonic0 * bounded.harmonics[1], 2 * 128 / 255.0, 1e-6);
}

TEST(CompressedPly, RotationsLackTheirLargestNumber) {
  // Of ten bits 0 and 1023 stand for -sqrt(1/2) and sqrt(1/2), 511.5 for 0.
  const float half = std::sqrt(0.5F);
  const std::uint32_t middle = 511;
  for (std::uint32_t largest = 0; largest < 4; ++largest) {
    const std::array<float, 4> q =
        cloud_of({.rotation = largest << 30 | 1023U << 20 | middle << 10 | middle}).rotation[0];
    EXPECT_NEAR(q[largest], half, 2e-3);
    EXPECT_NEAR(q[largest == 0 ? 1 : 0], half, 2e-3);
    EXPECT_NEAR(q[largest == 3 ? 2 : 3], 0, 2e-3);
  }
}

TEST(CompressedPly, HarmonicsAreBytes) {
  for (int degree = 1; degree <= 3; ++degree) {
    const GaussianCloud cloud = cloud_of({.count = 2, .degree = degree});
    ASSERT_EQ(cloud.degree, degree);
    const float* const harmonics = cloud.harmonics.data() + cloud.harmonics_stride();
    const auto coefficients = static_cast<std::size_t>(degree * (degree + 2));
    EXPECT_EQ(harmonics[3], -4);
    EXPECT_EQ(harmonics[6], 4);
    EXPECT_FLOAT_EQ(harmonics[9], (102.5F / 256 - 0.5F) * 8);
    // Green begins where red ends.
    EXPECT_FLOAT_EQ(harmonics[4], ((100.5F + static_cast<float>(coefficients)) / 256 - 0.5F) * 8);
  }
}

TEST(CompressedPly, WhatIsWrongIsNamed) {
  EXPECT_TRUE(holds_gaussians(splat_file(Compressed().file(), "a.ply")));
  const auto error = [](const Compressed& made) { return gaussian_error(made.file(), "a.ply"); };
  EXPECT_NE(error({.count = 300, .missing_chunks = 1}).find("1 chunks, too few"),
            std::string::npos);
  EXPECT_NE(error({.count = 2, .degree = 1, .harmonics_of = 1}).find("harmonics of 1"),
            std::string::npos);
  const std::string file = Compressed({.count = 3, .degree = 1}).file();
  for (std::size_t size = 1; size + 6 < file.size(); ++size) {
    EXPECT_NE(gaussian_error(file.substr(0, size), "a.ply"), "") << size;
  }
}

}  // namespace
}  // namespace surfel::test
