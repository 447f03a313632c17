#include <fmt/format.h>
#include <gtest/gtest.h>
#include <surfel/base/color.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/file_kind.h>

#include "io/cloud_of_bytes.h"
#include "support/message_of.h"
#include "support/run_tool.h"
#include "support/test_data.h"

namespace surfel::test {
namespace {

SurfelCloud cloud_of_text(const std::string& text) {
  return read_cloud(InputFile("scan.ptx", std::as_bytes(std::span(text))));
}

std::string failure_of_text(const std::string& text) {
  return message_of([&] { cloud_of_text(text); });
}

constexpr const char* kUnmoved = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n";
/// A quarter turn about z, then (10, 20, 30).
constexpr const char* kMoved =
    "10 20 30\n0 1 0\n-1 0 0\n0 0 1\n0 1 0 0\n-1 0 0 0\n0 0 1 0\n10 20 30 1\n";

TEST(Ptx, GridsColorsAndLinesOfSightWithoutReturn) {
  const SurfelCloud cloud =
      cloud_of_text(std::string("2\n3\n") + kMoved +
                    "1 2 3 0.5 255 0 10\n0 0 0 0.5 0 0 0\r\n4 5 6 0.25 0 255 0\n\n"
                    "0 0 0 0 0 0 0\n7 8 9 1 1 2 3\n10 0 0 0 4 5 6");
  ASSERT_EQ(cloud.size(), 4U);
  EXPECT_EQ(cloud.unmeasured_skipped, 2U);
  EXPECT_EQ(cloud.world(0), Vec3d(8, 21, 33));
  EXPECT_EQ(cloud.world(3), Vec3d(10, 30, 30));
  EXPECT_EQ(cloud.color[0], Vec3f(1, 0, srgb8_to_linear(10)));
  EXPECT_EQ(values_of(cloud, "intensity"), (std::vector<double>{0.5, 0.25, 1, 0}));
  EXPECT_EQ(values_of(cloud, "row_index"), (std::vector<double>{0, 2, 1, 2}));
  EXPECT_EQ(values_of(cloud, "column_index"), (std::vector<double>{0, 0, 1, 1}));
  ASSERT_TRUE(cloud.viewpoint);
  EXPECT_EQ(cloud.viewpoint->position, Vec3d(10, 20, 30));
  const Vec4d& q = cloud.viewpoint->orientation;
  const Vec3d ahead = Eigen::Quaterniond(q[0], q[1], q[2], q[3]) * Vec3d(1, 0, 0);
  EXPECT_TRUE(ahead.isApprox(Vec3d(0, 1, 0)));
}

TEST(Ptx, ScansFollowOneAnother) {
  const std::string first = std::string("1\n2\n") + kMoved + "1 2 3 0.5\n4 5 6 0.25\n";
  const std::string second = std::string("2\n2\n") + kUnmoved +
                             "1 0 0 0 255 255 255\n2 0 0 0 0 0 0\n3 0 0 0 0 0 0\n4 0 0 0 0 0 0\n";
  const SurfelCloud cloud = cloud_of_text(first + second);
  ASSERT_EQ(cloud.size(), 6U);
  EXPECT_EQ(values_of(cloud, "scan"), (std::vector<double>{0, 0, 1, 1, 1, 1}));
  EXPECT_NEAR(cloud.color[0][0], SurfelCloud::colorless()[0], 3e-3);  // Without colours.
  EXPECT_EQ(cloud.color[2], Vec3f(1, 1, 1));
  EXPECT_FALSE(cloud.viewpoint);
  ASSERT_EQ(cloud.scan_viewpoints.size(), 2U);
  EXPECT_EQ(cloud.scan_viewpoints[0].position, Vec3d(10, 20, 30));
  EXPECT_EQ(cloud.scan_viewpoints[1].position, Vec3d(0, 0, 0));
  // Points that neither a matrix nor a grid ties to a place.
  const std::string list = std::string("3\n1\n") + kUnmoved + "1 0 0 0\n2 0 0 0\n3 0 0 0\n";
  EXPECT_FALSE(cloud_of_text(list).viewpoint);
  EXPECT_TRUE(cloud_of_text(first + list).scan_viewpoints.empty());
}

TEST(Ptx, FilesOfOtherPrograms) {
  SURFEL_REQUIRE_TEST_DATA();
  const auto folder = data_folder() / "formats/ptx";
  EXPECT_EQ(file_kind(folder / "no-color.ptx"), FileKind::kCloud);
  EXPECT_EQ(read_cloud(folder / "no-color.ptx").size(), 15U);
  const SurfelCloud moved = read_cloud(folder / "multiple-and-transform.ptx");
  ASSERT_EQ(moved.size(), 8U);
  // Both scans hold the same points, the first one's in its own coordinates.
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_LT((moved.world(i) - moved.world(4 + i)).norm(), 0.02) << i;
  }
  const SurfelCloud complex = read_cloud(folder / "complex-transform.ptx");
  ASSERT_EQ(complex.size(), 4U);
  EXPECT_EQ(complex.unmeasured_skipped, 8U);
  EXPECT_LT((complex.world(0) - Vec3d(-3.034405, -3.173812, -1.823726)).norm(), 1e-4);
  ASSERT_TRUE(complex.viewpoint);
  EXPECT_EQ(complex.viewpoint->position, Vec3d(-3.028748, -3.819741, -1.384333));
}

TEST(Ptx, FilesCutAnywhereAreRefused) {
  const std::string text =
      std::string("2\n2\n") + kMoved + "1 2 3 0.5\n0 0 0 0.5\n4 5 6 0.25\n7 8 9 1\n";
  EXPECT_EQ(cloud_of_text(text).size(), 3U);
  // The last value may lose digits and the line its end, which no reader can tell.
  const std::size_t whole = text.size() - 2;
  for (std::size_t size = 1; size < whole; ++size) {
    ASSERT_NE(failure_of_text(text.substr(0, size)).find("scan.ptx: "), std::string::npos) << size;
  }
}

TEST(Ptx, WhatIsWrongIsNamed) {
  const std::string head = std::string("2\n1\n") + kUnmoved;
  for (const auto& [text, says] : std::vector<std::pair<std::string, std::string>>{
           {"2 2\n", "line 1: '2' is not the number of columns of scan 1"},
           {"0\n1\n", "is not the number of columns"},
           {"2\n-1\n", "is not the number of rows"},
           {"99999999999999999\n1\n", "promises 99999999999999999 columns"},
           {"2\n99999999999\n" + std::string(kUnmoved) + "1 1 1 1\n", "99999999999 rows"},
           {"2\n2\n0 0\n" + std::string(200, '\n'), "2 values, where the scanner's place"},
           {"2\n2\n0 0 nan\n" + std::string(200, '\n'), "is not finite"},
           {head + "1 2 3\n1 2 3\n", "3 values; the points of a scan"},
           {head + "1 2 3 4\n1 2 3 4 5 6 7\n", "7 values; the points of a scan"},
           {head + "1 2 3 4 5 6 256\n1 2 3 4 5 6 7\n", "'256' is no colour"},
           {head + "1 2 3 x\n1 2 3 4\n", "'x' is not a number"},
           {head + "1,5 2 3 4\n1 2 3 4\n", "'1,5' has decimal commas"},
           {head + "0 0 0 1\n0 0 0 1\n", "none of its 2 points was measured"},
           {"\n\n", "holds no scans"}}) {
    EXPECT_NE(failure_of_text(text).find(says), std::string::npos) << failure_of_text(text);
  }
  EXPECT_EQ(cloud_of_text(head + "1 2 nan 4\n1 2 3 4\n").size(), 2U);
}

TEST(Ptx, BlocksOfLargeFilesAreOne) {
  constexpr int kColumns = 300;
  constexpr int kRows = 250;  // Two blocks or so for each scan.
  const auto scan = [&](const char* header) {
    std::string text = fmt::format("{}\n{}\n{}", kColumns, kRows, header);
    for (int i = 0; i < kColumns * kRows; ++i) {
      text += i % 7 == 0 ? "0 0 0 0\n" : fmt::format("{} {} 1 0.5\n", i, i % 1000);
    }
    return text;
  };
  const std::string text = scan(kUnmoved) + scan(kMoved);
  const SurfelCloud cloud = cloud_of_text(text);
  constexpr int kUnmeasured = (kColumns * kRows + 6) / 7;
  constexpr int kMeasured = kColumns * kRows - kUnmeasured;
  ASSERT_EQ(cloud.size(), 2 * kMeasured);
  EXPECT_EQ(cloud.unmeasured_skipped, 2 * kUnmeasured);
  const std::vector<double> rows = values_of(cloud, "row_index");
  const std::vector<double> columns = values_of(cloud, "column_index");
  const std::vector<double> scans = values_of(cloud, "scan");
  for (int k = 0, i = 0; i < kColumns * kRows; ++i) {
    if (i % 7 == 0) continue;
    for (const int s : {0, 1}) {
      const auto at = static_cast<std::size_t>(k + s * kMeasured);
      ASSERT_EQ(cloud.world(at), s == 0 ? Vec3d(i, i % 1000, 1) : Vec3d(10 - i % 1000, 20 + i, 31));
      ASSERT_EQ(scans[at], s);
      ASSERT_EQ(rows[at], i % kRows);
      ASSERT_EQ(columns[at], i / kRows);
    }
    ++k;
  }
  EXPECT_EQ(failure_of_text(text.substr(0, text.rfind('\n', text.size() - 2) + 1)),
            "scan.ptx: scan 2 has 74999 of 75000 points; it is truncated");
  EXPECT_TRUE(contains(failure_of_text(text + "1 2 3 4\n"), "line 150021:"));
}

}  // namespace
}  // namespace surfel::test
