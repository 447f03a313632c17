#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <fstream>
#include <functional>
#include <map>
#include <sstream>

#include <gtest/gtest.h>
#include <surfel/base/color.h>
#include <surfel/base/parallel.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/coordinate_file.h>
#include <surfel/io/file_kind.h>
#include <surfel/io/las_header.h>
#include <surfel/io/laz_points.h>
#include <surfel/laz/chunk_table.h>

#include "io/cloud_of_bytes.h"
#include "support/las_points.h"
#include "support/memory_file.h"
#include "support/message_of.h"
#include "support/test_data.h"

namespace surfel::test {
namespace {

using laz::PointLayout;

LasFileMaker maker_of(const PointLayout& layout, std::size_t count,
                      PointKind kind = PointKind::kScan) {
  return {.layout = layout,
          .points = made_points(layout, count, kind),
          .extra_descriptions = {},
          .copc = {}};
}

std::string bytes_in(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::stringstream bytes;
  bytes << in.rdbuf();
  return bytes.str();
}

TEST(Las, FieldsOfEveryPointFormat) {
  for (int format = 0; format <= 10; ++format) {
    const LasFileMaker maker = maker_of(layout_of(format), 500);
    const SurfelCloud cloud = cloud_of(maker.las());
    ASSERT_EQ(cloud.size(), 500U);
    std::map<std::string, std::vector<double>> values;
    for (const ExtraProperty& p : cloud.extra) values[p.name] = values_of(cloud, p.name);
    const bool extended = format >= 6;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      const std::byte* point = maker.points.data() + i * maker.layout.bytes;
      const auto number = [&]<class T>(std::size_t at, T) {
        return static_cast<double>(load_scalar<T, false>(point + at));
      };
      const auto bits = [&](std::size_t at, unsigned shift, unsigned mask) {
        return static_cast<double>(std::to_integer<unsigned>(point[at]) >> shift & mask);
      };
      for (int axis = 0; axis < 3; ++axis) {
        EXPECT_EQ(std::round((cloud.world(i)[axis] - 1000) / 0.01),
                  number(static_cast<std::size_t>(4 * axis), std::int32_t{}));
      }
      EXPECT_EQ(values["intensity"][i], number(12, std::uint16_t{}));
      EXPECT_EQ(values["return_number"][i], bits(14, 0, extended ? 15 : 7));
      EXPECT_EQ(values["number_of_returns"][i], bits(14, extended ? 4 : 3, extended ? 15 : 7));
      EXPECT_EQ(values["scan_direction_flag"][i], bits(extended ? 15 : 14, 6, 1));
      EXPECT_EQ(values["classification"][i], extended ? bits(16, 0, 255) : bits(15, 0, 31));
      EXPECT_EQ(values["user_data"][i], bits(17, 0, 255));
      EXPECT_EQ(values["point_source_id"][i], number(extended ? 20 : 18, std::uint16_t{}));
      if (extended) {
        EXPECT_EQ(values["scan_angle"][i], number(18, std::int16_t{}));
        EXPECT_EQ(values["scanner_channel"][i], bits(15, 4, 3));
      } else {
        EXPECT_EQ(values["scan_angle_rank"][i], number(16, std::int8_t{}));
        EXPECT_EQ(values["withheld"][i], bits(15, 7, 1));
      }
      if (maker.layout.timed()) {
        EXPECT_EQ(values["gps_time"][i], number(extended ? 22 : 20, double{}));
      }
      std::size_t at = maker.layout.base();
      if (maker.layout.colored()) {
        EXPECT_EQ(cloud.color.at(i)[1],
                  srgb16_to_linear(load_scalar<std::uint16_t, false>(point + at + 2)));
        at += 6;
      }
      if (maker.layout.infrared()) {
        EXPECT_EQ(values["nir"][i], number(at, std::uint16_t{}));
        at += 2;
      }
      if (maker.layout.waves()) {
        EXPECT_EQ(values["wave_packet_index"][i], bits(at, 0, 255));
        EXPECT_EQ(values["wave_packet_offset"][i], number(at + 1, std::uint64_t{}));
        EXPECT_EQ(values["wave_packet_size"][i], 128);
        EXPECT_EQ(values["wave_z"][i], number(at + 25, float{}));
      }
    }
    EXPECT_EQ(cloud.color.empty(), !maker.layout.colored());
    EXPECT_EQ(cloud.up, Vec3d::UnitZ());
  }
}

TEST(Las, LazOfEveryPointFormatHoldsWhatLasHolds) {
  for (int format = 0; format <= 10; ++format) {
    for (const std::size_t extra : {0, 3}) {
      const LasFileMaker maker = maker_of(layout_of(format, extra), 700);
      const SurfelCloud truth = cloud_of(maker.las());
      const std::string what = "format " + std::to_string(format);
      expect_same(cloud_of(laz_of(maker, {100})), truth, what);
      expect_same(cloud_of(laz_of(maker, {350})), truth, what + ", whole chunks");
      expect_same(cloud_of(laz_of(maker, {300, 1, 200, 1000})), truth, what + ", own numbers");
      expect_same(cloud_of(laz_of(maker, {100}, TableAt::kAtTheEnd)), truth, what + ", table last");
      expect_same(cloud_of(laz_of(maker, {1, 699, 1}, TableAt::kAtTheEnd)), truth, what);
    }
  }
}

TEST(Las, FilesOfOtherProgramsHoldWhatTheirTwinsHold) {
  SURFEL_REQUIRE_TEST_DATA();
  const auto data = data_folder();
  for (const auto& [laz, las] : std::vector<std::pair<std::string, std::string>>{
           {"point10.las.laz", "formats/laz/point10.las"},
           {"point-time.las.laz", "formats/laz/point-time.las"},
           {"point-time-1.4.las.laz", "formats/laz/point-time.las"},
           {"point-color.las.laz", "formats/laz/point-color.las"},
           {"point-color-time.las.laz", "formats/laz/point-color-time.las"},
           {"point10-1.0.laz", "formats/laz/point10-1.0.las"},
           {"point10-1.1.laz", "formats/laz/point10-1.1.las"},
           {"extrabytes.laz", "formats/laz/extrabytes.las"},
           {"simple.laz", "lidar/1.2-with-color.las"}}) {
    expect_same(read_cloud(data / "formats/laz" / laz), read_cloud(data / las), laz);
  }
}

TEST(Las, WrittenAgainWithTheSameIntegers) {
  const TemporaryFolder folder;
  for (const int format : {0, 1, 2, 3, 6, 7, 8}) {
    LasFileMaker maker = maker_of(layout_of(format), 900);
    maker.minor = format >= 6 ? 4 : 2;
    const std::string las = maker.las();
    const SurfelCloud cloud = cloud_of(las);
    for (const char* name : {"a.las", "a.ply", "a.laz"}) write_cloud(cloud, folder / name);
    const std::string written = bytes_in(folder / "a.las");
    ASSERT_EQ(points_in(written), points_in(las)) << "format " << format;
    EXPECT_EQ(written.substr(104, 3), las.substr(104, 3));
    EXPECT_EQ(written.substr(131, 48), las.substr(131, 48)) << "scale and offset";
    for (const char* from : {"a.ply", "a.laz"}) {
      write_cloud(read_cloud(folder / from), folder / "b.las");
      EXPECT_EQ(points_in(bytes_in(folder / "b.las")), points_in(las)) << from << " " << format;
    }
    LasHeader header{InputFile(folder / "a.las")};
    EXPECT_NEAR((header.bounds.max - cloud.bounds().max).norm(), 0, 1e-4);
  }
}

TEST(Las, TheSameBytesForAnyNumberOfThreads) {
  const TemporaryFolder folder;
  const SurfelCloud cloud = cloud_of(maker_of(layout_of(7, 2), 120000).las());
  for (const char* name : {"a.las", "a.laz"}) {
    std::string first;
    for (const int threads : {1, 5}) {
      set_thread_count(threads);
      write_cloud(cloud, folder / name);
      const SurfelCloud read = read_cloud(folder / name);
      expect_same(read, cloud, name);
      if (threads == 1) first = bytes_in(folder / name);
    }
    set_thread_count(0);
    EXPECT_TRUE(bytes_in(folder / name) == first) << name;
  }
}

TEST(Las, ColorsAreEightBitUnlessOneIsLarger) {
  LasFileMaker maker = maker_of(layout_of(2), 20000);
  const auto set_all = [&](std::uint16_t value) {
    for (std::size_t i = 0; i < maker.count(); ++i) {
      for (std::size_t k = 0; k < 3; ++k) {
        std::memcpy(maker.points.data() + i * maker.layout.bytes + 20 + 2 * k, &value, 2);
      }
    }
  };
  set_all(0);
  EXPECT_TRUE(cloud_of(maker.las()).color.empty());
  for (const int value : {1, 128, 255}) {
    set_all(static_cast<std::uint16_t>(value));
    const SurfelCloud cloud = cloud_of(maker.las());
    EXPECT_EQ(cloud.color_encoding, ColorEncoding::kUint8Srgb);
    EXPECT_EQ(cloud.color.at(19999),
              Vec3f::Constant(srgb8_to_linear(static_cast<std::uint8_t>(value))));
  }
  // One value decides, wherever it stands.
  const std::uint16_t bright = 256;
  std::memcpy(maker.points.data() + 19000 * maker.layout.bytes + 24, &bright, 2);
  const SurfelCloud wide = cloud_of(maker.las());
  EXPECT_EQ(wide.color_encoding, ColorEncoding::kUint16Srgb);
  EXPECT_EQ(wide.color.at(0), Vec3f::Constant(srgb16_to_linear(255)));
  EXPECT_EQ(wide.color.at(19000)[2], srgb16_to_linear(256));
}

/// The description of some extra bytes.
std::string description(int type, int options, const std::string& name, double scale = 0,
                        double offset = 0) {
  std::string text(192, '\0');
  text[2] = static_cast<char>(type);
  text[3] = static_cast<char>(options);
  std::memcpy(text.data() + 4, name.data(), name.size());
  for (std::size_t k = 0; k < 3; ++k) {
    LasFileMaker::put(text, 112 + 8 * k, scale);
    LasFileMaker::put(text, 136 + 8 * k, offset);
  }
  return text;
}

TEST(Las, ExtraBytesAreColumnsUnderTheirNames) {
  LasFileMaker maker = maker_of(layout_of(0, 2 + 4 + 8 + 3 + 2), 50);
  maker.extra_descriptions = description(3, 24, "Pulse width", 0.1, 5) +
                             description(9, 0, "ratio") + description(8, 0, "intensity") +
                             description(21, 0, "rgb");
  for (std::size_t i = 0; i < maker.count(); ++i) {
    std::byte* extra = maker.points.data() + i * maker.layout.bytes + 20;
    const auto width = static_cast<std::uint16_t>(i);
    const float ratio = 0.5F * static_cast<float>(i);
    const std::int64_t wide = -static_cast<std::int64_t>(i) * 10000000000;
    std::memcpy(extra, &width, 2);
    std::memcpy(extra + 2, &ratio, 4);
    std::memcpy(extra + 6, &wide, 8);
    for (std::size_t k = 0; k < 5; ++k) extra[14 + k] = static_cast<std::byte>(i + k);
  }
  const SurfelCloud cloud = cloud_of(maker.las());
  EXPECT_DOUBLE_EQ(values_of(cloud, "Pulse_width")[7], 7 * 0.1 + 5);
  EXPECT_EQ(values_of(cloud, "ratio")[7], 3.5);
  // The format has a field of that name.
  EXPECT_EQ(values_of(cloud, "intensity_2")[7], -7e10);
  EXPECT_EQ(values_of(cloud, "rgb_2")[7], 9);
  EXPECT_EQ(values_of(cloud, "extra_1")[7], 11) << "bytes that nothing describes";

  const TemporaryFolder folder;
  write_cloud(cloud, folder / "again.laz");
  expect_same(read_cloud(folder / "again.laz"), cloud, "extra bytes written again");
}

TEST(Las, SurfelsReadBackWithAllTheirColumns) {
  SurfelCloud cloud;
  for (int i = 0; i < 1000; ++i) {
    const float t = 0.01F * static_cast<float>(i);
    cloud.position.emplace_back(std::cos(t), std::sin(t), t);
    cloud.normal.emplace_back(std::cos(t), std::sin(t), 0.0F);
    cloud.variance.push_back(0.25F * t * t);
    cloud.color.push_back(Vec3f::Constant(srgb8_to_linear(static_cast<std::uint8_t>(i % 256))));
    cloud.group.push_back(static_cast<std::uint16_t>(i % 7));
  }
  ExtraProperty& intensity =
      cloud.extra.emplace_back(ExtraProperty{"intensity", ScalarType::kFloat32, {}});
  for (int i = 0; i < 1000; ++i) {
    const float value = 0.001F * static_cast<float>(i);
    const auto* bytes = reinterpret_cast<const std::byte*>(&value);
    intensity.data.insert(intensity.data.end(), bytes, bytes + sizeof(value));
  }
  cloud.provenance = {"made by a test"};
  const TemporaryFolder folder;
  write_cloud(cloud, folder / "surfels.laz");
  const SurfelCloud read = read_cloud(folder / "surfels.laz");
  EXPECT_EQ(read.normal, cloud.normal);
  EXPECT_EQ(read.variance, cloud.variance);
  EXPECT_EQ(read.group, cloud.group);
  EXPECT_EQ(read.provenance, cloud.provenance);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    EXPECT_LT((read.world(i) - cloud.world(i)).norm(), 1e-6);
    EXPECT_LT((read.color[i] - cloud.color[i]).norm(), 1e-6);
  }
  EXPECT_EQ(values_of(read, "intensity")[10], 655) << "0.01 times 65535";

