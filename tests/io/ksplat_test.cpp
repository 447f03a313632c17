#include <cmath>

#include <gtest/gtest.h>

#include "io/splat_files.h"

namespace surfel::test {
namespace {

/// A file of one section with five Gaussians: four in two full buckets, one in a partial one.
struct Ksplat {
  std::uint16_t mode = 1;
  std::uint16_t degree = 0;
  std::uint32_t promised = 5;
  std::uint32_t full_buckets = 2;
  std::uint8_t minor = 1;

  std::string file() const {
    std::string out(4096 + 1024, '\0');
    const auto put = [&](std::size_t at, auto value) {
      std::memcpy(out.data() + at, &value, sizeof(value));
    };
    put(1, minor);
    put(4, std::uint32_t{1});
    put(8, std::uint32_t{1});
    put(12, promised);
    put(16, promised);
    put(20, mode);
    put(4096, promised);
    put(4096 + 4, std::uint32_t{5});    // Room.
    put(4096 + 8, std::uint32_t{2});    // Gaussians of a full bucket.
    put(4096 + 12, std::uint32_t{3});   // Buckets.
    put(4096 + 16, 10.0F);              // Size of a block.
    put(4096 + 20, std::uint16_t{12});  // Bytes of a bucket.
    put(4096 + 24, std::uint32_t{1000});
    put(4096 + 32, full_buckets);
    put(4096 + 36, std::uint32_t{1});
    put(4096 + 40, degree);
    append(out, std::uint32_t{1});  // Gaussians of the partial bucket.
    for (int bucket = 0; bucket < 3; ++bucket) {
      for (int k = 0; k < 3; ++k) append(out, static_cast<float>(100 * bucket + k));
    }
    for (int i = 0; i < 5; ++i) {
      if (mode == 0) {
        for (const float value : {1.0F + static_cast<float>(i), 2.0F, 3.0F, 0.5F, 0.25F, 2.0F, 0.0F,
                                  1.0F, 0.0F, 0.0F}) {
          append(out, value);
        }
      } else {
        // 1000 is the middle of a bucket, a step 10 / 2 / 1000; then halves.
        for (const int value : {1000 + 200 * i, 1000, 800}) {
          append(out, static_cast<std::uint16_t>(value));
        }
        for (const int value : {0x3800, 0x3400, 0x4000, 0, 0x3c00, 0, 0}) {
          append(out, static_cast<std::uint16_t>(value));
        }
      }
      out += "\xff\x80\x01\x33";
      for (int k = 0; k < 3 * degree * (degree + 2); ++k) {
        if (mode == 0) append(out, static_cast<float>(k));
        if (mode == 1) append(out, static_cast<std::uint16_t>(0x3c00 + k));
        if (mode == 2) append(out, static_cast<std::uint8_t>(k));
      }
    }
    return out;
  }
};

TEST(KsplatFile, EveryLevelIsDecoded) {
  for (std::uint16_t mode = 0; mode < 3; ++mode) {
    for (std::uint16_t degree = 0; degree < 4; ++degree) {
      const GaussianCloud cloud =
          gaussians_of(Ksplat{.mode = mode, .degree = degree}.file(), "a.ksplat");
      ASSERT_EQ(cloud.size(), 5U);
      EXPECT_EQ(cloud.degree, degree);
      EXPECT_LT((cloud.position[0] - (mode == 0 ? Vec3f(1, 2, 3) : Vec3f(0, 1, 1))).norm(), 1e-5F);
      // The fifth one is alone in the third bucket.
      EXPECT_LT((cloud.position[4] - (mode == 0 ? Vec3f(5, 2, 3) : Vec3f(204, 201, 201))).norm(),
                1e-4F);
      EXPECT_EQ(cloud.scale[3], Vec3f(0.5F, 0.25F, 2));
      EXPECT_EQ(cloud.rotation[3], (std::array<float, 4>{0, 1, 0, 0}));
      EXPECT_FLOAT_EQ(cloud.amplitude[3], 0.2F);
      EXPECT_NEAR(0.5 + GaussianCloud::kHarmonic0 * cloud.harmonics[0], 1, 1e-6);
      if (degree < 2) continue;
      // Degree 2 begins behind nine numbers, with the red ones of its five coefficients.
      const float* const harmonics = cloud.harmonics.data() + 4 * cloud.harmonics_stride();
      const auto stored = [&](int k) {
        return mode == 0   ? static_cast<float>(k)
               : mode == 1 ? 1 + static_cast<float>(k) / 1024
                           : -1.5F + static_cast<float>(k) / 85;
      };
      EXPECT_FLOAT_EQ(harmonics[3], stored(0));
      EXPECT_FLOAT_EQ(harmonics[3 + 1], stored(3));
      EXPECT_FLOAT_EQ(harmonics[12], stored(9));
      EXPECT_FLOAT_EQ(harmonics[12 + 3], stored(10));
      EXPECT_FLOAT_EQ(harmonics[12 + 2], stored(19));
    }
  }
}

TEST(KsplatFile, WhatIsWrongIsNamed) {
  const std::string file = Ksplat().file();
  for (std::size_t size = 0; size < file.size(); size += size < 5000 ? 500 : 1) {
    EXPECT_NE(gaussian_error(file.substr(0, size), "a.ksplat"), "") << size;
  }
  const auto error = [](const Ksplat& k) { return gaussian_error(k.file(), "a.ksplat"); };
  EXPECT_NE(error({.mode = 3}).find("level 3"), std::string::npos);
  EXPECT_NE(error({.degree = 4}).find("degree 4"), std::string::npos);
  EXPECT_NE(error({.promised = 6}).find("room for 5"), std::string::npos);
  EXPECT_NE(error({.promised = 0}).find("holds no Gaussians"), std::string::npos);
  EXPECT_NE(error({.full_buckets = 1}).find("buckets"), std::string::npos);
  EXPECT_NE(error({.full_buckets = 3}).find("buckets"), std::string::npos);
  EXPECT_NE(error({.minor = 0}).find("version 0.0"), std::string::npos);
  std::string sections = file;
  sections.replace(4, 4, "\xff\xff\xff\xff");
  EXPECT_NE(gaussian_error(sections, "a.ksplat").find("promises 4294967295"), std::string::npos);
  std::string room = file;
  room.replace(4096 + 4, 4, "\xff\xff\xff\xff");
  EXPECT_NE(gaussian_error(room, "a.ksplat").find("ends within a section"), std::string::npos);
}

}  // namespace
}  // namespace surfel::test
