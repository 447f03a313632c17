// LAZ beside other programs: what we write is read by laz-perf, and we read what LASzip wrote.

#include <array>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <random>
#include <span>
#include <utility>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <surfel/base/color.h>

#include "io/cloud_of_bytes.h"
#include "support/cases.h"
#include "support/las_points.h"
#include "support/run_tool.h"

namespace surfel::test {
namespace {

using laz::PointLayout;

/// Whole numbers from 0 to `most` - 1.
class Draw {
 public:
  explicit Draw(unsigned seed) : state_(seed) {}
  unsigned operator()(unsigned most) { return static_cast<unsigned>(state_() % most); }

 private:
  std::mt19937 state_;
};

/// A file with points of several scanner channels.
struct ChannelFile {
  std::string what;
  LasFileMaker maker;
  std::vector<std::uint32_t> chunks;  ///< As laz_of() takes them.
};

/// Sets the scanner channels of points of formats from 6 on: another one comes after about `stay`
/// points.
void set_channels(LasFileMaker& maker, unsigned stay, Draw& draw) {
  unsigned channel = draw(4);
  for (std::size_t i = 0; i < maker.count(); ++i) {
    if (i > 0 && draw(stay) == 0) channel = (channel + 1 + draw(3)) % 4;
    std::byte& flags = maker.points[i * maker.layout.bytes + 15];
    flags = (flags & std::byte{0xCF}) | static_cast<std::byte>(channel << 4);
  }
}

/// Files of a point format, with points and chunks of many kinds.
std::vector<ChannelFile> channel_files(int format, int count) {
  Draw draw(static_cast<unsigned>(format));
  std::vector<ChannelFile> files;
  for (int k = 0; k < count; ++k) {
    const auto kind = static_cast<PointKind>(draw(3));
    const std::size_t extra = draw(3) == 0 ? 0 : draw(7);
    const unsigned stay = 1 + draw(2) * draw(40);
    const std::size_t points = 1 + draw(draw(4) == 0 ? 3 : 400);
    ChannelFile file;
    file.what =
        fmt::format("format {}, case {}: {} points of kind {}, {} extra bytes, {} of a channel",
                    format, k, points, static_cast<int>(kind), extra, stay);
    file.maker.layout = layout_of(format, extra);
    file.maker.points = made_points(file.maker.layout, points, kind, draw(1000));
    if (file.maker.layout.layered()) set_channels(file.maker, stay, draw);
    if (draw(2) == 0) {
      file.chunks = {20 + draw(130)};
    } else {
      for (std::size_t sum = 0; sum < points; sum += file.chunks.back()) {
        file.chunks.push_back(1 + draw(draw(2) == 0 ? 3 : 200));
      }
      file.chunks.push_back(1);
    }
    files.push_back(std::move(file));
  }
  return files;
}

/// Reads LAZ files by laz-perf of npm, which leaves the points of each in FILE.points.
RunResult run_laz_perf(const Words& files) {
  const auto modules = std::filesystem::path(SURFEL_TOOL_DIR).parent_path() / "tests/npm";
  Words command = {"sh", SURFEL_SOURCE_DIR "/tests/laz/npm/read_laz.sh", modules};
  command.insert(command.end(), files.begin(), files.end());
  return run(command);
}

constexpr int kNoLazPerf = 77;

TEST(LazPeers, LazPerfReadsWhatWeWriteOfEveryFormat) {
  const TemporaryFolder folder;
  std::vector<ChannelFile> files;
  Words paths;
  for (const int format : {0, 1, 2, 3, 6, 7, 8}) {
    for (ChannelFile& file : channel_files(format, cases(8))) {
      paths.push_back(folder / fmt::format("{}.laz", files.size()));
      write_text(paths.back(), laz_of(file.maker, file.chunks));
      files.push_back(std::move(file));
    }
  }
  const RunResult result = run_laz_perf(paths);
  SURFEL_REQUIRE(result.exit_code != kNoLazPerf, "no laz-perf: " + result.errors);
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  for (std::size_t i = 0; i < files.size(); ++i) {
    const std::vector<std::byte>& points = files[i].maker.points;
    const std::string_view truth(reinterpret_cast<const char*>(points.data()), points.size());
    EXPECT_TRUE(read_text(paths[i] + ".points") == truth) << files[i].what;
  }
}

TEST(LazPeers, LazPerfReadsTheFilesOfClouds) {
  const TemporaryFolder folder;
  Words paths;
  for (int format = 0; format <= 10; ++format) {
    const ChannelFile file = channel_files(format, 1).front();
    const SurfelCloud cloud = cloud_of(file.maker.las());
    paths.push_back(folder / fmt::format("{}.laz", format));
    write_cloud(cloud, paths.back());
    write_cloud(cloud, paths.back() + ".las");
  }
  const RunResult result = run_laz_perf(paths);
  SURFEL_REQUIRE(result.exit_code != kNoLazPerf, "no laz-perf: " + result.errors);
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  for (const std::string& path : paths) {
    EXPECT_TRUE(read_text(path + ".points") == points_in(read_text(path + ".las"))) << path;
  }
}

TEST(LazPeers, ChannelsOfEveryFormatReadBack) {
  for (int format = 0; format <= 10; ++format) {
    for (const ChannelFile& file : channel_files(format, cases(6))) {
      expect_same(cloud_of(laz_of(file.maker, file.chunks)), cloud_of(file.maker.las()), file.what);
    }
  }
}

/// A file of the real data whose points have several scanner channels.
std::string channel_case(const std::string& name) {
  return read_text((data_folder() / "cases" / name).string());
}

TEST(LazPeers, ChannelsOfOtherProgramsAreReadAsTheirTwins) {
  SURFEL_REQUIRE_TEST_DATA();
  const std::pair<const char*, const char*> twins[] = {{"min_one.laz", "min_one.las"},
                                                       {"min2.laz", "min2.las"},
                                                       {"chan_rgb_laszip.laz", "chan_rgb.las"}};
  for (const auto& [laz, las] : twins) {
    expect_same(cloud_of(channel_case(laz)), cloud_of(channel_case(las)), laz);
  }
  constexpr std::array<std::uint16_t, 3> kColor{7000, 100, 60};
  const Vec3f color = cloud_of(channel_case("min_one.laz")).color.at(6);
  for (Eigen::Index k = 0; k < 3; ++k) {
    EXPECT_EQ(color[k], srgb16_to_linear(kColor[static_cast<std::size_t>(k)]));
  }
}

TEST(LazPeers, LazPerfReadsChannelsThatWeCompress) {
  SURFEL_REQUIRE_TEST_DATA();
  const TemporaryFolder folder;
  const std::string las = channel_case("chan_rgb.las");
  write_cloud(cloud_of(las), folder / "a.laz");
  const RunResult result = run_laz_perf({folder / "a.laz"});
  SURFEL_REQUIRE(result.exit_code != kNoLazPerf, "no laz-perf: " + result.errors);
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  EXPECT_TRUE(read_text(folder / "a.laz.points") == points_in(las));
}

/// What is between the header of a LAZ file and its table of chunks.
std::string chunks_in(const std::string& laz) {
  std::uint32_t begin = 0;
  std::memcpy(&begin, laz.data() + 96, sizeof(begin));
  std::uint64_t end = 0;
  std::memcpy(&end, laz.data() + begin, sizeof(end));
  return laz.substr(begin + 8, end - begin - 8);
}

/// laszip/ has points of two extra bytes in chunks of 24, compressed by LASzip 3.5.1, and the same
/// points as LAS.
void expect_chunks_of_laszip(PointLayout layout, const std::string& name) {
  const std::string folder = SURFEL_SOURCE_DIR "/tests/laz/laszip/";
  const std::string laz = read_text(folder + name);
  const std::string las = read_text(folder + fmt::format("format{}.las", layout.format));
  const std::string points = points_in(las);
  ASSERT_EQ(points.size(), 120 * layout.bytes) << name;
  expect_same(cloud_of(laz), cloud_of(las), name);
  LasFileMaker maker;
  maker.layout = layout;
  const auto bytes = std::as_bytes(std::span(points));
  maker.points.assign(bytes.begin(), bytes.end());
  EXPECT_TRUE(chunks_in(laz_of(maker, {24})) == chunks_in(laz)) << name;
}

TEST(LazPeers, ChunksAreThoseOfLaszip) {
  for (int format = 5; format <= 10; ++format) {
    expect_chunks_of_laszip(layout_of(format, 2), fmt::format("format{}.laz", format));
  }
  PointLayout newer = layout_of(10, 2);
  newer.layered_version = 4;
  expect_chunks_of_laszip(newer, "format10_v4.laz");
}

}  // namespace
}  // namespace surfel::test
