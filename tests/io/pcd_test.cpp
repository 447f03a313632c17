#include <cmath>
#include <cstring>
#include <string>
#include <type_traits>

#include <surfel/base/color.h>
#include <surfel/base/error.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/cloud_to_records.h>
#include <surfel/io/pcd.h>
#include <surfel/io/text_scanner.h>

#include "io/cloud_of_bytes.h"
#include "support/memory_file.h"
#include "support/test_data.h"

namespace surfel {
namespace {

// The records of a PcdFile may be views of the file that it owns.
static_assert(!std::is_copy_constructible_v<PcdFile> && !std::is_move_constructible_v<PcdFile>);
static_assert(!std::is_constructible_v<CloudRecords, SurfelCloud, CloudRecordOptions>);
static_assert(std::is_constructible_v<CloudRecords, const SurfelCloud&, CloudRecordOptions>);
static_assert(!std::is_constructible_v<TextScanner, std::string, std::string>);
static_assert(std::is_constructible_v<TextScanner, std::string, const std::string&>);

using test::cloud_of;
using test::error_of;
using test::MemoryFile;

template <class T>
std::string raw(T value) {
  std::string bytes(sizeof(T), '\0');
  std::memcpy(bytes.data(), &value, sizeof(T));
  return bytes;
}

/// One point of x y z, packed colour, 64-bit time, a histogram of two, padding.
std::string header(const std::string& data, const std::string& points = "2") {
  return "# .PCD v0.7 - Point Cloud Data file format\n# from a scanner\nVERSION 0.7\n"
         "FIELDS x y z rgba time hist\nSIZE 4 4 4 4 8 2\nTYPE F F F U U I\n"
         "COUNT 1 1 1 1 1 2\nWIDTH " +
         points + "\nHEIGHT 1\nVIEWPOINT 1 2 3 0 1 0 0\nPOINTS " + points + "\nDATA " + data + "\n";
}

/// The columns of those two points, field by field.
std::vector<std::vector<std::string>> fields() {
  return {
      {raw(1.0f), raw(-2.0f)},
      {raw(0.5f), raw(NAN)},
      {raw(3.0f), raw(4.0f)},
      {raw(0x80ff0102u), raw(0x00000000u)},
      {raw(std::uint64_t{1} << 40), raw(std::uint64_t{7})},
      {raw(std::int16_t{-1}) + raw(std::int16_t{2}), raw(std::int16_t{3}) + raw(std::int16_t{4})}};
}

std::string binary_body() {
  std::string body;
  for (int point = 0; point < 2; ++point) {
    for (const auto& field : fields()) body += field[point];
  }
  return body;
}

/// LZF of runs without any match, of the points field by field; then the two sizes in front.
std::string compressed_body() {
  std::string plain;
  for (const auto& field : fields()) plain += field[0] + field[1];
  std::string packed;
  for (std::size_t at = 0; at < plain.size(); at += 32) {
    const std::string run = plain.substr(at, 32);
    packed += static_cast<char>(run.size() - 1) + run;
  }
  return raw(static_cast<std::uint32_t>(packed.size())) +
         raw(static_cast<std::uint32_t>(plain.size())) + packed;
}

void expect_two_points(const SurfelCloud& cloud) {
  ASSERT_EQ(cloud.size(), 2);
  EXPECT_EQ(cloud.position[0], Vec3f(1, 0.5f, 3));
  EXPECT_EQ(cloud.position[1].x(), -2);
  EXPECT_TRUE(std::isnan(cloud.position[1].y()));
  ASSERT_EQ(cloud.color.size(), 2);
  EXPECT_EQ(cloud.color[0], Vec3f(1, srgb8_to_linear(1), srgb8_to_linear(2)));
  EXPECT_EQ(cloud.color_encoding, ColorEncoding::kUint8Srgb);
  EXPECT_EQ(cloud.alpha, (Array<float>{128 / 255.0f, 0}));
  ASSERT_EQ(cloud.extra.size(), 3);
  EXPECT_EQ(cloud.extra[0].name, "time");
  EXPECT_EQ(cloud.extra[0].type, ScalarType::kFloat64);
  double times[2];
  std::memcpy(times, cloud.extra[0].data.data(), sizeof(times));
  EXPECT_EQ(times[0], std::ldexp(1.0, 40));
  EXPECT_EQ(times[1], 7);
  EXPECT_EQ(cloud.extra[2].name, "hist_1");
  EXPECT_EQ(cloud.extra[2].type, ScalarType::kInt16);
  EXPECT_EQ(std::to_integer<int>(cloud.extra[2].data[2]), 4);
  ASSERT_TRUE(cloud.viewpoint);
  EXPECT_EQ(cloud.viewpoint->position, Vec3d(1, 2, 3));
  EXPECT_EQ(cloud.viewpoint->orientation, Vec4d(0, 1, 0, 0));
  EXPECT_EQ(cloud.comments, (std::vector<std::string>{"from a scanner"}));
}

TEST(Pcd, EveryKindOfBodyReadsTheSame) {
  expect_two_points(cloud_of(header("ascii") + "1 0.5 3 2164195586 1099511627776 -1 2\n"
                                               "-2 nan 4 0 7 3 4"));
  expect_two_points(cloud_of(header("binary") + binary_body()));
  expect_two_points(cloud_of(header("binary_compressed") + compressed_body()));
}

TEST(Pcd, HeaderMayBeUntidy) {
  const SurfelCloud cloud = cloud_of(
      "# PCD of old\r\n\r\nCOLUMNS\tX Y\tZ _\r\nSIZE 4 4 4 1\r\nTYPE F F F U\r\nCOUNT 1 1 1 3\r\n"
      "POINTS 2 \r\nDATA ascii\r\n4320978.61\t2 3 . . .\r\n\r\n4320979.61 2 3 . . .\r\n");
  ASSERT_EQ(cloud.size(), 2);
  EXPECT_NEAR(cloud.world(1).x(), 4320979.61, 1e-7);
  EXPECT_FALSE(cloud.viewpoint);
  EXPECT_TRUE(cloud.extra.empty());
}

TEST(Pcd, PaddingIsSkippedInBinaryFiles) {
  const std::string start =
      "FIELDS _ x y _ z\nSIZE 1 4 4 4 4\nTYPE U F F F F\nCOUNT 3 1 1 1 1\n"
      "WIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA binary\n";
  const SurfelCloud cloud = cloud_of(start + "abc" + raw(1.0f) + raw(2.0f) + raw(9.0f) + raw(3.0f));
  EXPECT_EQ(cloud.position[0], Vec3f(1, 2, 3));
}

TEST(Pcd, OrganisedCloudsAreFlattenedRowByRow) {
  const SurfelCloud cloud = cloud_of(
      "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 2\nHEIGHT 3\n"
      "DATA ascii\n0 0 0\n1 0 0\nnan nan nan\n3 0 0\n4 0 0\n5 0 0\n");
  ASSERT_EQ(cloud.size(), 6);
  EXPECT_EQ(cloud.position[5], Vec3f(5, 0, 0));
  EXPECT_TRUE(std::isnan(cloud.position[2].z()));
}

TEST(Pcd, PackedColoursOfAnyDeclaredType) {
  const auto start = [](const std::string& name, const std::string& type) {
    return "FIELDS x y z " + name + "\nSIZE 4 4 4 4\nTYPE F F F " + type +
           "\nWIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA binary\n" + raw(0.0f) + raw(0.0f) + raw(0.0f);
  };
  const std::string packed = raw(0x00ff0080u);
  const Vec3f expected(1, 0, srgb8_to_linear(128));
  for (const std::string type : {"F", "U", "I"}) {
    EXPECT_EQ(cloud_of(start("rgb", type) + packed).color[0], expected) << type;
    EXPECT_EQ(cloud_of(start("rgba", type) + packed).color[0], expected) << type;
  }
  // An alpha that is zero everywhere says nothing; in rgb it never does.
  EXPECT_TRUE(cloud_of(start("rgba", "U") + packed).alpha.empty());
  EXPECT_TRUE(cloud_of(start("rgb", "U") + raw(0x80ff0080u)).alpha.empty());
  EXPECT_EQ(cloud_of(start("rgba", "U") + raw(0xffff0080u)).alpha[0], 1);
}

TEST(Pcd, ViewpointGoesThroughEveryFormat) {
  const SurfelCloud cloud = cloud_of(header("binary") + binary_body());
  test::TemporaryFolder folder;
  for (const char* name : {"a.ply", "a.pcd"}) {
    write_cloud(cloud, folder / name);
    const SurfelCloud read = read_cloud(folder / name);
    ASSERT_TRUE(read.viewpoint) << name;
    EXPECT_EQ(read.viewpoint->orientation, cloud.viewpoint->orientation);
    EXPECT_EQ(read.viewpoint->position, cloud.viewpoint->position);
    expect_two_points(read);
  }
}

TEST(Pcd, DefaultViewpointIsUnknownUnlessPointsAreInRows) {
  const auto read = [](const std::string& size, const std::string& viewpoint) {
    return cloud_of("FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\n" + size + "\nVIEWPOINT " + viewpoint +
                    "\nDATA ascii\n0 0 1\n1 0 1\n0 1 1\n1 1 1\n");
  };
  EXPECT_FALSE(read("WIDTH 4\nHEIGHT 1", "0 0 0 1 0 0 0").viewpoint);
  EXPECT_TRUE(read("WIDTH 4\nHEIGHT 1", "0 0 1 1 0 0 0").viewpoint);
  EXPECT_TRUE(read("WIDTH 4\nHEIGHT 1", "0 0 0 0 1 0 0").viewpoint);
  const SurfelCloud organised = read("WIDTH 2\nHEIGHT 2", "0 0 0 1 0 0 0");
  ASSERT_TRUE(organised.viewpoint);
  // Written without rows, it is still known.
  test::TemporaryFolder folder;
  for (const char* name : {"a.ply", "a.pcd"}) {
    write_cloud(organised, folder / name);
    const SurfelCloud again = read_cloud(folder / name);
    ASSERT_TRUE(again.viewpoint) << name;
    EXPECT_TRUE(is_default(*again.viewpoint));
  }
}

TEST(Pcd, BrokenHeadersAreRefusedWithTheirLine) {
  const auto changed = [](const std::string& from, const std::string& to) {
    std::string bytes = header("binary");
    bytes.replace(bytes.find(from), from.size(), to);
    return error_of(bytes + binary_body());
  };
  EXPECT_EQ(changed("TYPE F F F U", "TYPE F Q F U"),
            "line 12: field y has the unknown TYPE Q of SIZE 4; known are F of 4 or 8 bytes, I and "
            "U of 1, 2, 4 or 8");
  EXPECT_TRUE(
      changed("SIZE 4 4", "SIZE 4 3").starts_with("line 12: field y has the unknown TYPE F"));
  EXPECT_EQ(changed("SIZE 4 4 4", "SIZE 4 4"), "line 5: SIZE has 5 values for 6 fields");
  EXPECT_EQ(changed("COUNT 1", "COUNT 0"), "line 12: field x has 0 values of 4 bytes");
  EXPECT_EQ(changed("COUNT 1", "COUNT 4000000000"),
            "line 12: field x has 4000000000 values of 4 bytes");
  EXPECT_EQ(changed("FIELDS x y", "FIELDS x x"), "line 12: field x stands there twice");
  EXPECT_EQ(changed("FIELDS x y z rgba time hist\n", ""), "line 4: SIZE has 6 values for 0 fields");
  EXPECT_EQ(changed("POINTS 2", "POINTS 3"), "line 12: WIDTH 2 times HEIGHT 1 is not POINTS 3");
  EXPECT_EQ(changed("WIDTH 2\nHEIGHT 1", "WIDTH 9223372036854775808\nHEIGHT 2"),
            "line 12: WIDTH 9223372036854775808 times HEIGHT 2 is not POINTS 2");
  EXPECT_EQ(changed("WIDTH 2", "WIDTH -2"), "line 8: '-2' is not a count");
  EXPECT_EQ(changed("VIEWPOINT 1 2", "VIEWPOINT 1"),
            "line 10: VIEWPOINT needs seven numbers: tx ty tz qw qx qy qz");
  EXPECT_EQ(changed("HEIGHT", "DEPTH"), "line 9: 'DEPTH' is not a word of PCD headers");
  EXPECT_EQ(changed("DATA binary", "DATA zip"),
            "line 12: DATA 'zip' is none of ascii, binary, binary_compressed");
  EXPECT_EQ(error_of("VERSION 0.7\nFIELDS x y z\n"),
            "line 2: the header ends without 'DATA'; the file is truncated or is no PCD file");
  EXPECT_EQ(error_of("FIELDS x z\nSIZE 4 4\nTYPE F F\nPOINTS 1\nDATA ascii\n1 2\n"),
            "the points have no column y; x, y and z are needed");
}

TEST(Pcd, LyingCountsAreRefusedBeforeAnyAllocation) {
  for (const std::string data : {"ascii", "binary", "binary_compressed"}) {
    const std::string message = error_of(header(data, "1000000000000") + std::string(100, '1'));
    EXPECT_TRUE(message.starts_with("the header promises 1000000000000 points") ||
                message == "the compressed points are truncated")
        << message;
  }
  // Few compressed bytes cannot hold much, whatever sizes they claim.
  EXPECT_TRUE(error_of(header("binary_compressed", "100000000") + raw(std::uint32_t{4}) +
                       raw(std::uint32_t{2800000000}) + "1234")
                  .starts_with("the header promises 100000000 points of 28 bytes"));
}

TEST(Pcd, MoreColumnsThanAProgramWritesAreRefused) {
  std::string fields;
  for (int i = 0; i <= 8192; ++i) fields += " f" + std::to_string(i);
  EXPECT_EQ(error_of("FIELDS" + fields + "\n"),
            "line 1: more than 8192 fields are not supported; leave some out");
  EXPECT_EQ(error_of("FIELDS x y z f\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 9000\nPOINTS 1\n"
                     "DATA ascii\n1 2 3\n"),
            "line 6: more than 8192 fields are not supported; leave some out");
}

TEST(Pcd, EveryTruncationIsAnError) {
  for (const std::string& bytes :
       {header("binary") + binary_body(), header("binary_compressed") + compressed_body()}) {
    for (std::size_t size = 0; size < bytes.size(); ++size) {
      EXPECT_NE(error_of(bytes.substr(0, size)), "no error") << size;
    }
  }
}

TEST(Pcd, DamagedCompressedDataIsReadOrRefused) {
  const std::string valid = header("binary_compressed") + compressed_body();
  int refused = 0;
  for (std::size_t at = header("binary_compressed").size(); at < valid.size(); ++at) {
    for (const char c : {'\0', '\x20', '\x7f', '\xff'}) {
      std::string bytes = valid;
      bytes[at] = c;
      refused += error_of(bytes) != "no error";
    }
  }
  EXPECT_GT(refused, 10);
}

TEST(Pcd, BrokenTextIsRefusedWithItsLine) {
  const std::string start = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nPOINTS 2\nDATA ascii\n";
  EXPECT_EQ(error_of(start + "1 2 3\n1 zwei 3\n"),
            "line 7: 'zwei' in point 1 is not a number of type double");
  EXPECT_EQ(error_of(start + "1 2 3 4\n1 2 3\n"),
            "line 6: more values than point 0 has according to the header");
  EXPECT_EQ(error_of(start + "1 2 3\n1000 2000\n"),
            "line 8: the file ends within point 1; it is truncated");
}

}  // namespace
}  // namespace surfel
