#include <cstring>
#include <fstream>
#include <sstream>

#include <gtest/gtest.h>
#include <surfel/base/color.h>
#include <surfel/base/error.h>
#include <surfel/base/random.h>
#include <surfel/io/cloud_io.h>

#include "support/las_points.h"
#include "support/message_of.h"
#include "support/run_tool.h"

namespace surfel::test {
namespace {

constexpr std::size_t kLargeCount = 600000;  // More than two pieces.

SurfelCloud large_cloud() {
  SurfelCloud cloud;
  cloud.origin = Vec3d(455000, 5401000, 200);
  ExtraProperty& classes =
      cloud.extra.emplace_back(ExtraProperty{"classification", ScalarType::kUint8, {}});
  for (std::size_t i = 0; i < kLargeCount; ++i) {
    const auto random = [&](int d) { return static_cast<float>(random_uniform(5, i, d)); };
    cloud.position.emplace_back(static_cast<float>(i) * 0.01F, 100 * random(0), 10 * random(1));
    cloud.color.push_back(Vec3f::Constant(srgb8_to_linear(static_cast<std::uint8_t>(i % 251))));
    classes.data.push_back(static_cast<std::byte>(i % 18));
  }
  return cloud;
}

std::string bytes_of(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::stringstream bytes;
  bytes << in.rdbuf();
  return bytes.str();
}

/// What a reader hands on, joined in the order of the pieces.
struct Pieces {
  std::vector<Vec3d> world;
  std::vector<Vec3f> color;
  std::vector<std::byte> classification;
  std::size_t count = 0;

  explicit Pieces(const CloudReader& reader) {
    reader.for_each([&](const SurfelCloud& piece) {
      for (std::size_t i = 0; i < piece.size(); ++i) world.push_back(piece.world(i));
      color.insert(color.end(), piece.color.begin(), piece.color.end());
      for (const ExtraProperty& property : piece.extra) {
        if (property.name != "classification") continue;
        classification.insert(classification.end(), property.data.begin(), property.data.end());
      }
      ++count;
    });
  }
};

TEST(CloudReader, PiecesAreTheCloudInOrder) {
  const SurfelCloud cloud = large_cloud();
  const TemporaryFolder folder;
  for (const char* const name : {"a.ply", "a.pcd", "a.las", "a.laz", "a.csv"}) {
    const std::string file = folder / name;
    write_cloud(cloud, file);
    const SurfelCloud whole = read_cloud(file);
    const CloudReader reader(file);
    const Pieces first(reader);
    const Pieces pieces(reader);
    EXPECT_GT(pieces.count, 1U) << name;
    EXPECT_EQ(first.world, pieces.world) << name;
    ASSERT_EQ(pieces.world.size(), kLargeCount) << name;
    double error = 0;
    for (std::size_t i = 0; i < kLargeCount; ++i) {
      error = std::max(error, (pieces.world[i] - whole.world(i)).norm());
    }
    // An offset of up to 6000 units is a float.
    EXPECT_LT(error, 1e-3) << name;
    EXPECT_TRUE(std::equal(pieces.color.begin(), pieces.color.end(), whole.color.begin(),
                           whole.color.end()))
        << name;
    if (name == std::string("a.csv")) continue;  // Text has columns of floats.
    EXPECT_TRUE(std::equal(pieces.classification.begin(), pieces.classification.end(),
                           cloud.extra[0].data.begin()))
        << name;
  }
}

TEST(CloudReader, PartsAreThoseOfReadCloud) {
  const TemporaryFolder folder;
  const std::string file = folder / "a.ply";
  write_cloud(large_cloud(), file);
  Bounds box;
  box.add(Vec3d(456000, 5401000, 200));
  box.add(Vec3d(460000, 5401050, 205));
  const CloudReadOptions options{.bounds = box, .every = 7};
  const SurfelCloud whole = read_cloud(file, options);
  const Pieces pieces(CloudReader(file, options));
  EXPECT_GT(pieces.count, 1U);
  ASSERT_EQ(pieces.world.size(), whole.size());
  EXPECT_TRUE(std::equal(pieces.color.begin(), pieces.color.end(), whole.color.begin()));

  box.min.x() = 1e6;
  box.max.x() = 2e6;
  const std::string message =
      message_of([&] { Pieces(CloudReader(file, {.bounds = box, .every = 7})); });
  EXPECT_NE(message.find("holds no points within"), std::string::npos) << message;
}

TEST(CloudReader, PiecesOfWideFilesKeepTheirSteps) {
  // Blocks of points in turn 2000 km apart, in millimetres: together they need more than a float.
  laz::PointLayout layout{.format = 0, .bytes = 20};
  LasFileMaker maker{.layout = layout, .points = {}, .extra_descriptions = {}, .copc = {}};
  constexpr std::size_t kPoints = 70000;
  maker.points.resize(kPoints * layout.bytes);
  std::vector<std::int32_t> steps(kPoints);
  for (std::size_t i = 0; i < kPoints; ++i) {
    steps[i] = static_cast<std::int32_t>(i / 8192 % 2 * 2000000000 + i % 8192 * 7);
    std::memcpy(maker.points.data() + i * layout.bytes, &steps[i], sizeof(steps[i]));
  }
  maker.scale = 0.001;
  maker.offset = 0;
  const TemporaryFolder folder;
  std::ofstream(folder / "wide.las", std::ios::binary) << maker.las();
  const Pieces pieces(CloudReader(folder / "wide.las"));
  ASSERT_EQ(pieces.world.size(), kPoints);
  for (std::size_t i = 0; i < kPoints; ++i) {
    ASSERT_EQ(std::llround(pieces.world[i].x() * 1000), steps[i]) << i;
  }
}

TEST(CloudWriter, PiecesMakeTheSameFile) {
  const SurfelCloud cloud = large_cloud();
  const TemporaryFolder folder;
  for (const char* const name : {"a.ply", "a.pcd", "a.las", "a.laz", "a.csv", "a.obj"}) {
    const std::string whole = folder / (std::string("whole-") + name);
    write_cloud(cloud, whole);
    CloudSurvey survey(name);
    std::vector<SurfelCloud> pieces;
    for (std::size_t begin = 0; begin < kLargeCount;) {
      const std::size_t end = std::min(kLargeCount, begin + 70001 + begin / 3);
      Array<std::uint32_t> order;
      for (std::size_t i = begin; i < end; ++i) order.push_back(static_cast<std::uint32_t>(i));
      pieces.push_back(cloud.gathered(order));
      survey.add(pieces.back());
      begin = end;
    }
    ASSERT_GT(pieces.size(), 3U);
    CloudWriter writer(folder / name, survey);
    for (SurfelCloud& piece : pieces) {
      survey.settle(piece);
      writer.append(piece);
    }
    writer.commit();
    EXPECT_EQ(bytes_of(folder / name) == bytes_of(whole), true) << name;
  }
}

TEST(CloudWriter, FewerSurfelsThanPromisedLeaveNoFile) {
  const TemporaryFolder folder;
  SurfelCloud cloud;
  cloud.position = {Vec3f(1, 2, 3), Vec3f(4, 5, 6)};
  for (const char* const name : {"a.ply", "a.laz", "a.xyz"}) {
    CloudSurvey survey(name);
    survey.add(cloud);
    survey.add(cloud);
    {
      CloudWriter writer(folder / name, survey);
      writer.append(cloud);
      EXPECT_THROW(writer.commit(), Error) << name;
    }
    EXPECT_TRUE(bytes_of(folder / name).empty()) << name;
  }
}

}  // namespace
}  // namespace surfel::test