  cloud.position[3].x() = std::numeric_limits<float>::quiet_NaN();
  const std::string message = message_of([&] { write_cloud(cloud, folder / "nan.las"); });
  EXPECT_NE(message.find("surfel 3 has a position that is not finite"), std::string::npos)
      << message;
  EXPECT_FALSE(std::filesystem::exists(folder / "nan.las"));
}

TEST(Las, MillimetresStayInWholeCountries) {
  LasFileMaker maker = maker_of(layout_of(0), 2);
  maker.scale = 0.001;
  maker.offset = 5e6;
  // 30 km from one another, as far as steps of a millimetre are told.
  for (const std::int32_t x : {0, 30000001}) {
    std::memcpy(maker.points.data() + (x > 0 ? maker.layout.bytes : 0), &x, sizeof(x));
  }
  const SurfelCloud cloud = cloud_of(maker.las());
  EXPECT_EQ(std::round((cloud.world(1).x() - 5e6) * 1000), 30000001);
  EXPECT_EQ(std::round((cloud.world(0).x() - 5e6) * 1000), 0);
}

TEST(Las, HeadersAreCheckedAgainstTheFile) {
  const LasFileMaker maker = maker_of(layout_of(3), 10);
  const std::string good = maker.las();
  const auto changed = [&](std::size_t at, auto value) {
    std::string bytes = good;
    LasFileMaker::put(bytes, at, value);
    return error_of(bytes);
  };
  EXPECT_EQ(error_of(good), "no error");
  EXPECT_EQ(error_of(good.substr(0, 200)), "is cut off within the LAS header");
  EXPECT_EQ(changed(25, '\5'), "is LAS 1.5; 1.0 to 1.4 are supported");
  EXPECT_EQ(changed(104, '\13'), "has points of format 11; 0 to 10 are supported");
  EXPECT_EQ(changed(105, std::uint16_t{33}),
            "has points of 33 bytes, and format 3 takes 34; the header is wrong");
  EXPECT_EQ(changed(94, std::uint16_t{40}),
            "says that its LAS header has 40 bytes; the file is damaged");
  EXPECT_EQ(changed(96, std::uint32_t{100000}),
            "has its points at byte 100000 of 715; the file is truncated or its header is wrong");
  EXPECT_EQ(
      changed(100, std::uint32_t{1}),
      "the header promises 1 blocks before the points, the file has room for 0 at most; it is "
      "truncated or its header is wrong");
  EXPECT_EQ(changed(243, std::uint32_t{5}),
            "the header promises 5 blocks behind the points, and block 1 is not whole; the file is "
            "truncated or its header is wrong");
  EXPECT_EQ(changed(131, 0.0), "has a scale that is zero or not finite; the header is wrong");
  EXPECT_EQ(
      changed(247, std::uint64_t{11}),
      "the header promises 11 points, the file has room for 10 at most; it is truncated or its "
      "header is wrong");
  EXPECT_EQ(changed(104, '\203'), "has compressed points and does not say how; it is damaged");
  EXPECT_EQ(error_of(maker_of(layout_of(3), 0).las()), "holds no points");
}

