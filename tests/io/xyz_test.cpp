#include <array>
#include <cmath>
#include <fstream>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <surfel/base/color.h>
#include <surfel/base/error.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/surfel_decoder.h>

#include "support/message_of.h"
#include "support/run_tool.h"
#include "support/test_data.h"

namespace surfel::test {
namespace {

SurfelCloud read_text(const std::string& text, const std::string& name = "points.xyz") {
  const TemporaryFolder folder;
  std::ofstream(folder / name, std::ios::binary) << text;
  return read_cloud(folder / name);
}

std::string failure_of(const std::string& text) {
  try {
    read_text(text);
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kInput);
    return error.what();
  }
  return "no error";
}

TEST(Xyz, SeparatorsCommentsAndLineEnds) {
  for (const char* text : {"1 2 3\n4 5 6\n", "1,2,3\r\n4, 5, 6\r\n", "# made by\n1;2;3\n\n4;5;6",
                           "// x y z\n\t1\t2\t3 \n4 5 6 \n", "2\n1 2 3\n4 5 6\n", "1 2 3\r4 5 6\r",
                           "\xef\xbb\xbf"
                           "1 2 3\n4 5 6\n",
                           "1\n1 2 3\n1\n4 5 6\n", "\xef\xbb\xbfX,Y,Z\n1,2,3\n4,5,6\n",
                           "# x y z of a scan\n1 2 3\n4 5 6\n", "X,Y,Z\n1,2,3\n4,5,6\n",
                           "\"x\" \"y\" \"z\"\n+1 2.0 3e0\n4 5 6\n"}) {
    const SurfelCloud cloud = read_text(text);
    ASSERT_EQ(cloud.size(), 2U) << text;
    EXPECT_EQ(cloud.world(0), Vec3d(1, 2, 3)) << text;
    EXPECT_EQ(cloud.world(1), Vec3d(4, 5, 6)) << text;
    EXPECT_TRUE(cloud.normal.empty() && cloud.color.empty() && cloud.extra.empty()) << text;
  }
}

TEST(Xyz, ColumnsByNumber) {
  const SurfelCloud normals = read_text("1 2 3 0 0.6 0.8\n1 2 3 1 0 0\n");
  EXPECT_EQ(normals.normal.at(0), Vec3f(0, 0.6F, 0.8F));
  const SurfelCloud unknown = read_text("1 2 3 0 0.6 0.8\n1 2 3 0 0 0\n");
  EXPECT_EQ(unknown.normal.at(1), Vec3f(0, 0, 0));
  EXPECT_TRUE(unknown.color.empty());
  EXPECT_EQ(read_text("1 2 3 0 0 0\n").color.at(0), Vec3f(0, 0, 0));
  const SurfelCloud colors = read_text("1 2 3 0 128 255\n1 2 3 1 0 0\n");
  EXPECT_EQ(colors.color.at(0), Vec3f(0, srgb8_to_linear(128), 1));
  EXPECT_EQ(colors.color_encoding, ColorEncoding::kUint8Srgb);
  EXPECT_EQ(read_text("1 2 3 0 65535 0\n").color.at(0), Vec3f(0, 1, 0));
  EXPECT_EQ(read_text("1 2 3 -1035\n").extra.at(0).name, "intensity");
  EXPECT_EQ(read_text("1 2 3 -1035 255 0 0\n").color.at(0), Vec3f(1, 0, 0));
  for (const char* text : {"1 2 3 0 0 1 255 0 0\n", "1 2 3 255 0 0 0 0 1\n"}) {
    const SurfelCloud both = read_text(text);
    EXPECT_EQ(both.normal.at(0), Vec3f(0, 0, 1)) << text;
    EXPECT_EQ(both.color.at(0), Vec3f(1, 0, 0)) << text;
  }
}

TEST(Xyz, ColorsThatAreNoWholeCodes) {
  const auto color = [](const std::string& text) { return read_text(text).color.at(0); };
  const Vec3f halves(0, srgb_to_linear(0.25F), srgb_to_linear(0.5F));
  EXPECT_EQ(color("1 2 3 0 0.25 0.5\n"), halves);
  EXPECT_EQ(color("# light\n1 2 3 0 0.25 0.5\n"), halves);
  EXPECT_EQ(color("# colours are linear\n1 2 3 0 0.25 0.5\n"), Vec3f(0, 0.25F, 0.5F));
  EXPECT_EQ(color("x y z r g b\n1 2 3 0 0.25 0.5\n"), halves);
  // Black and white of 0..1, since no picture has codes 0 and 1 alone.
  EXPECT_EQ(color("1 2 3 0 1 0\n1 2 3 1 1 1\n"), Vec3f(0, 1, 0));
  EXPECT_EQ(color("1 2 3 0 127.5 255\n"), Vec3f(0, srgb_to_linear(0.5F), 1));
  EXPECT_EQ(color("1 2 3 0 0.5 65535\n")[2], 1.0F);
  EXPECT_EQ(color("# linear\n1 2 3 0 1 2\n"), Vec3f(0, 1, 2));
  EXPECT_TRUE(std::isnan(color("1 2 3 0 nan 0.5\n")[1]));
}

TEST(Xyz, ColumnsThatTheCallerNames) {
  const auto read = [](const std::string& text, const std::vector<std::string>& columns) {
    return read_cloud(InputFile("points.xyz", std::as_bytes(std::span(text))),
                      {.columns = columns});
  };
  const std::vector<std::string> columns{"Y", "x", "z", "-", "r", "g", "b", "-", "time"};
  for (const char* names : {"", "a,b,c,d,e,f,g,h,i\n", "x,y,z,r,g,b,u,v,w\n", "//x y z\n"}) {
    const SurfelCloud cloud =
        read(std::string(names) + "2,1,3,9,255,0,0,8,7.5\n5,4,6,9,0,255,0,8,8.5\n", columns);
    ASSERT_EQ(cloud.size(), 2U) << names;
    EXPECT_EQ(cloud.world(1), Vec3d(4, 5, 6)) << names;
    EXPECT_EQ(cloud.color.at(0), Vec3f(1, 0, 0)) << names;
    ASSERT_EQ(cloud.extra.size(), 1U) << names;
    EXPECT_EQ(cloud.extra[0].name, "time") << names;
  }
  EXPECT_EQ(read("2\n1 2 3 4\n1 2 3 4\n", {"-", "x", "y", "z"}).world(0), Vec3d(2, 3, 4));
  const auto fails = [&](const std::string& text, const std::vector<std::string>& names) {
    return message_of([&] { read(text, names); });
  };
  EXPECT_NE(fails("1 2 3 4\n", {"x", "y", "z"}).find("4 values, and `columns` names 3"),
            std::string::npos);
  EXPECT_NE(fails("1 2 3\n", {"x", "y", "-"}).find("does not name z"), std::string::npos);
  EXPECT_NE(fails("1 2 3\n", {"x", "y", "z", "X"}).find("'x' twice"), std::string::npos);
  EXPECT_NE(fails("1 2 3\n", {"x", "y", "z", ""}).find("empty name"), std::string::npos);
  EXPECT_NE(fails("ply\n", {"x", "y", "z"}), "");
  const std::string ply = "ply\nformat ascii 1.0\nelement vertex 1\nend_header\n";
  EXPECT_NE(
      message_of([&] {
        read_cloud(InputFile("a.ply", std::as_bytes(std::span(ply))), {.columns = {"x", "y", "z"}});
      }).find("is no text file"),
      std::string::npos);
}

TEST(Xyz, DecimalCommasAreRefused) {
  for (const char* text : {"1,5 2,25 -3,0\n", "1 2,5 3\n", "1,5;2,25;3,0\n", "1,5\t23\t3,5\n",
                           "x;y;z\n1,5;2,5;3,5\n", "1 2 3\n1,5 2,5 3\n", "4,5 1e-3 1,25e-3\n"}) {
    EXPECT_NE(failure_of(text).find("has decimal commas"), std::string::npos) << text;
  }
  for (const char* text : {"1, 2, 3\n", "1,2,3\n", "1 ,2 ,3\n", "1,2 3\n", "1.5, 2.5, 3\n",
                           "0,0,0 255,0,0\n", "1,\t2,\t3\n"}) {
    EXPECT_FALSE(read_text(text).empty()) << text;
  }
}

TEST(Xyz, NamedColumns) {
  const SurfelCloud cloud = read_text("Red,Green,Blue,X,Y,Z,Time\n255,0,0,1,2,3,7.5\n");
  EXPECT_EQ(cloud.position.at(0), Vec3f(1, 2, 3));
  EXPECT_EQ(cloud.color.at(0), Vec3f(1, 0, 0));
  EXPECT_EQ(cloud.extra.at(0).name, "time");
  const SurfelCloud comment = read_text("# a scan\n//X Y Z Nx Ny Nz\n1\n1 2 3 0 0 0\n");
  EXPECT_EQ(comment.normal.at(0), Vec3f(0, 0, 0));
  EXPECT_TRUE(comment.color.empty());
}

TEST(Xyz, MapCoordinatesKeepTheirDigits) {
  const SurfelCloud cloud = read_text("289814.15 4320978.61 170.76\n289814.64 4320978.84 170.76\n");
  EXPECT_NEAR(cloud.world(1).y() - cloud.world(0).y(), 0.23, 1e-6);
}

TEST(Xyz, ColumnsAreFloatsWhereTheirNumbersAreWhatFloatsAreWrittenAs) {
  const auto type_of = [](const std::string& number) {
    return read_text("x,y,z,a\n0,0,0," + number + "\n", "a.csv").extra.at(0).type;
  };
  for (const char* number : {"0", "-1.435", "2.7139344e+20", "271393440246368567296", "0.12345679",
                             "16777216", "1e-45", "3.4028235e+38", "nan", "inf"}) {
    EXPECT_EQ(type_of(number), ScalarType::kFloat32) << number;
  }
  // 0.0009999986 and 0.0009999987 are next to the same float.
  for (const char* number : {"0.0009999986", "0.123456789", "16777217", "413665.23", "1e-320",
                             "5e-324", "1e39", "0.3333333333333333"}) {
    EXPECT_EQ(type_of(number), ScalarType::kFloat64) << number;
  }
}

TEST(Xyz, BrokenFilesAreRefused) {
  const auto expect = [](const std::string& text, const std::string& part) {
    EXPECT_NE(failure_of(text).find(part), std::string::npos) << failure_of(text);
  };
  expect("1 2 3\n4 5\n", "line 2: 2 values; the lines before have 3");
  expect("1 2 3\n4 five 6\n", "line 2: 'five' is not a number");
  expect("a b c\n1 2 3\n", "line 1: 'a' is no number");
  expect("# nothing\n", "holds no points");
  expect("x y z\n", "holds no points");
  expect("5\n1 2 3\n", "promises 5 points");
  expect("2\n1 2 3\n4 5 6\n7 8 9\n", "line 4: more points than the 2");
  expect("1 2 3\r4 five 6\r", "line 2: 'five' is not a number");
  expect("1 2 3\r\n4 five 6\r\n", "line 2: 'five' is not a number");
  expect("1000000000000\n1 2 3\n", "line 1: the count promises");
  expect("1 2\n1 2\n", "2 columns without names");
  expect("1 2 3 4 5\n", "5 columns without names");
}

TEST(Xyz, RealFiles) {
  SURFEL_REQUIRE_TEST_DATA();
  const auto read = [](const char* name) { return read_cloud((data_folder() / name).string()); };
  const SurfelCloud kitten = read("raw_scans/kitten.xyz");
  EXPECT_EQ(kitten.size(), kitten.normal.size());
  EXPECT_GT(kitten.size(), 4000U);
  EXPECT_EQ(read("malformed/tricky/pdal_crlf.txt").extra.at(0).name, "intensity");
  const SurfelCloud pts = read("malformed/tricky/pdal_points.pts");
  EXPECT_EQ(pts.size(), 19U);
  EXPECT_EQ(pts.color.at(0).x(), srgb8_to_linear(97));
}

/// Lines of `count` points, the last of which ends with `last`.
std::string many_points(std::size_t count, const std::string& last) {
  std::string text;
  for (std::size_t i = 0; i < count; ++i) {
    text += fmt::format("{} {} {}.5 {}\r\n", i, i % 1000, i % 7,
                        i + 1 == count ? last : fmt::format("{} 2 3", i % 200));
  }
  return text;
}

TEST(Xyz, BlocksOfLargeFilesAreOne) {
  constexpr std::size_t kCount = 100000;  // Three blocks or so.
  const std::string list = std::to_string(kCount) + "\r\n" + many_points(kCount, "256 2 3");
  const SurfelCloud cloud = read_text("# made\r\n" + list + "\r\n" + list);
  ASSERT_EQ(cloud.size(), 2 * kCount);
  EXPECT_EQ(cloud.color_encoding, ColorEncoding::kUint16Srgb) << "the last line has a larger code";
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const std::size_t k = i % kCount;
    ASSERT_EQ(cloud.world(i), Vec3d(static_cast<double>(k), static_cast<double>(k % 1000),
                                    static_cast<double>(k % 7) + 0.5))
        << i;
    const std::size_t code = k + 1 == kCount ? 256 : k % 200;
    ASSERT_EQ(cloud.color[i].x(), srgb16_table()[code]) << i;
  }
  const std::string points = many_points(kCount, "1 2 3");
  EXPECT_TRUE(contains(failure_of("x y z r g b\r\n" + many_points(kCount, "1 2 three")),
                       "line 100001: 'three' is not a number"));
  EXPECT_TRUE(
      contains(failure_of("99999\r\n" + points), "line 100001: more points than the 99999"));
  EXPECT_TRUE(contains(failure_of(points + "5\r\n"), "line 100001: 1 values"));
  EXPECT_TRUE(contains(failure_of("100000\n" + points + "2\n0 0 0 1 2 3\n"),
                       "promises 100002 points, but 100001 follow"));
}

