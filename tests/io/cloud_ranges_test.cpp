#include <algorithm>
#include <cstring>
#include <fstream>
#include <sstream>

#include <gtest/gtest.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/cloud_ranges.h>
#include <surfel/lod/hierarchy.h>

#include "support/run_tool.h"

namespace surfel::test {
namespace {

constexpr std::size_t kRangedCount = 50000;

/// Surfels around a place, on multiples of a step.
SurfelCloud cloud_at(const Vec3d& origin, float step) {
  SurfelCloud cloud;
  cloud.origin = origin;
  ExtraProperty& extra = cloud.extra.emplace_back(ExtraProperty{"scan", ScalarType::kUint8, {}});
  for (std::size_t i = 0; i < kRangedCount; ++i) {
    const auto random = [&](int d) { return static_cast<float>(random_uniform(5, i, d)); };
    const auto at = [&](int d) { return std::round(10000 * random(d)) * step; };
    cloud.position.emplace_back(at(0), at(1), at(2));
    cloud.normal.push_back(Vec3f(random(3), random(4), 1).normalized());
    cloud.variance.push_back(1e-3F + random(5));
    cloud.color.emplace_back(random(6), random(7), random(8));
    extra.data.push_back(static_cast<std::byte>(i % 18));
  }
  cloud.position[7].x() = NAN;
  cloud.viewpoint = Viewpoint{Vec3d(1, 2, 3), {1, 0, 0, 0}};
  return cloud;
}

template <class T>
std::vector<std::byte> bytes_of(const Array<T>& column) {
  std::vector<std::byte> bytes(column.size() * sizeof(T));
  if (!bytes.empty()) std::memcpy(bytes.data(), column.data(), bytes.size());
  return bytes;
}

/// All columns of a cloud, one after the other.
std::vector<std::vector<std::byte>> columns_of(const SurfelCloud& cloud) {
  std::vector<std::vector<std::byte>> columns;
  SurfelCloud::visit_columns(cloud,
                             [&](const auto& column) { columns.push_back(bytes_of(column)); });
  for (const ExtraProperty& extra : cloud.extra) columns.push_back(bytes_of(extra.data));
  return columns;
}

void expect_the_whole(const std::string& file) {
  const SurfelCloud whole = read_cloud(file);
  const auto ranges = CloudRanges::open(file);
  ASSERT_NE(ranges, nullptr) << file;
  ASSERT_EQ(ranges->size(), whole.size());
  EXPECT_EQ(ranges->origin(), whole.origin);
  const auto grid = ranges->grid();
  const auto whole_grid = morton_grid(whole.position);
  EXPECT_EQ(grid.low, whole_grid.low);
  EXPECT_EQ(grid.cells_per_unit, whole_grid.cells_per_unit);

  // Several threads read at once, in any order.
  constexpr std::size_t kRange = 7001;
  const std::size_t parts = (whole.size() + kRange - 1) / kRange;
  std::vector<std::vector<std::vector<std::byte>>> read(parts);
  parallel_each(parts, 1, [&](std::size_t k) {
    const std::size_t part = parts - 1 - k;
    const std::size_t begin = part * kRange;
    const SurfelCloud range = ranges->read(begin, std::min(whole.size(), begin + kRange));
    EXPECT_EQ(bytes_of(ranges->positions(begin, begin + range.size())), bytes_of(range.position));
    EXPECT_EQ(range.origin, whole.origin);
    EXPECT_EQ(range.decimals, whole.decimals);
    EXPECT_EQ(range.double_positions, whole.double_positions);
    EXPECT_EQ(range.color_encoding, whole.color_encoding);
    EXPECT_EQ(range.viewpoint.has_value(), whole.viewpoint.has_value());
    EXPECT_EQ(range.coarser_skipped, whole.coarser_skipped);
    read[part] = columns_of(range);
  });
  std::vector<std::vector<std::byte>> joined(read[0].size());
  for (const auto& part : read) {
    for (std::size_t k = 0; k < part.size(); ++k) {
      joined[k].insert(joined[k].end(), part[k].begin(), part[k].end());
    }
  }
  const auto columns = columns_of(whole);
  ASSERT_EQ(joined.size(), columns.size());
  for (std::size_t k = 0; k < columns.size(); ++k) EXPECT_TRUE(joined[k] == columns[k]) << k;
}

TEST(CloudRanges, TogetherAreWhatReadCloudGives) {
  const TemporaryFolder folder;
  write_cloud(cloud_at({0, 0, 0}, 0.01F), folder / "near.ply");
  expect_the_whole(folder / "near.ply");
  // Coordinates of few decimals that need an origin, of many, and floats far from the origin.
  write_cloud(cloud_at({455000, 5401000, 200}, 0.25F), folder / "decimals.ply");
  expect_the_whole(folder / "decimals.ply");
  write_cloud(cloud_at({455000.123456789, 5401000, 200}, 0.01F), folder / "far.ply");
  expect_the_whole(folder / "far.ply");
  SurfelCloud las = cloud_at({455000, 5401000, 200}, 0.25F);
  las.las = LasStorage{.scale = Vec3d(0.25, 0.25, 0.25), .offset = {1, 2, 3}, .records = {}};
  write_cloud(las, folder / "steps.ply");
  expect_the_whole(folder / "steps.ply");
}

TEST(CloudRanges, OfLevelsAreTheFinest) {
  const TemporaryFolder folder;
  write_cloud(build_hierarchy(cloud_at({0, 0, 0}, 0.01F), {}), folder / "levels.ply");
  expect_the_whole(folder / "levels.ply");
}

TEST(CloudRanges, OfTheOtherByteOrder) {
  const TemporaryFolder folder;
  std::string text =
      "ply\nformat binary_big_endian 1.0\nelement vertex 300\nproperty float x\nproperty float y\n"
      "property float z\nproperty ushort scan\nend_header\n";
  for (std::size_t i = 0; i < 300; ++i) {
    for (const std::uint32_t bits : {0x3f800000U + static_cast<std::uint32_t>(i), 0x40000000U,
                                     0xbf800000U - static_cast<std::uint32_t>(i)}) {
      for (int byte = 3; byte >= 0; --byte) text += static_cast<char>(bits >> (8 * byte) & 0xff);
    }
    text += static_cast<char>(i >> 8);
    text += static_cast<char>(i & 0xff);
  }
  std::ofstream(folder / "big.ply", std::ios::binary) << text;
  expect_the_whole(folder / "big.ply");
}

TEST(CloudRanges, OfOtherFilesAreNone) {
  const TemporaryFolder folder;
  const SurfelCloud cloud = cloud_at({0, 0, 0}, 0.01F);
  write_cloud(cloud, folder / "text.ply", {.ascii = true});
  write_cloud(cloud, folder / "text.csv");
  write_cloud(cloud, folder / "points.pcd");
  std::ofstream(folder / "lists.ply", std::ios::binary)
      << "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\n"
         "property float y\nproperty float z\nproperty list uchar int near\nend_header\n"
      << std::string(13, '\0');
  for (const char* name : {"text.ply", "text.csv", "points.pcd", "lists.ply"}) {
    EXPECT_EQ(CloudRanges::open(folder / name), nullptr) << name;
  }
  EXPECT_NE(range_advice("a file.pcd").find("surfel-convert --sort curve 'a file.pcd' -o"),
            std::string::npos);
}

}  // namespace
}  // namespace surfel::test