TEST(Las, DamagedLazIsRefused) {
  const LasFileMaker maker = maker_of(layout_of(7), 1000);
  const std::string good = laz_of(maker, {400});
  const std::size_t begin = maker.file("", true, laszip_block(maker.layout, 400)).size();
  const auto changed = [&](std::size_t at, auto value) {
    std::string bytes = good;
    LasFileMaker::put(bytes, at, value);
    return error_of(bytes);
  };
  EXPECT_EQ(error_of(good), "no error");
  EXPECT_EQ(changed(begin, std::uint64_t{5}),
            "has no table of its chunks of compressed points; the file is truncated or damaged");
  EXPECT_NE(error_of(good.substr(0, good.size() - 8)).find("table of chunks"), std::string::npos);
  EXPECT_NE(error_of(good.substr(0, begin + 500)).find("table of its chunks"), std::string::npos);
  EXPECT_EQ(
      changed(247, std::uint64_t{1200000}),
      "its table of chunks of compressed points has 1200 points, the header 1200000; the file "
      "is truncated or damaged");
  // The number of points that stands in the first chunk.
  EXPECT_EQ(changed(begin + 8 + maker.layout.bytes, std::uint32_t{399}),
            "the compressed points 0 to 399 are damaged; get the file anew");
  EXPECT_NE(changed(begin - 12, std::uint16_t{9}).find("another way than LASzip"),
            std::string::npos);
  EXPECT_EQ(error_of(laz_of(maker_of(layout_of(0), 0), {50000})), "holds no points");
}

