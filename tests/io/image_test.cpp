#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/color.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/base/plugin.h>
#include <surfel/base/random.h>
#include <surfel/io/image_io.h>
#include <surfel/io/image_plugin.h>
#include <surfel/io/image_queue.h>
#include <surfel/scene/image.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include "support/message_of.h"
#include "support/test_data.h"

// Where libpng jumps out of an error, OpenImageIO forgets the message: tests/support/lsan.supp
// knows that leak by its whole stack, which the address sanitizer keeps only if told to, as it is
// slow.
extern "C" __attribute__((visibility("default"))) const char* __asan_default_options() {
  return "fast_unwind_on_malloc=0";
}

namespace surfel {
namespace {

using test::message_of;
using test::TemporaryFolder;

Image make_image(int width, int height, std::vector<std::string> channels) {
  Image image{width, height, std::move(channels), {}};
  image.data.assign(static_cast<std::size_t>(width) * height * image.channels.size(), 0.0f);
  return image;
}

/// Premultiplied linear R G B A of random straight colours and alphas, and further channels.
Image random_image(int width, int height, std::vector<std::string> channels) {
  Image image = make_image(width, height, std::move(channels));
  for (std::size_t i = 0; i < image.data.size(); ++i) {
    image.data[i] = static_cast<float>(random_uniform(1, i));
  }
  const int stride = image.channel_count();
  for (std::size_t p = 0; stride >= 4 && p < image.data.size(); p += stride) {
    for (int c = 0; c < 3; ++c) image.data[p + c] *= image.data[p + 3];
  }
  return image;
}

std::vector<char> bytes_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

void write_bytes(const std::string& path, const std::vector<char>& bytes) {
  std::ofstream(path, std::ios::binary).write(bytes.data(), std::ssize(bytes));
}

/// The error that a call throws; fails where there is none or it does not name the file.
template <class Call>
ErrorKind error_kind(const std::string& file, const Call& call) {
  try {
    call();
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find(file), std::string::npos) << error.what();
    return error.kind();
  }
  ADD_FAILURE() << file << ": no error";
  return ErrorKind::kInterrupted;
}

std::size_t files_in(const std::string& folder) {
  const auto begin = std::filesystem::directory_iterator(folder);
  return static_cast<std::size_t>(std::distance(begin, std::filesystem::directory_iterator()));
}

std::string data_file(const std::string& name) { return (test::data_folder() / name).string(); }

/// 256 opaque pixels, one for each 8-bit value, grey.
Image all_8bit_values() {
  Image image = make_image(16, 16, {"R", "G", "B", "A"});
  for (int i = 0; i < 256; ++i) {
    float* p = image.pixel(i % 16, i / 16);
    p[0] = srgb8_to_linear(static_cast<std::uint8_t>(i));
    p[1] = srgb8_to_linear(static_cast<std::uint8_t>(255 - i));
    p[2] = srgb8_to_linear(static_cast<std::uint8_t>(i ^ 85));
    p[3] = 1;
  }
  return image;
}

TEST(Image, LosslessFormatsKeepAll256ValuesExactly) {
  const TemporaryFolder folder;
  const Image image = all_8bit_values();
  for (const std::string name : {"a.png", "a.tif", "a.bmp", "a.tga", "a.ppm"}) {
    write_image(image, folder / name);
    const Image read = read_image(folder / name);
    ASSERT_EQ(read.width, 16) << name;
    ASSERT_EQ(read.height, 16) << name;
    EXPECT_EQ(read.channels, image.channels) << name;
    EXPECT_EQ(read.data, image.data) << name;
  }
}

TEST(Image, TransparentPixelsComeBackStraight) {
  const TemporaryFolder folder;
  Image image = make_image(256, 256, {"R", "G", "B", "A"});
  for (int alpha = 0; alpha < 256; ++alpha) {
    for (int value = 0; value < 256; ++value) {
      float* p = image.pixel(value, alpha);
      p[3] = static_cast<float>(alpha) / 255;
      p[0] = p[1] = srgb8_to_linear(static_cast<std::uint8_t>(value)) * p[3];
      p[2] = 0.25f * p[3];
    }
  }
  for (const std::string name : {"a.png", "a.tif"}) {
    write_image(image, folder / name);
    const Image read = read_image(folder / name);
    for (int alpha = 1; alpha < 256; ++alpha) {
      for (int value = 0; value < 256; ++value) {
        const float* p = read.pixel(value, alpha);
        ASSERT_EQ(p[0], srgb8_to_linear(static_cast<std::uint8_t>(value))) << name << alpha;
        ASSERT_EQ(p[3], static_cast<float>(alpha) / 255) << name;
      }
    }
  }
}

TEST(Image, OpaquePicturesAreWrittenWithoutAlpha) {
  const TemporaryFolder folder;
  Image image = all_8bit_values();
  write_image(image, folder / "opaque.png");
  EXPECT_EQ(read_image(folder / "opaque.png", true).channel_count(), 3);
  image.pixel(7, 7)[3] = 0.5f;
  write_image(image, folder / "transparent.png");
  EXPECT_EQ(read_image(folder / "transparent.png", true).channel_count(), 4);
}

TEST(Image, ExrKeepsEveryChannelAndBit) {
  const TemporaryFolder folder;
  Image image =
      random_image(33, 17, {"R", "G", "B", "A", "Z", "Z.first", "N.X", "N.Y", "N.Z", "weight"});
  image.pixel(3, 4)[4] = std::numeric_limits<float>::infinity();
  image.pixel(5, 6)[0] = 12345.678f;
  image.pixel(5, 7)[0] = -1e-30f;
  write_image(image, folder / "a.exr");
  const Image read = read_image(folder / "a.exr", true);
  ASSERT_EQ(read.width, image.width);
  ASSERT_EQ(read.height, image.height);
  ASSERT_EQ(read.channel_count(), image.channel_count());
  for (int c = 0; c < image.channel_count(); ++c) {
    // EXR may store channels in another order; a name is what finds one.
    const auto found = std::find(read.channels.begin(), read.channels.end(), image.channels[c]);
    ASSERT_NE(found, read.channels.end()) << image.channels[c];
    const auto at = found - read.channels.begin();
    for (int y = 0; y < image.height; ++y) {
      for (int x = 0; x < image.width; ++x) {
        ASSERT_EQ(image.pixel(x, y)[c], read.pixel(x, y)[at]) << image.channels[c];
      }
    }
  }
}

TEST(Image, ExrIsReadWithStraightAlpha) {
  const TemporaryFolder folder;
  Image image = make_image(3, 1, {"R", "G", "B", "A"});
  const float in[12] = {0.125f, 0.25f, 0.5f, 0.5f, 3, 2, 1, 1, 0.5f, 0.25f, 0, 0};
  std::copy(in, in + 12, image.data.begin());
  write_image(image, folder / "a.exr");
  const Image read = read_image(folder / "a.exr");
  const Array<float> expected = {0.25f, 0.5f, 1, 0.5f, 3, 2, 1, 1, 0.5f, 0.25f, 0, 0};
  EXPECT_EQ(read.data, expected) << "alpha 0 keeps the colour as stored";
}

TEST(Image, JpegIsCloseAndShowsThePictureOverBlack) {
  const TemporaryFolder folder;
  Image image = make_image(64, 64, {"R", "G", "B", "A"});
  for (int y = 0; y < 64; ++y) {
    for (int x = 0; x < 64; ++x) {
      float* p = image.pixel(x, y);
      p[0] = srgb_to_linear(static_cast<float>(x) / 63);
      p[1] = srgb_to_linear(static_cast<float>(y) / 63);
      p[2] = 0.2f;
      p[3] = 0.75f;
    }
  }
  write_image(image, folder / "a.jpg");
  const Image read = read_image(folder / "a.jpg");
  for (std::size_t i = 0; i < image.data.size(); ++i) {
    const float expected = i % 4 == 3 ? 1.0f : linear_to_srgb(image.data[i]);
    const float got = i % 4 == 3 ? read.data[i] : linear_to_srgb(read.data[i]);
    ASSERT_NEAR(got, expected, 0.025) << i;
  }
}

TEST(Image, RadianceKeepsTheRange) {
  const TemporaryFolder folder;
  Image image = random_image(32, 8, {"R", "G", "B"});
  for (float& value : image.data) value = std::exp(8 * value);
  write_image(image, folder / "a.hdr");
  const Image read = read_image(folder / "a.hdr");
  for (int i = 0; i < 32 * 8; ++i) {
    const float* in = &image.data[3 * i];
    const float peak = std::max({in[0], in[1], in[2]});
    for (int c = 0; c < 3; ++c) ASSERT_NEAR(read.data[4 * i + c], in[c], peak / 120);
  }
}

TEST(Image, SameBytesForAnyThreadCountAndTime) {
  const TemporaryFolder folder;
  const Image image = random_image(301, 203, {"R", "G", "B", "A", "Z"});
  const std::vector<std::string> extensions = {"png", "exr", "tif", "jpg", "hdr"};
  ImageWriteOptions options;
  options.metadata = {{"surfel:tool", "test"}};
  // Other time zones make other local times of the same moment.
  const char* zone = std::getenv("TZ");
  const std::string zone_before = zone ? zone : "";
  for (const auto& [threads, other_zone] : {std::pair{1, "UTC0"}, {2, "UTC+5"}, {5, "UTC-9"}}) {
    set_thread_count(threads);
    setenv("TZ", other_zone, 1);
    tzset();
    for (const auto& e : extensions) {
      write_image(image, folder / (std::to_string(threads) + "." + e), options);
    }
  }
  set_thread_count(0);
  zone ? setenv("TZ", zone_before.c_str(), 1) : unsetenv("TZ");
  tzset();
  for (const auto& e : extensions) {
    const auto first = bytes_of(folder / ("1." + e));
    ASSERT_FALSE(first.empty()) << e;
    EXPECT_EQ(first, bytes_of(folder / ("2." + e))) << e;
    EXPECT_EQ(first, bytes_of(folder / ("5." + e))) << e;
  }
}

TEST(Image, NeitherNanNorInfinityBreaksAnEncoding) {
  const TemporaryFolder folder;
  Image image = make_image(4, 1, {"R", "G", "B", "A"});
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  constexpr float kInf = std::numeric_limits<float>::infinity();
  const float in[16] = {kNan, kInf, -kInf, 1, 1, 1, 1, kNan, 1, 1, 1, kInf, 9, -9, 0, 1};
  std::copy(in, in + 16, image.data.begin());
  write_image(image, folder / "a.png");
  const Image read = read_image(folder / "a.png");
  const Array<float> opaque(read.data.begin(), read.data.begin() + 3);
  EXPECT_EQ(opaque, (Array<float>{0, 1, 0}));
  for (const float value : read.data) EXPECT_TRUE(value >= 0 && value <= 1);
}

TEST(Image, WritesPngToStandardOutput) {
  const TemporaryFolder folder;
  const Image image = all_8bit_values();
  const int saved = dup(STDOUT_FILENO);
  ASSERT_NE(std::freopen((folder / "out").c_str(), "wb", stdout), nullptr);
  write_image(image, "-");
  dup2(saved, STDOUT_FILENO);
  close(saved);
  EXPECT_EQ(read_image(folder / "out").data, image.data) << "found by content, without extension";
}

TEST(Image, ReadsStandardInput) {
  const TemporaryFolder folder;
  const Image image = all_8bit_values();
  const int saved = dup(STDIN_FILENO);
  for (const std::string name : {"a.png", "a.tif", "a.exr"}) {
    write_image(image, folder / name);
    ASSERT_NE(std::freopen((folder / name).c_str(), "rb", stdin), nullptr);
    EXPECT_EQ(read_image("-").data, image.data) << name;
  }
  std::ofstream(folder / "text") << "no picture";
  ASSERT_NE(std::freopen((folder / "text").c_str(), "rb", stdin), nullptr);
  EXPECT_EQ(error_kind("standard input", [] { read_image("-"); }), ErrorKind::kInput);
  dup2(saved, STDIN_FILENO);
  close(saved);
}

TEST(Image, ReadsANamedPipe) {
  const TemporaryFolder folder;
  const Image image = all_8bit_values();
  write_image(image, folder / "a.png");
  ASSERT_EQ(mkfifo((folder / "pipe").c_str(), 0600), 0);
  std::thread writer([&] { write_bytes(folder / "pipe", bytes_of(folder / "a.png")); });
  EXPECT_EQ(read_image(folder / "pipe").data, image.data);
  writer.join();
}

TEST(Image, AssociatedIntegersAreDividedBeforeDecoding) {
  const TemporaryFolder folder;
  // Little-endian TIFF, 1x1 pixel of R G B A 8 bits: 64 32 16 128, ExtraSamples = associated.
  const std::vector<std::array<std::uint16_t, 4>> tags = {
      {256, 3, 1, 1},   {257, 3, 1, 1}, {258, 3, 4, 142}, {259, 3, 1, 1}, {262, 3, 1, 2},
      {273, 4, 1, 150}, {277, 3, 1, 4}, {278, 3, 1, 1},   {279, 4, 1, 4}, {338, 3, 1, 1}};
  std::vector<char> bytes = {'I', 'I', 42, 0, 8, 0, 0, 0};
  const auto put = [&](unsigned value, int size) {
    for (int i = 0; i < size; ++i) bytes.push_back(static_cast<char>(value >> (8 * i)));
  };
  put(static_cast<unsigned>(tags.size()), 2);
  for (const auto& tag : tags) {
    put(tag[0], 2);
    put(tag[1], 2);
    put(tag[2], 4);
    put(tag[3], 4);
  }
  put(0, 4);
  bytes.resize(142);
  for (int i = 0; i < 4; ++i) put(8, 2);
  for (const unsigned value : {64u, 32u, 16u, 128u}) put(value, 1);
  write_bytes(folder / "a.tif", bytes);
  const Image read = read_image(folder / "a.tif");
  const Array<float> expected = {srgb8_to_linear(128), srgb8_to_linear(64), srgb8_to_linear(32),
                                 128 / 255.0f};
  EXPECT_EQ(read.data, expected);
}

TEST(Image, CameraMatrixActsOnRowVectorsInTheFile) {
  const TemporaryFolder folder;
  ImageWriteOptions options;
  options.world_to_camera = {1, 0, 0, 5, 0, 1, 0, 6, 0, 0, 1, 7, 0, 0, 0, 1};
  write_image(all_8bit_values(), folder / "a.exr", options);
  const auto bytes = bytes_of(folder / "a.exr");
  const std::string key("worldToCamera\0m44f\0", 19);
  const auto at = std::search(bytes.begin(), bytes.end(), key.begin(), key.end());
  ASSERT_GT(bytes.end() - at, 19 + 4 + 64);
  std::array<float, 16> stored{};
  std::memcpy(stored.data(), &*at + 19 + 4, sizeof stored);
  EXPECT_EQ(stored, (std::array<float, 16>{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1}));
}

TEST(Image, WrongUsageIsRefused) {
  const TemporaryFolder folder;
  const Image image = all_8bit_values();
  for (const std::string name : {"a.xyz", "noextension", "a.obj", "a."}) {
    EXPECT_EQ(error_kind(name, [&] { write_image(image, folder / name); }), ErrorKind::kUsage);
    EXPECT_EQ(error_kind(name, [&] { image_format_has_alpha(name); }), ErrorKind::kUsage);
  }
  Image empty = make_image(0, 5, {"R", "G", "B"});
  EXPECT_EQ(error_kind("e.png", [&] { write_image(empty, folder / "e.png"); }), ErrorKind::kUsage);
  Image short_of_data = all_8bit_values();
  short_of_data.data.pop_back();
  EXPECT_EQ(error_kind("s.png", [&] { write_image(short_of_data, folder / "s.png"); }),
            ErrorKind::kUsage);
  EXPECT_EQ(files_in(folder / ""), 0u);
}

TEST(Image, FormatsTellWhetherTheyHoldAlpha) {
  const TemporaryFolder folder;
  Image clear = make_image(2, 2, {"R", "G", "B", "A"});
  for (const std::string extension :
       {"png", "PNG", "exr", "tif", "tga", "webp", "jpg", "JPEG", "hdr", "ppm"}) {
    const std::string file = folder / ("a." + extension);
    write_image(clear, file);
    const bool kept = read_image(file).data[3] < 0.5f;
    EXPECT_EQ(image_format_has_alpha(file), kept) << extension;
  }
  EXPECT_TRUE(image_format_has_alpha("-"));
}

TEST(Image, TargetsThatCannotBeWrittenAreErrors) {
  const TemporaryFolder folder;
  const Image image = all_8bit_values();
  std::filesystem::create_directory(folder / "d.png");
  EXPECT_EQ(error_kind("d.png", [&] { write_image(image, folder / "d.png"); }), ErrorKind::kIo);
  EXPECT_EQ(error_kind("none/a.png", [&] { write_image(image, folder / "none/a.png"); }),
            ErrorKind::kIo);
  write_image(image, folder / "old.png");
  ImageWriteOptions keep;
  keep.no_clobber = true;
  EXPECT_EQ(error_kind("old.png", [&] { write_image(image, folder / "old.png", keep); }),
            ErrorKind::kIo);
  EXPECT_EQ(files_in(folder / ""), 2u);
}

TEST(Image, FullDiskIsReportedForEveryFormat) {
  if (access("/dev/full", W_OK) != 0) GTEST_SKIP() << "no /dev/full";
  const TemporaryFolder folder;
  const Image image = random_image(64, 64, {"R", "G", "B", "A"});
  for (const std::string name : {"a.png", "a.exr", "a.tif", "a.jpg"}) {
    std::filesystem::create_symlink("/dev/full", folder / name);
    EXPECT_EQ(error_kind(name, [&] { write_image(image, folder / name); }), ErrorKind::kIo);
  }
}

TEST(Image, DataComesAsStored) {
  const TemporaryFolder folder;
  Image image = rgba_image(2, 1);
  image.data = {srgb8_to_linear(51), srgb8_to_linear(102), 0, 1, 1, srgb8_to_linear(1), 0, 1};
  write_image(image, folder / "codes.png");
  const Image codes = read_data_image(folder / "codes.png");
  EXPECT_EQ(codes.channels, (std::vector<std::string>{"R", "G", "B"}));
  const Array<float> fractions{0.2F, 0.4F, 0, 1, 1.0F / 255, 0};
  EXPECT_EQ(codes.data, fractions);
  std::ofstream(folder / "grey.pgm", std::ios::binary) << "P5\n1 1\n65535\n" << '\x80' << '\x01';
  const Image grey = read_data_image(folder / "grey.pgm");
  ASSERT_EQ(grey.channels.size(), 1U);
  // OpenImageIO's reader of PGM rounds down once more.
  EXPECT_NEAR(grey.data[0], 0x8001 / 65535.0F, 1.5F / 65535);
}

TEST(Image, WhatIsNoImageIsRefused) {
  const TemporaryFolder folder;
  std::ofstream(folder / "text.txt") << "v 0 0 0\nf 1 2 3\n";
  std::ofstream(folder / "text.png") << "not a picture\n";
  std::ofstream(folder / "empty.png");
  const auto read = [&](const std::string& name) {
    return error_kind(name, [&] { read_image(folder / name); });
  };
  EXPECT_EQ(read("text.txt"), ErrorKind::kInput);
  EXPECT_EQ(read("text.png"), ErrorKind::kInput);
  EXPECT_EQ(read("empty.png"), ErrorKind::kInput);
  EXPECT_EQ(read("missing.png"), ErrorKind::kIo);
  EXPECT_EQ(error_kind("surfel-test", [&] { read_image(folder / ""); }), ErrorKind::kIo);
}

TEST(Image, CutFilesAreRefused) {
  const TemporaryFolder folder;
  const Image image = random_image(97, 61, {"R", "G", "B", "A"});
  for (const std::string e : {"png", "exr", "tif", "jpg", "hdr"}) {
    write_image(image, folder / ("whole." + e));
    const auto whole = bytes_of(folder / ("whole." + e));
    for (const double share : {0.1, 0.5, 0.9}) {
      const std::string name = "cut." + e;
      const auto size = static_cast<std::ptrdiff_t>(share * static_cast<double>(whole.size()));
      write_bytes(folder / name, {whole.begin(), whole.begin() + size});
      EXPECT_EQ(error_kind(name, [&] { read_image(folder / name); }), ErrorKind::kInput)
          << e << " " << share;
    }
  }
}

TEST(Image, ScribbledFilesNeverCrash) {
  const TemporaryFolder folder;
  const Image image = random_image(41, 29, {"R", "G", "B", "A"});
  for (const std::string e : {"png", "exr", "tif", "jpg", "hdr"}) {
    write_image(image, folder / ("whole." + e));
    const auto whole = bytes_of(folder / ("whole." + e));
    for (int round = 0; round < 40; ++round) {
      auto damaged = whole;
      for (int k = 0; k < 3; ++k) {
        const std::uint64_t bits = random_bits(7, round, k);
        // Headers are where a wrong number does most.
        damaged[bits % std::min<std::size_t>(whole.size(), round % 2 ? 300 : whole.size())] =
            static_cast<char>(bits >> 56);
      }
      write_bytes(folder / ("damaged." + e), damaged);
      try {
        const Image read = read_image(folder / ("damaged." + e));
        EXPECT_EQ(read.data.size(), static_cast<std::size_t>(read.width) * read.height * 4);
      } catch (const Error& error) {
        EXPECT_NE(std::string(error.what()).find("damaged." + e), std::string::npos);
      }
    }
  }
}

TEST(Image, AbsurdHeadersAreRefused) {
  SURFEL_REQUIRE_TEST_DATA();
  for (const std::string name : {"libpng_badcrc.png", "libpng_huge_text_chunk.png",
                                 "openexr_oom.exr", "openexr_heap_overflow.exr"}) {
    EXPECT_EQ(error_kind(name, [&] { read_image(data_file("malformed/invalid/" + name)); }),
              ErrorKind::kInput);
  }
}

std::string number(std::int32_t value) {
  return {reinterpret_cast<const char*>(&value), sizeof(value)};
}

/// An attribute of a header of OpenEXR.
std::string attribute(const std::string& name, const std::string& type, const std::string& value) {
  return name + '\0' + type + '\0' + number(static_cast<std::int32_t>(value.size())) + value;
}

/// A header of OpenEXR, and 300 bytes after it.
std::string exr_header(std::int32_t width, std::int32_t height, char compression) {
  std::string channels;
  for (const char* name : {"B", "G", "R"}) {
    channels += name + (std::string(1, '\0') + number(2) + number(0) + number(1) + number(1));
  }
  const std::string box = number(0) + number(0) + number(width - 1) + number(height - 1);
  return "\x76\x2f\x31\x01" + number(2) + attribute("channels", "chlist", channels + '\0') +
         attribute("compression", "compression", std::string(1, compression)) +
         attribute("dataWindow", "box2i", box) + attribute("displayWindow", "box2i", box) +
         attribute("lineOrder", "lineOrder", std::string(1, '\0')) +
         attribute("pixelAspectRatio", "float", std::string("\0\0\x80\x3f", 4)) +
         attribute("screenWindowCenter", "v2f", std::string(8, '\0')) +
         attribute("screenWindowWidth", "float", std::string("\0\0\x80\x3f", 4)) +
         std::string(301, '\0');
}

/// As bytes from an archive have a name.
TEST(Image, FilesInMemoryAreReadThoughThereIsAFileOfThatName) {
  const TemporaryFolder folder;
  const Image image = random_image(5, 4, {"R", "G", "B", "A"});
  for (const char* name : {"a.exr", "a.png"}) {
    write_image(image, folder / name);
    const Image whole = read_image(folder / name);
    const auto bytes = bytes_of(folder / name);
    std::ofstream(folder / name) << "another file";
    const Image read = read_image(InputFile(folder / name, std::as_bytes(std::span(bytes))));
    EXPECT_EQ(read.data, whole.data) << name;
  }
}

TEST(Image, SizesBeyondTheLimitOrTheFileAreRefusedBeforeTheyTakeMemory) {
  const TemporaryFolder folder;
  const auto error = [&](const std::string& name, const std::string& bytes) {
    std::ofstream(folder / name, std::ios::binary) << bytes;
    const std::string whole = message_of([&] { read_image(folder / name); });
    EXPECT_EQ(message_of([&] { open_image(folder / name); }), whole);
    EXPECT_EQ(whole.find(folder / name), 0U) << whole;
    return whole;
  };
  const auto expect = [](const std::string& message, const std::string& part) {
    EXPECT_NE(message.find(part), std::string::npos) << message;
  };
  expect(error("large.exr", exr_header(100000, 100000, 0)),
         "100000 x 100000 pixels are more than the 2147483648 of `max_pixels`");
  // Rows of 12 MB that are said to be compressed by 256.
  constexpr char kDwab = 9;
  expect(error("piece.exr", exr_header(1000000, 300, kDwab)),
         "1000000 x 300 pixels are more than ");
  // A text of 2 GB, of which there are three bytes, in the header of the only and of a second
  // picture.
  const std::string text = std::string("owner\0string\0\xff\xff\xff\x7f", 17) + "abc";
  const std::string header = exr_header(20, 10, 0);
  expect(error("text.exr", header.substr(0, 8) + text), "another length than its value");
  std::string parts = header.substr(0, header.size() - 300) + text;
  parts[5] = 0x10;  // The flag of files of several pictures.
  expect(error("parts.exr", parts), "another length than its value");
  // Values that do not end where their attributes end: a preview of 2^30 pixels, a list of channels
  // that goes on, a text of 2 GB in a list of texts, and a box of three numbers.
  const std::string preview(8, '\x10');
  const std::string endless = std::string("R\0\2\0\0\0\0\0\0\0\1\0\0\0\1\0\0\0", 18);
  for (const std::string& damaged :
       {attribute("preview", "preview", preview), attribute("channels", "chlist", endless),
        attribute("views", "stringvector", std::string("\xff\xff\xff\x7f", 4)),
        attribute("dataWindow", "box2i", std::string(12, '\0'))}) {
    expect(error("attribute.exr", header.substr(0, 8) + damaged + header.substr(8)),
           "another length than its value");
  }
  const Image image = random_image(20, 10, {"R", "G", "B", "A"});
  for (const char* name : {"a.exr", "a.png"}) write_image(image, folder / name);
  const std::uint64_t before = most_image_pixels();
  for (const char* name : {"a.exr", "a.png"}) {
    set_most_image_pixels(200);
    EXPECT_EQ(read_image(folder / name).width, 20);
    set_most_image_pixels(199);
    expect(message_of([&] { read_image(folder / name); }),
           "20 x 10 pixels are more than the 199 of `max_pixels`");
    expect(message_of([&] { open_image(folder / name); }), "scale the picture down or raise");
  }
  set_most_image_pixels(before);
}

std::string deflated(const std::string& bytes) {
  uLongf size = compressBound(static_cast<uLong>(bytes.size()));
  std::string out(size, '\0');
  compress(reinterpret_cast<Bytef*>(out.data()), &size,
           reinterpret_cast<const Bytef*>(bytes.data()), static_cast<uLong>(bytes.size()));
  return out.substr(0, size);
}

/// A TIFF file of R G B of 8 bits, in one strip.
std::string tiff(std::int32_t width, std::int32_t height, std::int32_t compression,
                 const std::string& strip) {
  constexpr std::int32_t kDeflateTags = 9;
  constexpr std::int32_t kEnd = 8 + 2 + 12 * kDeflateTags + 4;
  std::string out = std::string("II*\0", 4) + number(8) + number(kDeflateTags).substr(0, 2);
  const auto tag = [&](std::int32_t name, std::int32_t count, std::int32_t value) {
    constexpr std::int32_t kShort = 3, kLong = 4;
    out += number(name).substr(0, 2) + number(count == 3 ? kShort : kLong).substr(0, 2) +
           number(count) + number(value);
  };
  tag(256, 1, width);
  tag(257, 1, height);
  tag(258, 3, kEnd);  // Three times 8 bits.
  tag(259, 1, compression);
  tag(262, 1, 2);
  tag(273, 1, kEnd + 6);
  tag(277, 1, 3);
  tag(278, 1, height);
  tag(279, 1, static_cast<std::int32_t>(strip.size()));
  return out + number(0) + std::string("\10\0\10\0\10\0", 6) + strip;
}

/// A PNG file of grey with 1 bit, or of R G B with 8.
std::string png(std::uint32_t side, bool gray, const std::string& data) {
  const auto big = [](std::uint64_t value) {
    std::string bytes;
    for (int shift = 24; shift >= 0; shift -= 8) bytes += static_cast<char>(value >> shift);
    return bytes;
  };
  const auto chunk = [&](const std::string& body) {
    const auto* bytes = reinterpret_cast<const Bytef*>(body.data());
    return big(body.size() - 4) + body + big(crc32(0, bytes, static_cast<uInt>(body.size())));
  };
  const std::string kind = gray ? std::string("\1\0\0\0\0", 5) : std::string("\10\2\0\0\0", 5);
  return "\x89PNG\r\n\x1a\n" + chunk("IHDR" + big(side) + big(side) + kind) + chunk("IDAT" + data) +
         chunk("IEND");
}

TEST(Image, PicturesLargerThanTheirFileCanHoldAreRefused) {
  const TemporaryFolder folder;
  constexpr std::int32_t kNone = 1, kLzw = 5, kDeflate = 8;
  constexpr char kZip = 3;
  const std::string few = deflated(std::string(3000, '\x80'));
  const std::string gif = std::string("GIF89a\xff\xff\xff\xff\x80\0\0\0\0\0\xff\xff\xff", 19) +
                          std::string(",\0\0\0\0\xff\xff\xff\xff\0\2\2\x44\1\0;", 16);
  // A progressive frame of 30000 x 30000: libjpeg takes memory for all of it at once.
  const std::string jpeg =
      std::string("\xff\xd8\xff\xc2\0\x0b\x08\x75\x30\x75\x30\1\1\x11\0", 15) + "\xff\xd9";
  const std::string far = std::string("\0\0\x75\x30", 4);
  const std::string j2k = std::string("\xff\x4f\xff\x51\0\x29\0\0", 8) + far + far +
                          std::string(8, '\0') + far + far + std::string(8, '\0') +
                          std::string("\0\1\7\1\1\xff\xd9", 7);
  // Far behind the header, and after what looks like the start of a small one.
  const std::string jp2 = std::string("\0\0\0\x0cjP  \r\n\x87\n", 12) +
                          std::string("\0\0\x20\0free\xff\x4f\xff\x51", 12) +
                          std::string(0x2000 - 12, '\1') + std::string("\0\0\0\0jp2c", 8) + j2k;
  const std::string bmp = "BM" + number(57) + number(0) + number(54) + number(40) + number(40000) +
                          number(40000) + std::string("\1\0\x18\0", 4) + std::string(24, '\0') +
                          "abc";
  // One colour of 16383 x 16383 by codes of no bits.
  const std::string webp = std::string("RIFF\x14\0\0\0WEBPVP8L\x08\0\0\0\x2f\xfe\xbf\xff\x0f", 25) +
                           std::string("\x88\x88\x08", 3);
  for (const auto& [name, bytes] :
       {std::pair<std::string, std::string>{"a.gif", gif},
        {"a.tif", tiff(40000, 40000, kDeflate, few)},
        {"b.tif", tiff(40000, 40000, kLzw, few)},
        {"c.tif", tiff(40000, 40000, kNone, few)},
        {"a.png", png(40000, false, few)},
        {"b.png", png(40000, true, few)},
        {"a.exr", exr_header(40000, 40000, kZip)},
        {"a.jpg", jpeg},
        {"a.j2k", j2k},
        {"a.jp2", jp2},
        {"a.bmp", bmp},
        {"a.webp", webp},
        {"a.hdr", "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 40000 +X 30000\n"},
        {"a.ppm", "P6\n30000 30000\n255\nabc"}}) {
    const std::string path = folder / name;
    std::ofstream(path, std::ios::binary) << bytes;
    const std::string message = message_of([&] { read_image(path); });
    EXPECT_NE(message.find("are more than " + std::to_string(bytes.size()) + " bytes can hold"),
              std::string::npos)
        << name << message;
    EXPECT_EQ(message_of([&] { open_image(path); }), message);
  }
  // The most that deflate can do, of one colour.
  constexpr std::uint32_t kSide = 8000;
  std::ofstream(folder / "one.png", std::ios::binary)
      << png(kSide, true, deflated(std::string(kSide * (kSide / 8 + 1), '\0')));
  EXPECT_LT(std::filesystem::file_size(folder / "one.png"), kSide * kSide / 8 / 1000);
  std::vector<std::uint8_t> row(4 * kSide, 1);
  open_image(folder / "one.png")->read({0, kSide, kSide - 1, kSide}, row.data());
  EXPECT_EQ(row[0], 0);
  EXPECT_EQ(row[3], 255);
}

/// OpenImageIO reads behind the pixels of HEIF whose header claims more than are coded, and gives
/// way to whatever a codestream of JPEG 2000 claims.
TEST(Image, FormatsThatAreDecodedUnseenAreRefused) {
  const TemporaryFolder folder;
  const auto error = [&](const std::string& name, const std::string& bytes) {
    std::ofstream(folder / name, std::ios::binary) << bytes;
    const std::string message = message_of([&] { read_image(folder / name); });
    EXPECT_EQ(message_of([&] { open_image(folder / name); }), message);
    return message;
  };
  const std::string brand(
      "\0\0\0\x14"
      "ftypavif\0\0\0\0avif",
      20);
  const std::string claim("\0\0\0\x14ispe\0\0\0\0\0\0\xff\xff\0\0\xff\xff", 20);
  for (const char* name : {"a.avif", "a.heic", "a.png"}) {
    EXPECT_NE(error(name, brand + claim).find("is HEIF, AVIF or a film, which are not read"),
              std::string::npos);
  }
  const std::string signature("\0\0\0\x0cjP  \r\n\x87\n", 12);
  const std::string start("\xff\x4f\xff\x51");
  for (const std::string& bytes :
       {signature, signature + std::string("\0\0\0\7free", 8) + std::string(100, '\0'),
        signature + std::string("\0\0\0\1jp2c\0\0\0\0\0\0\0\x20", 16),
        signature + std::string("\0\0\0\0jp2c\xff\x4f\xff\x30", 12) + start + std::string(50, '\0'),
        start}) {
    EXPECT_NE(error("a.jp2", bytes).find("does not begin with its size"), std::string::npos);
  }
}

/// OpenImageIO inflates strips itself, and tells nothing of what it could not.
TEST(Image, StripsOfTiffThatEndEarlyAreErrors) {
  const TemporaryFolder folder;
  constexpr int kSide = 64;
  constexpr std::int32_t kNone = 1, kDeflate = 8;
  std::string pixels;
  for (int i = 0; i < 3 * kSide * kSide; ++i) pixels += static_cast<char>(i * i >> 5);
  const std::string stream = deflated(pixels);
  const std::string half = pixels.substr(0, pixels.size() / 2);
  std::string scribbled = stream;
  scribbled.replace(stream.size() / 2, 20, 20, '\0');
  const auto error = [&](const std::string& bytes) {
    const std::string path = folder / "a.tif";
    std::ofstream(path, std::ios::binary) << bytes;
    const std::string whole = message_of([&] { read_image(path); });
    std::vector<std::uint8_t> rgba(4 * kSide * kSide);
    const std::string streamed = message_of([&] {
      open_image(path)->read({0, kSide, 0, kSide}, rgba.data());
    });
    EXPECT_EQ(whole.empty(), streamed.empty()) << whole << streamed;
    if (whole.empty()) {
      const Image image = read_data_image(path);
      for (int i = 0; i < kSide * kSide; ++i) {
        const auto value = static_cast<std::uint8_t>(pixels[static_cast<std::size_t>(3 * i + 1)]);
        EXPECT_EQ(rgba[static_cast<std::size_t>(4 * i + 1)], value);
        EXPECT_EQ(image.data[static_cast<std::size_t>(3 * i + 1)],
                  static_cast<float>(value) / 255.0F);
      }
    }
    return whole;
  };
  EXPECT_EQ(error(tiff(kSide, kSide, kDeflate, stream)), "");
  EXPECT_EQ(error(tiff(kSide, kSide, kNone, pixels)), "");
  for (const std::string& damaged :
       {tiff(kSide, kSide, kDeflate, stream.substr(0, stream.size() / 2)),
        tiff(kSide, kSide, kDeflate, deflated(half)), tiff(kSide, kSide, kDeflate, scribbled),
        tiff(kSide, kSide, kNone, half)}) {
    EXPECT_NE(error(damaged).find("a.tif: damaged image"), std::string::npos);
  }
}

/// libpng takes the memory that a chunk of text claims, and fills it.
TEST(Image, ChunksLongerThanTheirPngFileAreRefusedBeforeTheyTakeMemory) {
  const std::string header("\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR\0\0\0\x01\0\0\0\x01\x08\0\0\0\0", 29);
  const std::string text("\x3a\x7e\x9b\x55\x7f\xff\xff\xf0tEXtTitle\0hello\0\0\0\0", 27);
  const TemporaryFolder folder;
  const std::string path = folder / "huge.png";
  const std::string file = header + text;
  write_bytes(path, {file.begin(), file.end()});
  EXPECT_NE(message_of([&] { read_image(path); }).find("a chunk claims 2147483632 bytes"),
            std::string::npos);
}

TEST(Image, PngSuite) {
  SURFEL_REQUIRE_TEST_DATA();
  const auto read = [](const std::string& name) {
    const Image image = read_image(data_file("malformed/tricky/" + name));
    EXPECT_EQ(image.width, 32) << name;
    EXPECT_EQ(image.height, 32) << name;
    EXPECT_EQ(image.data.size(), 32u * 32 * 4) << name;
    return image;
  };
  // basn0g16 is a ramp over all of black to white; grey means equal channels.
  const Image grey = read("png_grey16.png");
  const auto [low, high] = std::minmax_element(grey.data.begin(), grey.data.end());
  EXPECT_EQ(*low, 0.0f);
  EXPECT_EQ(*high, 1.0f);
  for (int i = 0; i < 32 * 32; ++i) {
    EXPECT_EQ(grey.data[4 * i], grey.data[4 * i + 1]);
    EXPECT_EQ(grey.data[4 * i], grey.data[4 * i + 2]);
    EXPECT_EQ(grey.data[4 * i + 3], 1.0f);
  }
  // basn6a08: alpha is a ramp along each row from 0 to 1, whatever the row.
  const Image rgba = read("png_rgba8_interlaced.png");
  for (int x = 0; x < 32; ++x) {
    for (int y = 1; y < 32; ++y) EXPECT_EQ(rgba.pixel(x, y)[3], rgba.pixel(x, 0)[3]);
    if (x > 0) {
      EXPECT_GT(rgba.pixel(x, 0)[3], rgba.pixel(x - 1, 0)[3]);
    }
  }
  EXPECT_GT(rgba.pixel(1, 0)[0], 0.9f) << "red stays red where nearly transparent";
  // The palette's image is opaque and coloured.
  const Image palette = read("png_palette8.png");
  bool colored = false;
  for (int i = 0; i < 32 * 32; ++i) {
    EXPECT_EQ(palette.data[4 * i + 3], 1.0f);
    colored |= palette.data[4 * i] != palette.data[4 * i + 1];
  }
  EXPECT_TRUE(colored);
  // tRNS: pixels of one colour are transparent, the others opaque.
  const Image keyed = read("png_rgb_tRNS.png");
  int transparent = 0;
  for (int i = 0; i < 32 * 32; ++i) {
    const float alpha = keyed.data[4 * i + 3];
    EXPECT_TRUE(alpha == 0 || alpha == 1);
    transparent += alpha == 0;
  }
  EXPECT_GT(transparent, 100);
  EXPECT_LT(transparent, 32 * 32 - 100);
}

TEST(Image, TexturesAndEnvironments) {
  SURFEL_REQUIRE_TEST_DATA();
  for (const auto& [name, width, height] :
       {std::tuple{"textured/spot/spot_texture.png", 1024, 1024},
        std::tuple{"textured/scissors/scissors_texture.png", 2048, 2048},
        std::tuple{"textured/head_scan/lee_perry_smith_color.png", 1024, 1024},
        std::tuple{"textured/head_scan/lee_perry_smith_color.jpg", 1024, 1024},
        std::tuple{"envmaps/OrientationLatLong.exr", 1024, 512},
        std::tuple{"envmaps/venice_sunset_1k.hdr", 1024, 512}}) {
    const Image image = read_image(data_file(name));
    EXPECT_EQ(image.width, width) << name;
    EXPECT_EQ(image.height, height) << name;
    const auto finite = [](float v) { return std::isfinite(v) && v >= 0; };
    EXPECT_TRUE(std::all_of(image.data.begin(), image.data.end(), finite)) << name;
  }
  const Image png = read_image(data_file("textured/head_scan/lee_perry_smith_color.png"));
  const Image jpg = read_image(data_file("textured/head_scan/lee_perry_smith_color.jpg"));
  EXPECT_EQ(png.data, jpg.data) << "the PNG was decoded from the JPEG";
}

/// PNG is encoded without OpenImageIO, which takes long to load.
TEST(WriteImage, PngIsByteForByteThatOfOpenImageIo) {
  const TemporaryFolder folder;
  const auto by_plugin =
      reinterpret_cast<WriteImageFunction*>(plugin_symbol("image", kWriteImageSymbol));
  for (const auto& [width, height] : {std::pair{1, 1}, {1, 400}, {7, 300}, {400, 257}}) {
    for (const bool opaque : {false, true}) {
      // Half of it smooth: all filters are of use, and there is something to refer back to.
      Image image = random_image(width, height, {"R", "G", "B", "A", "Z"});
      for (std::size_t i = 0; i < image.data.size() / 2; ++i) {
        image.data[i] = 0.5F + 0.5F * std::sin(static_cast<float>(i / 5) / 700);
      }
      for (std::size_t i = 3; opaque && i < image.data.size(); i += 5) image.data[i] = 1;
      ImageWriteOptions options;
      options.metadata = {{"Software", "a test"}};
      write_image(image, folder / "ours.png", options);
      by_plugin(image, folder / "theirs.png", options);
      EXPECT_TRUE(bytes_of(folder / "ours.png") == bytes_of(folder / "theirs.png"))
          << width << "x" << height << (opaque ? " opaque" : "");
    }
  }
}

TEST(ImageQueue, WritesTheSameFilesAsWriteImage) {
  const TemporaryFolder folder;
  constexpr int kImages = 7;
  for (const std::size_t waiting : {0U, 1U, 3U}) {
    ImageQueue queue(waiting);
    for (int i = 0; i < kImages; ++i) {
      queue.write(random_image(20 + i, 10, {"R", "G", "B", "A"}),
                  folder / (std::to_string(i) + ".png"), {});
    }
    queue.finish();
    EXPECT_EQ(queue.milliseconds().size(), static_cast<std::size_t>(kImages));
    for (int i = 0; i < kImages; ++i) {
      write_image(random_image(20 + i, 10, {"R", "G", "B", "A"}), folder / "alone.png");
      EXPECT_TRUE(bytes_of(folder / (std::to_string(i) + ".png")) ==
                  bytes_of(folder / "alone.png"));
    }
  }
}

TEST(ImageQueue, ReportsTheFirstFailureAndWritesNothingAfterIt) {
  const TemporaryFolder folder;
  for (const std::size_t waiting : {0U, 2U}) {
    ImageQueue queue(waiting);
    const auto write_all = [&] {
      for (int i = 0; i < 20; ++i) {
        queue.write(random_image(8, 8, {"R", "G", "B", "A"}),
                    i == 1 ? "/no-such-folder/a.png" : folder / (std::to_string(i) + ".png"), {});
      }
      queue.finish();
    };
    try {
      write_all();
      FAIL() << "nothing was thrown";
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::kIo);
      EXPECT_NE(std::string(error.what()).find("/no-such-folder/a.png"), std::string::npos);
    }
    EXPECT_TRUE(std::filesystem::exists(folder / "0.png"));
    EXPECT_FALSE(std::filesystem::exists(folder / "2.png"));
  }
}

}  // namespace
}  // namespace surfel
