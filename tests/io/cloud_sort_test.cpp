#include <algorithm>
#include <filesystem>
#include <limits>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/morton.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/cloud_ranges.h>
#include <surfel/io/cloud_sort.h>

#include "support/message_of.h"
#include "support/run_tool.h"
#include "support/test_data.h"

namespace surfel::test {
namespace {

/// Points in a box with a dense corner, repeated points, points that are nowhere, and a number of
/// each.
SurfelCloud make_points(std::size_t count, const Vec3d& origin, bool double_positions) {
  SurfelCloud cloud;
  cloud.origin = origin;
  cloud.double_positions = double_positions;
  cloud.decimals = double_positions ? std::optional(3) : std::nullopt;
  Array<std::byte> numbers(count * sizeof(std::uint32_t));
  for (std::size_t i = 0; i < count; ++i) {
    const auto coordinate = [&](int axis) {
      const double u = random_uniform(7, i % 97 == 0 ? i / 970 : i, axis);
      const double wide = i % 3 == 0 ? u * u * u * u : u;
      return static_cast<float>(std::floor(1000 * 500 * wide) / 1000);
    };
    Vec3f p(coordinate(0), coordinate(1), 0.1F * coordinate(2));
    if (i % 1009 == 5) p[static_cast<int>(i % 3)] = std::numeric_limits<float>::quiet_NaN();
    cloud.position.push_back(p);
    cloud.variance.push_back(1 + static_cast<float>(i));
    const auto number = static_cast<std::uint32_t>(i);
    std::memcpy(numbers.data() + i * sizeof(number), &number, sizeof(number));
  }
  cloud.extra.push_back({"number", ScalarType::kUint32, std::move(numbers)});
  return cloud;
}

/// Sorts a file as surfel-convert does.
void sort_file(const std::string& from, const std::string& to, const CloudSortOptions& options) {
  const CloudReader reader(from);
  CloudSurvey survey(to);
  PositionSample sample;
  reader.for_each([&](const SurfelCloud& piece) {
    survey.add(piece);
    sample.add(piece);
  });
  std::optional<SortedCloudWriter> writer;
  reader.for_each([&](SurfelCloud piece) {
    survey.settle(piece);
    if (!writer) {
      writer.emplace(to, survey, sample, piece, options);
      EXPECT_EQ(writer->scratch_bytes() == 0, options.memory > (std::uint64_t{1} << 30));
    }
    writer->append(piece);
  });
  writer->commit();
}

/// Whether a file is in the order in which its reader expects it.
bool in_readers_order(const std::string& path) {
  const auto sorted = CloudRanges::open(path);
  const Array<Vec3f> position = sorted->positions(0, sorted->size());
  const Array<std::uint32_t> order = morton_order(position, sorted->grid());
  return std::is_sorted(order.begin(), order.end());
}

constexpr std::uint64_t kMuch = std::uint64_t{1} << 32;
constexpr std::uint64_t kLittle = std::uint64_t{2} << 20;

TEST(CloudSort, TheOrderIsTheReadersAndTheBytesDoNotDependOnMemory) {
  const TemporaryFolder folder;
  for (const auto& [origin, doubles] :
       {std::pair{Vec3d(0, 0, 0), false}, {Vec3d(0, 0, 0), true}, {Vec3d(5e5, 4e6, 100), true}}) {
    const SurfelCloud cloud = make_points(100'000, origin, doubles);
    write_cloud(cloud, folder / "points.ply");
    sort_file(folder / "points.ply", folder / "memory.ply", {.memory = kMuch});
    sort_file(folder / "points.ply", folder / "disk.ply", {.memory = kLittle});
    EXPECT_TRUE(read_text(folder / "memory.ply") == read_text(folder / "disk.ply")) << origin.x();
    const SurfelCloud sorted = read_cloud(folder / "disk.ply");
    const SurfelCloud read = read_cloud(folder / "points.ply");
    const SurfelCloud expected = read.gathered(morton_order(read.position));
    ASSERT_EQ(sorted.size(), expected.size());
    EXPECT_EQ(sorted.origin, expected.origin);
    EXPECT_EQ(sorted.extra.front().data, expected.extra.front().data) << origin.x();
    EXPECT_EQ(sorted.variance, expected.variance);
    const Array<std::uint32_t> order = morton_order(sorted.position);
    for (std::uint32_t i = 0; i < order.size(); ++i) ASSERT_EQ(order[i], i);
  }
}

TEST(CloudSort, TheOrderIsTheReadersWhereStepsAreFinerThanFloats) {
  // Bounds are rounded with each piece of the file, all points lie where cells of the curve's grid
  // meet: the order is another one where the grid is not the reader's to the last bit.
  const TemporaryFolder folder;
  for (int shift = 1; shift <= 16; ++shift) {
    SurfelCloud cloud;
    LasStorage& las = cloud.las.emplace();
    las.scale = Vec3d::Constant(1e-7);
    las.offset = Vec3d(5000, 0, 5000);
    cloud.origin = las.offset + Vec3d::Constant(1e-7 * 12'347 * shift);
    const auto at = [&](int n) { return 0.032F * static_cast<float>(n - 64); };
    for (int i = 0; i <= 128; ++i) {
      for (int k = 0; k <= 128; ++k) cloud.position.emplace_back(at(i), at((i + k) % 16), at(k));
    }
    write_cloud(cloud, folder / "points.las");
    sort_file(folder / "points.las", folder / "sorted.ply", {.memory = kMuch});
    EXPECT_TRUE(in_readers_order(folder / "sorted.ply")) << shift;
  }
}

TEST(CloudSort, PartsTakePointsByTheirRoundedPlaces) {
  // Many points lie so near to a border of large cells that a float is on its other side.
  const TemporaryFolder folder;
  constexpr double kBorder = -1 + 2 * 1572864.0 / 0x1fffff;
  SurfelCloud cloud;
  LasStorage& las = cloud.las.emplace();
  las.scale = Vec3d::Constant(1e-9);
  cloud.origin = Vec3d(kBorder, 0, 0);
  cloud.position = {Vec3f(static_cast<float>(-1 - kBorder), -1, -1),
                    Vec3f(static_cast<float>(1 - kBorder), 1, 1)};
  for (std::size_t i = 0; i < 98'304; ++i) {
    const auto at = [&](int axis) { return static_cast<float>(random_uniform(5, i, axis)); };
    if (i < 49'152) {
      cloud.position.emplace_back(3e-8F * (at(0) - 0.5F), 0.01F * at(1), 0.01F * at(2));
    } else {
      cloud.position.emplace_back(at(0) - 1, 2 * at(1) - 1, 2 * at(2) - 1);
    }
  }
  write_cloud(cloud, folder / "points.las");
  sort_file(folder / "points.las", folder / "sorted.ply", {.memory = kLittle});
  EXPECT_TRUE(in_readers_order(folder / "sorted.ply"));
}

TEST(CloudSort, PointsAtOnePlaceKeepTheirOrder) {
  const TemporaryFolder folder;
  SurfelCloud cloud = make_points(1000, {0, 0, 0}, false);
  std::fill(cloud.position.begin(), cloud.position.end(), Vec3f(1, 2, 3));
  write_cloud(cloud, folder / "points.ply");
  sort_file(folder / "points.ply", folder / "sorted.ply", {.memory = kMuch});
  EXPECT_EQ(read_cloud(folder / "sorted.ply").variance, cloud.variance);
}

TEST(CloudSort, TooManyPointsAtOnePlaceAreRefused) {
  const TemporaryFolder folder;
  SurfelCloud cloud = make_points(200'000, {0, 0, 0}, false);
  std::fill(cloud.position.begin(), cloud.position.end(), Vec3f(1, 2, 3));
  write_cloud(cloud, folder / "points.ply");
  const std::string message = message_of(
      [&] { sort_file(folder / "points.ply", folder / "sorted.ply", {.memory = kLittle}); });
  EXPECT_NE(message.find("lie so near to each other"), std::string::npos) << message;
  EXPECT_FALSE(std::filesystem::exists(folder / "sorted.ply"));
  // Nothing is left beside it.
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder / ""), {}), 1);
}

TEST(CloudSort, OtherFormatsAreRefused) {
  const TemporaryFolder folder;
  const SurfelCloud cloud = make_points(10, {0, 0, 0}, false);
  write_cloud(cloud, folder / "points.ply");
  EXPECT_NE(message_of([&] {
              sort_file(folder / "points.ply", folder / "sorted.pcd", {.memory = kMuch});
            }).find("binary PLY"),
            std::string::npos);
}

TEST(CloudSort, GoesOnWhereAnEarlierRunStopped) {
  const TemporaryFolder folder;
  const SurfelCloud cloud = make_points(60'000, {0, 0, 0}, false);
  write_cloud(cloud, folder / "points.ply");
  sort_file(folder / "points.ply", folder / "right.ply", {.memory = kMuch});
  const SurfelCloud read = read_cloud(folder / "points.ply");
  const std::string to = folder / "sorted.ply";
  const CloudSortOptions options{
      .memory = std::uint64_t{1} << 20, .job = "sort", .kept_bytes = std::uint64_t{1} << 16};
  CloudSurvey survey(to);
  survey.add(read);
  PositionSample sample;
  sample.add(read);
  constexpr std::size_t kPiece = 1000;
  const auto append = [&](SortedCloudWriter& writer, std::size_t begin, std::size_t end) {
    for (std::size_t at = begin; at < end; at += kPiece) {
      Array<std::uint32_t> some(kPiece);
      std::iota(some.begin(), some.end(), static_cast<std::uint32_t>(at));
      writer.append(read.gathered(some));
    }
  };
  {
    SortedCloudWriter writer(to, survey, sample, read, options);
    append(writer, 0, 30'000);
  }
  std::uint64_t kept = 0;
  {
    SortedCloudWriter writer(to, survey, sample, read, options);
    kept = writer.kept();
    EXPECT_GT(kept, 20'000U);
    EXPECT_LE(kept, 30'000U);
    append(writer, 0, 50'000);
  }
  {
    // A scratch file that was lost means to begin anew.
    const std::string scratch = to + ".unfinished-scratch";
    const std::string bytes = read_text(scratch);
    write_text(scratch, bytes.substr(0, bytes.size() / 2));
    EXPECT_EQ(SortedCloudWriter(to, survey, sample, read, options).kept(), 0U);
  }
  {
    SortedCloudWriter writer(to, survey, sample, read, options);
    append(writer, 0, 60'000);
  }
  // Bytes that were changed are noticed.
  {
    const std::string scratch = to + ".unfinished-scratch";
    const std::string bytes = read_text(scratch);
    std::string damaged = bytes;
    damaged[damaged.size() / 2] ^= 1;
    write_text(scratch, damaged);
    SortedCloudWriter writer(to, survey, sample, read, options);
    append(writer, 0, 60'000);
    EXPECT_NE(message_of([&] { writer.commit(); }).find("is damaged"), std::string::npos);
    write_text(scratch, bytes);
  }
  SortedCloudWriter writer(to, survey, sample, read, options);
  EXPECT_GT(writer.kept(), kept);
  append(writer, 0, 60'000);
  writer.commit();
  EXPECT_TRUE(read_text(to) == read_text(folder / "right.ply"));
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder / ""), {}), 3);
}

TEST(CloudSort, SampleOfPositionsIsBounded) {
  PositionSample sample;
  SurfelCloud piece;
  piece.position.resize(100'000, Vec3f(1, 2, 3));
  for (int i = 0; i < 40; ++i) sample.add(piece);
  EXPECT_LE(sample.positions().size(), std::size_t{1} << 20);
  EXPECT_GE(sample.positions().size(), std::size_t{1} << 19);
}

}  // namespace
}  // namespace surfel::test