/// A COPC file whose cube is 1024 units wide; every node has points within its own cell.
class CopcMaker {
 public:
  struct Node {
    std::int32_t level;
    std::array<std::int32_t, 3> place;
    std::size_t points;
    bool in_page;  ///< Told by a page of its own instead of the first one.
  };

  explicit CopcMaker(const std::vector<Node>& nodes) : nodes_(nodes) {
    maker_.layout = layout_of(7);
    maker_.scale = 1;
    maker_.offset = 0;
    maker_.copc.resize(160);
    for (const Node& node : nodes) {
      std::vector<std::byte> points = made_points(maker_.layout, node.points, PointKind::kScan);
      const std::int32_t side = 1024 >> node.level;
      for (std::size_t i = 0; i < node.points; ++i) {
        for (std::size_t k = 0; k < 3; ++k) {
          const std::int32_t x =
              node.place[k] * side + static_cast<std::int32_t>((i * (37 + k)) % (side - 2)) + 1;
          std::memcpy(points.data() + i * maker_.layout.bytes + 4 * k, &x, sizeof(x));
        }
      }
      maker_.points.insert(maker_.points.end(), points.begin(), points.end());
    }
  }

  /// \param change  may change an entry of the tree: entries of the first page, then entries of the
  /// others
  std::string file(const std::function<void(std::size_t, std::string&)>& change = {}) {
    const std::string laszip = laszip_block(maker_.layout, ~std::uint32_t{0});
    const std::size_t begin = maker_.file("", true, laszip).size();
    std::string tail(8, '\0');
    std::vector<laz::ChunkSize> sizes;
    std::vector<std::string> entries;
    std::size_t first = 0;
    for (const Node& node : nodes_) {
      const auto chunk = laz::encode_chunk(
          maker_.layout, maker_.points.data() + first * maker_.layout.bytes, node.points);
      entries.push_back(
          entry(node, begin + tail.size(), chunk.size(), static_cast<int>(node.points)));
      tail.append(chunk.begin(), chunk.end());
      sizes.push_back(
          {static_cast<std::uint32_t>(node.points), static_cast<std::uint32_t>(chunk.size())});
      first += node.points;
    }
    LasFileMaker::put(tail, 0, std::uint64_t{begin + tail.size()});
    const auto table = laz::encode_chunk_table(sizes, true);
    tail.append(table.begin(), table.end());
    std::string top;
    for (std::size_t k = 0; k < nodes_.size(); ++k) {
      std::string own = entries[k];
      if (nodes_[k].in_page) {
        if (change) change(nodes_.size() + k, own);
        const std::size_t page = begin + tail.size();
        tail += own;
        own = entry(nodes_[k], page, own.size(), -1);
      }
      if (change) change(k, own);
      top += own;
    }
    for (std::size_t k = 0; k < 4; ++k) LasFileMaker::put(maker_.copc, 8 * k, 512.0);
    LasFileMaker::put(maker_.copc, 40, std::uint64_t{begin + tail.size()});
    LasFileMaker::put(maker_.copc, 48, std::uint64_t{top.size()});
    return maker_.file(tail + top, true, laszip);
  }

