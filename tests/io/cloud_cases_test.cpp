// Clouds that went wrong in other programs, or here, as files of the real data.

#include <string>
#include <vector>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <surfel/io/cloud_io.h>

#include "io/cloud_of_bytes.h"
#include "support/run_tool.h"
#include "support/test_data.h"

namespace surfel::test {
namespace {

std::string cloud_case(const char* name) { return (data_folder() / "cases" / name).string(); }

TEST(CloudCases, CoordinatesBesideAStrayPointKeepEveryDigit) {
  SURFEL_REQUIRE_TEST_DATA();
  const TemporaryFolder folder;
  const std::string text = read_text(cloud_case("stray_utm.xyz"));
  const SurfelCloud cloud = read_cloud(cloud_case("stray_utm.xyz"));
  ASSERT_EQ(cloud.size(), 4U);
  EXPECT_EQ(cloud.world(0), Vec3d(500000.123, 5400000.456, 100.789));
  EXPECT_EQ(cloud.world(2), Vec3d(500002.345, 5400000.678, 100.912));
  EXPECT_EQ(cloud.world(3), Vec3d(0, 0, 0));
  for (const char* name : {"a.ply", "a.csv", "a.pcd"}) {
    write_cloud(cloud, folder / name);
    write_cloud(read_cloud(folder / name), folder / "b.xyz");
    EXPECT_EQ(read_text(folder / "b.xyz"), text) << name;
  }
  // 32 bits have no room for so many thousandths.
  for (const char* name : {"a.las", "a.laz"}) {
    const std::vector<std::string> notes = write_cloud(cloud, folder / name);
    ASSERT_EQ(notes.size(), 1U) << name;
    EXPECT_NE(notes.front().find("steps of 0.01"), std::string::npos) << notes.front();
    const SurfelCloud read = read_cloud(folder / name);
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      EXPECT_LE((read.world(i) - cloud.world(i)).cwiseAbs().maxCoeff(), 0.005 + 1e-9) << name;
    }
  }
}

TEST(CloudCases, FieldsOfLasHoldWhatTextHas) {
  SURFEL_REQUIRE_TEST_DATA();
  const TemporaryFolder folder;
  const SurfelCloud cloud = read_cloud(cloud_case("las_fields.csv"));
  for (const char* name : {"a.las", "a.laz"}) {
    const std::vector<std::string> notes = write_cloud(cloud, folder / name);
    EXPECT_EQ(notes, std::vector<std::string>{"intensity: stored as the value times 65535"});
    const SurfelCloud read = read_cloud(folder / name);
    EXPECT_EQ(values_of(read, "classification"), (std::vector<double>{2, 40, 6}));
    // 65535 times 0.5, 0.25 and the float next to 0.9, which is a little smaller.
    EXPECT_EQ(values_of(read, "intensity"), (std::vector<double>{32768, 58981, 16384}));
    for (const ExtraProperty& column : read.extra) {
      EXPECT_EQ(column.name.find("_2"), std::string::npos) << column.name;
    }
  }
}

}  // namespace
}  // namespace surfel::test