TEST(Xyz, RepeatedNamesGetNumbers) {
  const SurfelCloud cloud = read_text("x,y,z,Time,time,time_2\n1,2,3,4,5,6\n", "a.csv");
  ASSERT_EQ(cloud.extra.size(), 3U);
  EXPECT_EQ(cloud.extra[0].name, "time");
  EXPECT_EQ(cloud.extra[1].name, "time_3");
  EXPECT_EQ(cloud.extra[2].name, "time_2");
}

TEST(Xyz, ChangedNamesAreNoted) {
  SurfelCloud cloud = read_text("1 2 3\n");
  for (const char* name : {"a,b", "Time", "time"}) {
    cloud.extra.push_back({name, ScalarType::kUint8, Array<std::byte>(1)});
  }
  const TemporaryFolder folder;
  const std::vector<std::string> notes = write_cloud(cloud, folder / "a.csv");
  ASSERT_EQ(notes.size(), 2U);
  EXPECT_TRUE(notes[0].starts_with("a,b is named a_b: ")) << notes[0];
  EXPECT_TRUE(notes[1].starts_with("time is named time_2: ")) << notes[1];
  EXPECT_EQ(read_cloud(folder / "a.csv").extra.size(), 3U);
}

/// A channel without the two others is no colour, whose codes would become linear light.
TEST(Xyz, OneChannelIsAColumnOfNumbers) {
  const SurfelCloud cloud = read_text("x,y,z,red\n1,2,3,27\n1,2,4,-5\n", "a.csv");
  ASSERT_EQ(cloud.extra.size(), 1U);
  EXPECT_TRUE(cloud.color.empty());
  std::array<double, 2> values{};
  load_scalars(cloud.extra[0].type, cloud.extra[0].data.data(), values.size(), values.data());
  EXPECT_EQ(values, (std::array<double, 2>{27, -5}));
}

}  // namespace
}  // namespace surfel::test