 private:
  static std::string entry(const Node& node, std::size_t offset, std::size_t bytes, int points) {
    std::string text(32, '\0');
    LasFileMaker::put(text, 0, node.level);
    LasFileMaker::put(text, 4, node.place);
    LasFileMaker::put(text, 16, std::uint64_t{offset});
    LasFileMaker::put(text, 24, static_cast<std::int32_t>(bytes));
    LasFileMaker::put(text, 28, std::int32_t{points});
    return text;
  }

  std::vector<Node> nodes_;
  LasFileMaker maker_;
};

std::vector<CopcMaker::Node> copc_nodes() {
  return {{0, {0, 0, 0}, 500, false},
          {1, {0, 0, 0}, 300, false},
          {1, {1, 1, 0}, 200, false},
          {2, {3, 2, 1}, 90, true},
          {2, {0, 1, 0}, 50, true}};
}

std::size_t points_of(const std::string& bytes, const CloudReadOptions& options) {
  return read_cloud(MemoryFile(bytes).path(), options).size();
}

TEST(Copc, LevelsAndBoundsReadTheNodesThatTheyNeed) {
  const std::string file = CopcMaker(copc_nodes()).file();
  EXPECT_EQ(points_of(file, {}), 1140U);
  EXPECT_EQ(points_of(file, {.level = 0}), 500U);
  EXPECT_EQ(points_of(file, {.level = 1}), 1000U);
  EXPECT_EQ(points_of(file, {.level = 2}), 1140U);
  EXPECT_EQ(points_of(file, {.level = 99}), 1140U);
  // The same points by the table of chunks, and by the tree with bounds around all.
  const SurfelCloud all = cloud_of(file);
  const Bounds everything{Vec3d::Constant(-1), Vec3d::Constant(1025)};
  expect_same(read_cloud(MemoryFile(file).path(), {.bounds = everything}), all, "by the tree");
  const Bounds corner{Vec3d(600, 600, 10), Vec3d(1000, 1000, 400)};
  std::size_t inside = 0;
  for (std::size_t i = 0; i < all.size(); ++i) inside += corner.contains(all.world(i)) ? 1 : 0;
  EXPECT_GT(inside, 100U);
  EXPECT_EQ(points_of(file, {.bounds = corner}), inside);
  EXPECT_LT(points_of(file, {.level = 1, .bounds = corner}), inside);
}

