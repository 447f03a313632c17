#include <cmath>

#include <gtest/gtest.h>
#include <surfel/io/file_kind.h>

#include "io/splat_files.h"
#include "support/gaussian_shape.h"
#include "support/test_data.h"

namespace surfel::test {
namespace {

/// The parts of a .spz file of one Gaussian, or of several that are alike.
struct Spz {
  std::uint32_t version = 3;
  std::uint32_t count = 1;
  std::uint8_t degree = 0;
  std::uint8_t fractional_bits = 12;
  std::uint8_t flags = 0;
  std::string position{"\x00\x10\x00\x00\xf0\xff\x00\x20\x00", 9};  // 1, -1, 2
  std::string alpha = "\x33";
  std::string color = "\xff\x80\x01";
  std::string scale = "\xa0\xb0\x90";  // 0, 1, -1
  std::string rotation{"\x00\x00\x00\xc0", 4};
  std::string harmonics = {};
  std::string extensions = {};

  std::array<const std::string*, 6> columns() const {
    return {&position, &alpha, &color, &scale, &rotation, &harmonics};
  }
  static std::string repeated(const std::string& text, std::uint32_t count) {
    std::string out;
    for (std::uint32_t k = 0; k < count; ++k) out += text;
    return out;
  }
  std::string header(std::uint8_t streams) const {
    std::string out = "NGSP";
    append(out, version);
    append(out, count);
    for (const std::uint8_t byte : {degree, fractional_bits, flags, streams}) append(out, byte);
    return out;
  }
  /// Versions 1 to 3, not yet compressed.
  std::string raw() const {
    std::string out = header(0);
    for (const std::string* column : columns()) out += repeated(*column, count);
    return out;
  }
  /// Version 4.
  std::string streams() const {
    const std::uint8_t number = degree == 0 ? 5 : 6;
    std::string out = header(number);
    append(out, static_cast<std::uint32_t>(32 + extensions.size()));
    out.append(12, '\0');
    out += extensions;
    std::string data;
    for (std::size_t k = 0; k < number; ++k) {
      const std::string column = repeated(*columns()[k], count);
      const std::string packed = zstandard(column);
      append(out, std::uint64_t{packed.size()});
      append(out, std::uint64_t{column.size()});
      data += packed;
    }
    return out + data;
  }
};

GaussianCloud cloud_of(const Spz& spz) {
  return gaussians_of(spz.version == 4 ? spz.streams() : gzipped(spz.raw()), "a.spz");
}

TEST(SpzFile, ValuesAreDecodedAndTurned) {
  for (const std::uint32_t version : {2U, 3U, 4U}) {
    Spz spz{.version = version, .count = 3};
    if (version == 2) spz.rotation = "\x80\x80\x80";
    const GaussianCloud cloud = cloud_of(spz);
    ASSERT_EQ(cloud.size(), 3U);
    // Stored is x right, y up, z back; the cloud has y down, z forwards.
    EXPECT_EQ(cloud.position[2], Vec3f(1, 1, -2));
    EXPECT_EQ(cloud.up, Vec3d(0, -1, 0));
    EXPECT_FLOAT_EQ(cloud.scale[0][0], 1);
    EXPECT_FLOAT_EQ(cloud.scale[0][1], std::exp(1.0F));
    EXPECT_FLOAT_EQ(cloud.scale[0][2], std::exp(-1.0F));
    EXPECT_FLOAT_EQ(cloud.amplitude[1], 0.2F);
    EXPECT_FLOAT_EQ(cloud.harmonics[0], 0.5F / 0.15F);
    EXPECT_FLOAT_EQ(cloud.harmonics[2], (1 / 255.0F - 0.5F) / 0.15F);
    EXPECT_NEAR(cloud.rotation[0][0], 1, 1e-4);
    EXPECT_EQ(cloud.rule, AmplitudeRule::kOpacity);
    EXPECT_EQ(cloud.trained_with, TrainedWith::kUnknown);
  }
  // Without compression, and with halves.
  EXPECT_EQ(gaussians_of(Spz{.version = 2, .rotation = "abc"}.raw(), "x.spz").position[0],
            Vec3f(1, 1, -2));
  const Spz halves{.version = 1, .position = {"\x00\x3c\x00\xbc\x01\x00", 6}, .rotation = "abc"};
  const GaussianCloud cloud = cloud_of(halves);
  EXPECT_EQ(cloud.position[0][1], 1);
  EXPECT_EQ(cloud.position[0][2], -0x1p-24F);
}

TEST(SpzFile, RotationsAreTurnedWithTheAxes) {
  // A quarter turn about y, then z by the smallest three of x y z w: x y z in this order, lowest
  // last. 511 stands for sqrt(1/2).
  const std::uint32_t bits = 3U << 30 | 0U << 20 | 511U << 10 | 0U;
  Spz spz;
  spz.rotation.clear();
  append(spz.rotation, bits);
  const float half = std::sqrt(0.5F);
  std::array<float, 4> q = cloud_of(spz).rotation[0];
  // The turn about y keeps its axis' sign by y and z, twice mirrored: -y.
  EXPECT_NEAR(q[0], half, 1e-6);
  EXPECT_NEAR(q[2], -half, 1e-6);
  // The negative sign, the largest one x.
  spz.rotation.clear();
  append(spz.rotation, 0U << 30 | (512U | 100U) << 20 | 200U << 10 | 300U);
  q = cloud_of(spz).rotation[0];
  const float unit = half / 511;
  EXPECT_NEAR(q[2], 100 * unit, 1e-6);
  EXPECT_NEAR(q[3], -200 * unit, 1e-6);
  EXPECT_NEAR(q[0], 300 * unit, 1e-6);
  EXPECT_GT(q[1], 0.5F);
  // Version 2 has bytes of x y z.
  q = cloud_of(Spz{.version = 2, .rotation = {"\x00\xff\x80", 3}}).rotation[0];
  EXPECT_NEAR(q[1], -half, 1e-2);
  EXPECT_NEAR(q[2], -half, 1e-2);
}

TEST(SpzFile, HarmonicsChangeSignsWithTheAxes) {
  for (std::uint8_t degree = 1; degree <= 4; ++degree) {
    Spz spz{.version = degree == 4 ? 4U : 3U, .degree = degree};
    const int coefficients = degree * (degree + 2);
    for (int k = 0; k < 3 * coefficients; ++k) spz.harmonics += static_cast<char>(129 + k);
    const GaussianCloud cloud = cloud_of(spz);
    ASSERT_EQ(cloud.degree, degree);
    // For y and z mirrored, of the formulas of the harmonics: y, z, x | xy, yz, 1, xz, 1 | ...
    constexpr std::array<int, 24> kSigns = {-1, -1, 1, -1, 1, 1,  -1, 1, -1, 1, -1, -1,
                                            1,  -1, 1, -1, 1, -1, 1,  1, -1, 1, -1, 1};
    for (int k = 0; k < coefficients; ++k) {
      for (int color = 0; color < 3; ++color) {
        const int at = 3 * k + color;
        EXPECT_EQ(cloud.harmonics[static_cast<std::size_t>(3 + at)],
                  static_cast<float>(kSigns[static_cast<std::size_t>(k)] * (1 + at)) / 128)
            << "degree " << int{degree} << " coefficient " << k;
      }
    }
  }
}

TEST(SpzFile, FlagsAndExtensionsAreKnown) {
  const GaussianCloud smooth = cloud_of(Spz{.version = 4, .flags = 1});
  EXPECT_EQ(smooth.rule, AmplitudeRule::kCompensated);
  EXPECT_EQ(smooth.trained_with, TrainedWith::kMip);
  const auto extended = [](std::uint32_t system) {
    Spz spz{.version = 4, .flags = 2};
    for (const std::uint32_t word : {0x12340001U, 4U, 7U, 0xADBE0003U, 4U, system}) {
      append(spz.extensions, word);
    }
    return spz;
  };
  EXPECT_EQ(cloud_of(extended(4)).position[0], Vec3f(1, 1, -2));    // right, up, back
  EXPECT_EQ(cloud_of(extended(0)).position[0], Vec3f(1, 1, -2));    // not specified
  EXPECT_EQ(cloud_of(extended(6)).position[0], Vec3f(1, -1, 2));    // right, down, forwards
  EXPECT_EQ(cloud_of(extended(1)).position[0], Vec3f(-1, -1, -2));  // left, down, back
  EXPECT_NE(gaussian_error(extended(12).streams(), "a.spz").find("number 12"), std::string::npos);
  Spz cut = extended(4);
  cut.extensions.resize(10);
  EXPECT_NE(gaussian_error(cut.streams(), "a.spz").find("extension"), std::string::npos);
}

TEST(SpzFile, DataThatDiffersFromItsChecksumIsRefused) {
  const std::string file = gzipped(Spz{.count = 100}.raw());
  for (std::size_t bit = 8 * (file.size() - 8); bit < 8 * file.size(); ++bit) {
    std::string damaged = file;
    damaged[bit / 8] = static_cast<char>(damaged[bit / 8] ^ 1 << bit % 8);
    EXPECT_NE(gaussian_error(damaged, "a.spz").find("damaged"), std::string::npos) << bit;
  }
}

TEST(SpzFile, SeveralMembersOfGzipAreOneFile) {
  const std::string raw = Spz{.count = 100}.raw();
  // Cut within the header, within the columns, and at their ends, which makes members empty.
  for (const std::size_t cut : {std::size_t{0}, std::size_t{7}, std::size_t{500}, raw.size()}) {
    const std::string file = gzipped(raw.substr(0, cut)) + gzipped(raw.substr(cut));
    EXPECT_EQ(gaussian_error(file, "a.spz"), "") << cut;
    EXPECT_EQ(gaussian_error(file + std::string(512, '\0'), "a.spz"), "") << cut;
    EXPECT_NE(gaussian_error(file + gzipped("a"), "a.spz").find("holds more than the"),
              std::string::npos);
    EXPECT_NE(gaussian_error(file + "a", "a.spz").find("followed by bytes that are none of it"),
              std::string::npos);
    EXPECT_NE(gaussian_error(file + "\x1f\x8b and no more", "a.spz").find("damaged"),
              std::string::npos);
  }
}

TEST(SpzFile, WhatIsWrongIsNamed) {
  for (const std::uint32_t version : {3U, 4U}) {
    const Spz spz{.version = version, .count = 100};
    const std::string file = version == 4 ? spz.streams() : gzipped(spz.raw());
    EXPECT_EQ(gaussian_error(file, "a.spz"), "");
    for (std::size_t size = 0; size < file.size(); ++size) {
      EXPECT_NE(gaussian_error(file.substr(0, size), "a.spz"), "") << size;
    }
  }
  const auto error = [](const Spz& spz) {
    return gaussian_error(spz.version == 4 ? spz.streams() : gzipped(spz.raw()), "a.spz");
  };
  EXPECT_NE(error(Spz{.version = 5}).find("version 5"), std::string::npos);
  EXPECT_NE(error(Spz{.version = 0}).find("version 0"), std::string::npos);
  EXPECT_NE(error(Spz{.degree = 5}).find("degree 5"), std::string::npos);
  EXPECT_NE(error(Spz{.fractional_bits = 31}).find("31 bits"), std::string::npos);
  EXPECT_NE(error(Spz{.count = 0}).find("holds no Gaussians"), std::string::npos);

  // Counts that the file cannot hold, and streams of other sizes.
  Spz lying;
  std::string raw = lying.raw();
  raw.replace(8, 4, "\xff\xff\xff\x7f");
  EXPECT_NE(gaussian_error(gzipped(raw), "a.spz").find("promises 2147483647"), std::string::npos);
  EXPECT_NE(gaussian_error(raw, "a.spz").find("promises 2147483647"), std::string::npos);
  raw.replace(8, 4, std::string("\x02\x00\x00\x00", 4));
  EXPECT_NE(gaussian_error(gzipped(raw), "a.spz").find("ends after"), std::string::npos);
  lying.version = 4;
  std::string streams = lying.streams();
  streams.replace(8, 4, "\xff\xff\xff\x7f");
  EXPECT_NE(gaussian_error(streams, "a.spz").find("promises 2147483647"), std::string::npos);
  streams.replace(8, 4, std::string("\x02\x00\x00\x00", 4));
  EXPECT_NE(gaussian_error(streams, "a.spz").find("stream 0"), std::string::npos);
  streams = lying.streams();
  streams[15] = 6;
  EXPECT_NE(gaussian_error(streams, "a.spz").find("6 streams"), std::string::npos);
  streams = lying.streams();
  streams[streams.size() - 8] = static_cast<char>(streams[streams.size() - 8] ^ 0x55);
  EXPECT_NE(gaussian_error(streams, "a.spz"), "");

  std::string damaged = gzipped(Spz{.count = 100}.raw());
  damaged[20] = static_cast<char>(damaged[20] ^ 0x55);
  EXPECT_NE(gaussian_error(damaged, "a.spz"), "");
  EXPECT_NE(gaussian_error(gzipped("no splats, but some text"), "a.spz").find("NGSP"),
            std::string::npos);
  EXPECT_NE(gaussian_error("no splats, but some text", "a.spz").find("NGSP"), std::string::npos);
}

/// A few bytes that stand for gigabytes are not unpacked.
TEST(SpzFile, BombsTakeNoMemory) {
  Spz spz;
  std::string raw = spz.raw() + std::string(std::size_t{1} << 24, '\0');
  const std::string small = gzipped(raw);
  EXPECT_NE(gaussian_error(small, "a.spz").find("holds more than the"), std::string::npos);
  raw[14] = 2;  // Of extensions, which are not decoded.
  EXPECT_EQ(gaussian_error(gzipped(raw), "a.spz"), "");
  raw.replace(8, 4, "\xff\xff\xff\x0f");
  EXPECT_NE(gaussian_error(gzipped(raw), "a.spz").find("promises"), std::string::npos);
}

TEST(SpzFile, RealFilesHoldTheGaussiansOfOtherFormats) {
  SURFEL_REQUIRE_TEST_DATA();
  const std::filesystem::path folder = data_folder() / "formats/splats";
  const GaussianCloud splat = read_gaussians(folder / "minimal.splat");
  ASSERT_EQ(splat.size(), 4U);
  for (const char* name : {"minimal-v3.spz", "minimal-v4.spz", "minimal.ksplat"}) {
    SCOPED_TRACE(name);
    EXPECT_TRUE(holds_gaussians(folder / name));
    EXPECT_EQ(file_kind(folder / name), FileKind::kGaussians);
    const GaussianCloud other = read_gaussians(folder / name);
    ASSERT_EQ(other.size(), 4U);
    for (std::size_t i = 0; i < 4; ++i) {
      EXPECT_LT((other.position[i] - splat.position[i]).norm(), 1e-6F);
      EXPECT_LT((covariance(other, i) - covariance(splat, i)).norm(), 5e-4);
      EXPECT_NEAR(other.amplitude[i], splat.amplitude[i], 1e-6);
      for (std::size_t k = 0; k < 3; ++k) {
        EXPECT_NEAR(other.harmonics[3 * i + k], splat.harmonics[3 * i + k], 0.03);
      }
    }
  }
  // These were made by a program that did not turn the axes, and with colours of another scale.
  for (const char* name : {"minimal-v2.spz", "minimal-raw.spz"}) {
    const GaussianCloud other = read_gaussians(folder / name);
    ASSERT_EQ(other.size(), 4U);
    for (std::size_t i = 0; i < 4; ++i) {
      const Vec3f& p = splat.position[i];
      EXPECT_LT((other.position[i] - Vec3f(p[0], -p[1], -p[2])).norm(), 1e-6F);
    }
  }
}

/// Who reads a file hears of its Gaussians before memory is taken for them, whatever the format.
TEST(GaussianReadOptions, CountsAreSaidBeforeGaussiansAreRead) {
  SURFEL_REQUIRE_TEST_DATA();
  std::vector<std::filesystem::path> files{data_folder() / "surfels/gaussians_train_1000.ply"};
  for (const char* name : {"minimal.splat", "minimal-v3.spz", "minimal-v4.spz", "minimal.ksplat"}) {
    files.push_back(data_folder() / "formats/splats" / name);
  }
  for (const std::filesystem::path& file : files) {
    SCOPED_TRACE(file);
    std::vector<std::size_t> said;
    int degree = -1;
    GaussianReadOptions options;
    options.accept = [&](std::size_t count, const GaussianCloud& head) {
      EXPECT_EQ(head.size(), 0U);
      said.push_back(count);
      degree = head.degree;
    };
    const GaussianCloud cloud = read_gaussians(file, options);
    EXPECT_EQ(said, std::vector{cloud.size()});
    EXPECT_EQ(degree, cloud.degree);
    options.accept = [](std::size_t, const GaussianCloud&) {
      throw Error(ErrorKind::kInput, "too many");
    };
    EXPECT_EQ(message_of([&] { read_gaussians(file, options); }), "too many");
  }
}

}  // namespace
}  // namespace surfel::test