TEST(Copc, NothingBelowTheLevelOrOutsideOfTheBoundsIsRead) {
  // The pages of the finest level lie behind the file's end, and a coarse node's points are
  // damaged.
  const auto far_page = [](std::size_t k, std::string& entry) {
    if (k == 3 || k == 4) LasFileMaker::put(entry, 16, std::uint64_t{1} << 40);
    if (k == 2) LasFileMaker::put(entry, 16, std::uint64_t{1} << 40);
  };
  const std::string file = CopcMaker(copc_nodes()).file(far_page);
  EXPECT_EQ(points_of(file, {.level = 0}), 500U);
  const Bounds low{Vec3d(1, 1, 1), Vec3d(250, 250, 250)};
  EXPECT_GT(points_of(file, {.bounds = low}), 0U);
  EXPECT_NE(message_of([&] { points_of(file, {.level = 1}); }).find("which cannot be"),
            std::string::npos);
  EXPECT_NE(
      message_of([&] { points_of(file, {.level = 2}); }).find("pages that are not in the file"),
      std::string::npos);
}

TEST(Copc, BrokenTreesAreRefused) {
  const auto message = [](const std::function<void(std::size_t, std::string&)>& change) {
    const std::string file = CopcMaker(copc_nodes()).file(change);
    return message_of([&] { points_of(file, {.level = 9}); });
  };
  const auto expect = [&](std::size_t node, std::size_t at, auto value, const std::string& part) {
    const std::string told = message([&](std::size_t k, std::string& entry) {
      if (k == node) LasFileMaker::put(entry, at, value);
    });
    EXPECT_NE(told.find(part), std::string::npos) << told;
  };
  expect(1, 0, std::int32_t{-3}, "impossible node");
  expect(1, 24, std::int32_t{-3}, "impossible node");
  expect(1, 28, std::int32_t{-7}, "impossible node");
  expect(1, 28, std::int32_t{299}, "are damaged");
  expect(1, 28, std::int32_t{1 << 30}, "which cannot be");
  expect(0, 28, std::int32_t{800}, "more points than the header counts");
  expect(2, 16, std::uint64_t{1000}, "share their points");
  // A page whose only entry is the page itself.
  std::uint64_t page = 0;
  message([&](std::size_t k, std::string& entry) {
    if (k == 3) std::memcpy(&page, entry.data() + 16, sizeof(page));
  });
  const std::string loop = message([&](std::size_t k, std::string& entry) {
    if (k != 5 + 3) return;
    LasFileMaker::put(entry, 16, page);
    LasFileMaker::put(entry, 28, std::int32_t{-1});
  });
  EXPECT_NE(loop.find("pages that are not in the file"), std::string::npos) << loop;
}

TEST(Copc, OfOtherProgramsHoldsWhatItsTwinHolds) {
  SURFEL_REQUIRE_TEST_DATA();
  const std::string copc = data_folder() / "formats/laz/1.2-with-color.copc.laz";
  const SurfelCloud twin = read_cloud(data_folder() / "lidar/1.2-with-color.las");
  const auto sorted = [](const SurfelCloud& cloud) {
    const std::vector<double> times = values_of(cloud, "gps_time");
    std::vector<std::array<double, 5>> rows;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      const Vec3d p = cloud.world(i);
      rows.push_back({times[i], std::round(p.x() * 100), std::round(p.y() * 100),
                      std::round(p.z() * 100), values_of(cloud, "intensity")[i]});
    }
    std::sort(rows.begin(), rows.end());
    return rows;
  };
  EXPECT_EQ(sorted(read_cloud(copc)), sorted(twin));
  EXPECT_EQ(sorted(read_cloud(copc, {.level = 30})), sorted(twin));
  EXPECT_EQ(read_cloud(copc, {.level = 0}).size(), 24U);
}

TEST(Las, BoundsLeaveOutOthersInEveryFormat) {
  const TemporaryFolder folder;
  const SurfelCloud cloud = cloud_of(maker_of(layout_of(3), 2000).las());
  const Bounds box = cloud.bounds();
  const Bounds part{box.min, box.center()};
  for (const char* name : {"a.las", "a.laz", "a.ply", "a.pcd"}) {
    write_cloud(cloud, folder / name);
    const SurfelCloud read = read_cloud(folder / name, {.bounds = part});
    EXPECT_LT(read.size(), 2000U);
    ASSERT_GT(read.size(), 100U) << name;
    for (std::size_t i = 0; i < read.size(); ++i) EXPECT_TRUE(part.contains(read.world(i)));
  }
  EXPECT_NE(message_of([&] { read_cloud(folder / "a.las", {.level = 1}); }).find("is no COPC file"),
            std::string::npos);
  EXPECT_NE(message_of([&] { read_cloud(folder / "a.ply", {.level = 1}); }).find("is no COPC file"),
            std::string::npos);
  const Bounds far{Vec3d::Constant(-9), Vec3d::Constant(-8)};
  EXPECT_NE(message_of([&] {
              read_cloud(folder / "a.las", {.bounds = far});
            }).find("holds no points within"),
            std::string::npos);
  EXPECT_THROW(read_cloud(folder / "a.las", {.bounds = Bounds{}}), Error);
  EXPECT_THROW(read_cloud(folder / "a.las", {.level = -1}), Error);
}

/// The code of the system that well-known text in a LAS file names; 0: none.
int code_of_text(const std::string& text) {
  const TemporaryFolder folder;
  SurfelCloud cloud;
  cloud.position.assign(1, Vec3f(1, 2, 3));
  cloud.las.emplace().records = {
      {.user = "LASF_Projection", .id = 2112, .description = "", .bytes = text}};
  write_cloud(cloud, folder / "a.las");
  return read_coordinate_system(folder / "a.las").value_or(CoordinateSystem{}).epsg;
}

TEST(Las, CoordinateSystemsHaveTheirCodes) {
  const std::string geographic =
      "GEOGCS[\"WGS 84\",UNIT[\"degree\",1,AUTHORITY[\"EPSG\",\"9122\"]]";
  EXPECT_EQ(code_of_text(geographic + ",AUTHORITY[\"EPSG\",\"4326\"]]"), 4326);
  EXPECT_EQ(code_of_text("PROJCS[\"a]\"," + geographic +
                         ",AUTHORITY[\"EPSG\",\"4326\"]],AUTHORITY[\"EPSG\",\"25832\"]]"),
            25832);
  EXPECT_EQ(code_of_text("PROJCS[\"a\"," + geographic + ",AUTHORITY[\"EPSG\",\"4326\"]]]"), 0)
      << "the code is that of the degrees below the projection";
  EXPECT_EQ(code_of_text("COMPOUNDCRS[\"a\",PROJCRS[\"b\",ID[\"EPSG\",25832]],"
                         "VERTCRS[\"c\",ID[\"EPSG\",5703]],ID[\"EPSG\",9999]]"),
            25832);
  for (const char* text :
       {"", "PROJCS[", "PROJCS[\"a", "PROJCS[AUTHORITY[\"EPSG\",\"x\"]]", "]]]"}) {
    EXPECT_EQ(code_of_text(text), 0) << text;
  }
  SURFEL_REQUIRE_TEST_DATA();
  const auto code_of_file = [](const char* name) {
    return read_coordinate_system(data_folder() / name).value_or(CoordinateSystem{}).epsg;
  };
  EXPECT_EQ(code_of_file("lidar/autzen-bmx-2010.las"), 2991);        // Text.
  EXPECT_EQ(code_of_file("formats/laz/point-time.las.laz"), 26910);  // GeoTIFF's keys.
  EXPECT_EQ(code_of_file("lidar/autzen_trim.las"), 0);               // No code.
  EXPECT_EQ(code_of_file("lidar/1.2-with-color.las"), 0);
}

TEST(Las, NamesAndContentsTellTheKind) {
  const TemporaryFolder folder;
  std::ofstream(folder / "scan.laz") << "something else";
  EXPECT_EQ(file_kind(folder / "scan.laz"), FileKind::kCloud);
  EXPECT_NE(message_of([&] { read_cloud(folder / "scan.laz"); }).find("is not a LAS file"),
            std::string::npos);
  std::ofstream(folder / "scan.bin", std::ios::binary) << maker_of(layout_of(1), 5).las();
  EXPECT_EQ(file_kind(folder / "scan.bin"), FileKind::kCloud);
  EXPECT_EQ(read_cloud(folder / "scan.bin").size(), 5U);
  EXPECT_THROW(CloudWriter(folder / "pieces.las", 5), Error);
}

}  // namespace
}  // namespace surfel::test
