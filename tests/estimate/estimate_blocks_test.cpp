#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/morton.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/estimate/estimate_blocks.h>
#include <surfel/estimate/loaded_runs.h>
#include <surfel/estimate/place_sample.h>
#include <surfel/estimate/range_normals.h>
#include <surfel/estimate/run_index.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/row_file.h>
#include <surfel/sample/generate.h>
#include <surfel/sample/procedural_surface.h>

#include "support/message_of.h"
#include "support/run_tool.h"
#include "support/test_data.h"
#include "support/thread_peers.h"

namespace surfel::test {
namespace {

/// The ranges of a cloud that is in memory.
class MemoryRanges final : public SurfelRanges {
 public:
  explicit MemoryRanges(const SurfelCloud& cloud) : cloud_(cloud) {}
  std::size_t size() const override { return cloud_.size(); }
  SurfelCloud read(std::size_t begin, std::size_t end) const override {
    Array<std::uint32_t> order(end - begin);
    std::iota(order.begin(), order.end(), static_cast<std::uint32_t>(begin));
    most_read = std::max(most_read.load(), order.size());
    return cloud_.gathered(order);
  }
  MortonGrid grid() const override { return morton_grid(cloud_.position); }

  mutable std::atomic<std::size_t> most_read = 0;

 private:
  const SurfelCloud& cloud_;
};

/// Puts the surfels together again.
class Collector final : public SurfelSink {
 public:
  void begin(const SurfelCloud& /*like*/, std::size_t count) override {
    surfels = {};
    blocks = 0;
    announced = count;
  }
  void put(SurfelCloud more, std::size_t at) override {
    EXPECT_EQ(at, surfels.size());
    if (blocks++ == 0) {
      surfels = std::move(more);
      return;
    }
    std::vector<std::function<void()>> joins;
    const auto join = [](auto& to, const auto& from) {
      to.insert(to.end(), from.begin(), from.end());
    };
    join(surfels.position, more.position);
    join(surfels.normal, more.normal);
    join(surfels.variance, more.variance);
    join(surfels.tangent, more.tangent);
    join(surfels.variance_u, more.variance_u);
    join(surfels.variance_v, more.variance_v);
    join(surfels.area, more.area);
    join(surfels.color, more.color);
    ASSERT_EQ(surfels.extra.size(), more.extra.size());
    for (std::size_t e = 0; e < more.extra.size(); ++e) {
      ASSERT_EQ(surfels.extra[e].name, more.extra[e].name);
      join(surfels.extra[e].data, more.extra[e].data);
    }
  }

  SurfelCloud surfels;
  std::size_t blocks = 0;
  std::size_t announced = 0;
};

template <class T>
bool same_bytes(const Array<T>& a, const Array<T>& b) {
  if (a.size() != b.size()) return false;
  return a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0;
}

/// Blocks of a test.
struct Blocks {
  std::size_t most_points;
  int threads = 2;
};

void expect_same(const SurfelCloud& cloud, const EstimateOptions& options, const Blocks& blocks,
                 const SurfelCloud& whole, const EstimateReport& whole_report) {
  SCOPED_TRACE(blocks.most_points);
  set_thread_count(blocks.threads);
  Collector collector;
  EstimateReport report;
  estimate_by_blocks(MemoryRanges(cloud), options, {.most_points = blocks.most_points}, collector,
                     &report);
  set_thread_count(0);
  const SurfelCloud& surfels = collector.surfels;
  EXPECT_EQ(collector.announced, whole.size());
  ASSERT_EQ(surfels.size(), whole.size());
  surfels.check_columns("");
  EXPECT_TRUE(same_bytes(surfels.position, whole.position));
  EXPECT_TRUE(same_bytes(surfels.normal, whole.normal));
  EXPECT_TRUE(same_bytes(surfels.variance, whole.variance));
  EXPECT_TRUE(same_bytes(surfels.tangent, whole.tangent));
  EXPECT_TRUE(same_bytes(surfels.variance_u, whole.variance_u));
  EXPECT_TRUE(same_bytes(surfels.variance_v, whole.variance_v));
  EXPECT_TRUE(same_bytes(surfels.area, whole.area));
  EXPECT_TRUE(same_bytes(surfels.color, whole.color));
  ASSERT_EQ(surfels.extra.size(), whole.extra.size());
  for (std::size_t e = 0; e < whole.extra.size(); ++e) {
    EXPECT_EQ(surfels.extra[e].name, whole.extra[e].name);
    EXPECT_TRUE(same_bytes(surfels.extra[e].data, whole.extra[e].data)) << whole.extra[e].name;
  }
  EXPECT_EQ(report.points, whole_report.points);
  EXPECT_EQ(report.nonfinite, whole_report.nonfinite);
  EXPECT_EQ(report.flagged, whole_report.flagged);
  EXPECT_EQ(report.extended, whole_report.extended);
  EXPECT_EQ(report.mean_neighbors, whole_report.mean_neighbors);
  EXPECT_EQ(report.side_confidence, whole_report.side_confidence);
  EXPECT_EQ(report.orientation.method, whole_report.orientation.method);
  EXPECT_EQ(report.orientation.components, whole_report.orientation.components);
  EXPECT_EQ(report.orientation.flipped, whole_report.orientation.flipped);
  EXPECT_EQ(report.orientation.unknown, whole_report.orientation.unknown);
  EXPECT_EQ(report.border, whole_report.border);
  EXPECT_EQ(report.capped, whole_report.capped);
  EXPECT_EQ(report.anisotropic, whole_report.anisotropic);
}

/// Expects the blocks' surfels to be those of all points at once, byte for byte.
void expect_same(const SurfelCloud& cloud, const EstimateOptions& options,
                 const std::vector<Blocks>& all) {
  EstimateReport report;
  const SurfelCloud whole = estimate_surfels(cloud, options, &report);
  for (const Blocks& blocks : all) expect_same(cloud, options, blocks, whole, report);
}

/// Points with colours, in the order of the curve.
SurfelCloud sorted(const SurfelCloud& cloud) {
  return cloud.gathered(morton_order(cloud.position));
}

SurfelCloud sorted_points(const std::string& kind, std::size_t count) {
  GenerateOptions options;
  options.count = count;
  SurfelCloud cloud = generate_surfels(procedural_scene(kind, 1), options);
  cloud.variance = {};
  cloud.area = {};
  cloud.uv = {};
  cloud.dpdu = cloud.dpdv = {};
  return sorted(cloud);
}

EstimateOptions up() {
  EstimateOptions options;
  options.orientation.method = Orientation::kUp;
  return options;
}

/// A terrain with a part that is 64 times as dense, points that coincide, a hole, a line of points,
/// one point far away and points that are nowhere.
SurfelCloud uneven_points() {
  SurfelCloud cloud = sorted_points("terrain", 9000);
  const auto add = [&](const Vec3f& p) {
    cloud.position.push_back(p);
    cloud.normal.push_back(cloud.normal[0]);
    cloud.color.push_back(cloud.color[0]);
  };
  const Bounds box = cloud.bounds();
  const Vec3f middle = box.center().cast<float>();
  const auto side = static_cast<float>((box.max - box.min).maxCoeff());
  const auto random = [&](std::uint64_t i, std::uint64_t d) {
    return static_cast<float>(random_uniform(3, i, d)) - 0.5F;
  };
  for (std::uint64_t i = 0; i < 4000; ++i) {
    add(middle + side * Vec3f(0.1F * random(i, 0), 0.1F * random(i, 1), 0.001F * random(i, 2)));
  }
  for (int i = 0; i < 40; ++i) add(cloud.position[500]);
  for (int i = 0; i < 20; ++i) add(cloud.position[static_cast<std::size_t>(600 + i)]);
  for (int i = 0; i < 200; ++i) {
    add(middle + side * Vec3f(0.001F * static_cast<float>(i), 0.3F, 0.5F));
  }
  add(middle + side * Vec3f(30, 20, 40));
  add(middle + side * Vec3f(2, 0, 0));
  cloud = sorted(cloud);
  for (int i = 0; i < 3; ++i) {
    add(Vec3f(std::numeric_limits<float>::quiet_NaN(), 0, 0));
    std::swap(cloud.position.back(), cloud.position[static_cast<std::size_t>(4000 * i + 7)]);
  }
  return cloud;
}

TEST(EstimateBlocks, GiveTheSameBytesWhereverBlocksEnd) {
  const SurfelCloud cloud = sorted_points("terrain", 16000);
  expect_same(cloud, up(), {{700}, {5000}, {1000000}, {4096, 1}});
}

TEST(EstimateBlocks, NeighborhoodsMayCrossManyBlocks) {
  const SurfelCloud cloud = uneven_points();
  expect_same(cloud, up(), {{500}, {4000}, {2000, 1}});
}

TEST(EstimateBlocks, AllLocalSidesWork) {
  SurfelCloud cloud = sorted_points("sphere", 8000);
  for (const Orientation method :
       {Orientation::kUp, Orientation::kViewpoint, Orientation::kAlign, Orientation::kNone}) {
    EstimateOptions options;
    options.orientation.method = method;
    if (method == Orientation::kViewpoint) options.orientation.viewpoint = Vec3d(0, 0, 3);
    expect_same(cloud, options, {{1500}});
  }
  // What the cloud tells counts as well, by --orient auto too.
  cloud.viewpoint = Viewpoint{Vec3d(1, 2, 3)};
  expect_same(cloud, {}, {{1500}});
  cloud.viewpoint.reset();
  cloud.scan_viewpoints = {{Vec3d(4, 0, 0)}, {Vec3d(0, 4, 0)}};
  ExtraProperty scan{"scan", ScalarType::kUint8, {}};
  for (std::size_t i = 0; i < cloud.size(); ++i) scan.data.push_back(std::byte(i / 100 % 2));
  cloud.extra.push_back(scan);
  expect_same(cloud, {}, {{1500}});
}

TEST(EstimateBlocks, SidesByWindingAreOfTheWholeSurface) {
  // Tiles end within blocks, and blocks within tiles.
  EstimateOptions options;
  for (const std::size_t tile_points : {std::size_t{1} << 18, std::size_t{3000}}) {
    SCOPED_TRACE(tile_points);
    options.orientation.tile_points = tile_points;
    expect_same(sorted_points("sphere", 12000), options, {{1500}, {5000, 1}});
    expect_same(sorted(uneven_points()), options, {{4000}});
  }
  const SurfelCloud sphere = sorted_points("sphere", 12000);
  Collector collector;
  EstimateReport report;
  estimate_by_blocks(MemoryRanges(sphere), options, {.most_points = 4096}, collector, &report);
  EXPECT_EQ(report.orientation.components, 1U);
  for (std::size_t i = 0; i < sphere.size(); ++i) {
    ASSERT_GT(collector.surfels.normal[i].dot(sphere.normal[i]), 0) << i;
  }
}

/// A Moebius strip, whose edges have few lengths, so that the order of equal ones tells where its
/// sides change; a sphere in noise; an upright corner, whose normals have no z; flat scan lines of
/// equal length that no edge to a nearest point joins; two sheets that end; scattered points. Some
/// points are there twice.
SurfelCloud several_parts(std::size_t count) {
  SurfelCloud cloud;
  const auto random = [&](std::uint64_t i, std::uint64_t d) { return random_uniform(7, i, d); };
  const auto add = [&](double x, double y, double z) {
    cloud.position.emplace_back(Vec3d(x, y, z).cast<float>());
  };
  constexpr double kTurn = 6.283185307179586;
  const double noise = 0.5 / std::sqrt(static_cast<double>(count));
  for (std::uint64_t i = 0; i < count; ++i) {
    const double around = kTurn * static_cast<double>(i / 9) * 9 / static_cast<double>(count);
    const double across = 0.04 * (static_cast<double>(i % 9) - 4);
    const double ring = 1 + across * std::cos(around / 2);
    add(ring * std::cos(around), ring * std::sin(around), across * std::sin(around / 2));
    const double u = random(i, 0);
    const double v = random(i, 1);
    if (i % 2 == 0) {
      const double radius = 0.5 + noise * (random(i, 2) - 0.5);
      const double at = 2 * std::sqrt(v * (1 - v));
      add(radius * at * std::cos(kTurn * u), radius * at * std::sin(kTurn * u) + 3,
          radius * (1 - 2 * v));
    }
    const double level = std::round(10 * v) / 10;
    if (i % 4 == 0) add(3, u, level);
    if (i % 4 == 1) add(3 - u, 0, level);
    if (i % 3 == 0) add(4 + u, 0.1 * v, 0.3 * std::cos(3 * u + v) + (i % 2 == 0 ? 0.03 : 0.0));
    if (i % 5 == 0) {
      const double line = std::floor(static_cast<double>(i) / 250);
      add(3 + static_cast<double>(i % 250) / 250 + 0.01 * u, -3 + line * 0.06, 0);
    }
    if (i % 100 == 0) add(6 * random(i, 3), 2 * random(i, 4), random(i, 5));
  }
  for (std::size_t i = 0; i < 100; ++i) cloud.position.push_back(cloud.position[7 * i]);
  return cloud;
}

/// The points in the order that the curve through their mirror images gives.
SurfelCloud sorted_otherwise(const SurfelCloud& cloud) {
  Array<Vec3f> mirrored = cloud.position;
  for (Vec3f& p : mirrored) p = -p;
  return cloud.gathered(morton_order(mirrored));
}

TEST(EstimateBlocks, SmallBlocksOfAnyOrderAreFinished) {
  expect_same(sorted_otherwise(several_parts(1800)), up(), {{250}});
}

TEST(EstimateBlocks, AllNeighborhoodsAndSizesWork) {
  const SurfelCloud cloud = uneven_points();
  EstimateOptions options = up();
  options.normals.adaptive = true;
  expect_same(cloud, options, {{3000}});
  options = up();
  options.normals.radius = 0.02 * (cloud.bounds().max - cloud.bounds().min).norm() / 40;
  expect_same(cloud, options, {{3000}});
  options = up();
  options.normals.k = 40;
  options.size.rule = VarianceRule::kMaxDistance;
  expect_same(cloud, options, {{3000}});
  options = up();
  options.size.anisotropy = Anisotropy::kOn;
  options.size.max_radius = 0;
  expect_same(cloud, options, {{3000}});
}

TEST(EstimateBlocks, FewPointsWork) {
  for (const std::size_t count : {1, 2, 5, 17, 40}) {
    expect_same(sorted_points("sphere", 1000).gathered([&] {
      Array<std::uint32_t> some(count);
      std::iota(some.begin(), some.end(), 0U);
      return some;
    }()),
                up(), {{4}});
  }
}

/// Scan lines on a plane, ten times as far apart as their points.
SurfelCloud scan_lines(std::size_t count, double apart) {
  SurfelCloud cloud;
  for (std::size_t i = 0; i < count; ++i) {
    const auto line = static_cast<double>(i / 200);
    const double along = static_cast<double>(i % 200) + random_uniform(5, i);
    cloud.position.emplace_back(Vec3d(along, apart * line, 0).cast<float>());
  }
  return sorted(cloud);
}

TEST(EstimateBlocks, ScanLinesGetEllipses) {
  const SurfelCloud cloud = scan_lines(10000, 10);
  expect_same(cloud, up(), {{2000}});
  Collector collector;
  EstimateReport report;
  estimate_by_blocks(MemoryRanges(cloud), up(), {.most_points = 2000}, collector, &report);
  EXPECT_TRUE(report.anisotropic);
}

TEST(EstimateBlocks, AWrongGuessOfEllipsesIsMended) {
  // All lines lie between the runs that are probed.
  SurfelCloud cloud = sorted_points("plane", 32 * 1024);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    Vec3f& p = cloud.position[i];
    if (i / 1024 % 2 == 1) p.y() = std::round(p.y() * 20) / 20;
  }
  expect_same(cloud, up(), {{1024}});
}

TEST(EstimateBlocks, MemoryBoundsTheBlocksAndTheirHalos) {
  const SurfelCloud cloud = sorted_points("terrain", 60000);
  const MemoryRanges ranges(cloud);
  Collector collector;
  estimate_by_blocks(ranges, up(), {.memory = 4 << 20}, collector);
  EXPECT_GT(collector.blocks, 5U);
  EXPECT_TRUE(same_bytes(collector.surfels.normal, estimate_surfels(cloud, up()).normal));
}

/// Writes surfels to a file.
class FileSink final : public SurfelSink {
 public:
  explicit FileSink(RowFile& file) : file_(file) {}
  void begin(const SurfelCloud& like, std::size_t count) override { file_.begin(like, count); }
  void put(SurfelCloud surfels, std::size_t at) override {
    if (left-- <= 0) throw Error(ErrorKind::kIo, "stopped");
    ++made;
    file_.put(surfels, 0, surfels.size(), at);
  }
  int left = 1000;  ///< Blocks that are taken before the run is stopped.
  int made = 0;

 private:
  RowFile& file_;
};

/// Points whose blocks are made twice, as probes guess wrongly whether ellipses are worth it.
SurfelCloud wrongly_guessed_plane() {
  SurfelCloud cloud = sorted_points("plane", 16 * 1024);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    Vec3f& p = cloud.position[i];
    if (i / 512 % 2 == 1) p.y() = std::round(p.y() * 20) / 20;
  }
  return cloud;
}

TEST(EstimateBlocks, FinishedBlocksAreKeptForALaterRun) {
  const TemporaryFolder folder;
  const std::string path = folder / "surfels.ply";
  const SurfelCloud cloud = wrongly_guessed_plane();
  EstimateReport whole;
  write_cloud(estimate_surfels(cloud, up(), &whole), folder / "whole.ply");
  int made = 0;
  for (const int blocks : {10, 15, 20, 9, 1000}) {
    RowFile file(path, {.job = "surfels"});
    FileSink sink(file);
    sink.left = blocks;
    EstimateReport report;
    const bool stopped =
        !message_of([&] {
           estimate_by_blocks(MemoryRanges(cloud), up(), {.most_points = 512, .checkpoints = &file},
                              sink, &report);
         }).empty();
    made += sink.made;
    EXPECT_EQ(stopped, blocks < 1000);
    if (stopped) continue;
    file.commit();
    EXPECT_EQ(report.mean_neighbors, whole.mean_neighbors);
    EXPECT_EQ(report.side_confidence, whole.side_confidence);
    EXPECT_EQ(report.border, whole.border);
  }
  EXPECT_EQ(made, 64);
  EXPECT_TRUE(read_text(path) == read_text(folder / "whole.ply"));
}

TEST(EstimateBlocks, WhatPeersHaveMadeIsKeptForAnyNumberOfThem) {
  const TemporaryFolder folder;
  const std::string path = folder / "surfels.ply";
  const SurfelCloud cloud = wrongly_guessed_plane();
  EstimateReport whole;
  write_cloud(estimate_surfels(cloud, up(), &whole), folder / "whole.ply");
  int made = 0;
  // Each peer is stopped before its last block, or none is.
  for (const auto& [peers, blocks] : {std::pair{3, 4}, {2, 6}, {1, 12}, {4, 2}, {2, 1000}}) {
    std::atomic<int> made_now = 0;
    std::atomic<int> stopped = 0;
    run_peers(peers, [&, most = blocks](ThreadPeers& self) {
      RowFile file(path, {.job = "surfels", .peers = &self});
      FileSink sink(file);
      sink.left = most;
      EstimateReport report;
      const bool ended =
          message_of([&] {
            estimate_by_blocks(MemoryRanges(cloud), up(),
                               {.most_points = 512, .checkpoints = &file, .peers = &self}, sink,
                               &report);
          }).empty();
      made_now += sink.made;
      if (!ended) {
        ++stopped;
        return;
      }
      file.commit();
      EXPECT_EQ(report.mean_neighbors, whole.mean_neighbors);
      EXPECT_EQ(report.side_confidence, whole.side_confidence);
      EXPECT_EQ(report.border, whole.border);
    });
    EXPECT_EQ(stopped, blocks < 1000 ? peers : 0);
    made += made_now;
  }
  EXPECT_EQ(made, 64);
  EXPECT_TRUE(read_text(path) == read_text(folder / "whole.ply"));
  EXPECT_EQ(entries(folder / "").size(), 2U);
}

TEST(EstimateBlocks, PeersShareTheBlocksWhateverMemoryEachHas) {
  const SurfelCloud cloud = sorted_points("terrain", 20000);
  EstimateOptions winding;
  winding.orientation.method = Orientation::kWinding;
  winding.orientation.tile_points = 3000;
  for (const EstimateOptions& options : {up(), winding}) {
    const TemporaryFolder folder;
    const std::string path = folder / "surfels.ply";
    EstimateReport whole;
    write_cloud(estimate_surfels(cloud, options, &whole), folder / "whole.ply");
    constexpr int kPeers = 3;
    std::array<int, kPeers> made{};
    EstimateReport report;
    run_peers(kPeers, [&](ThreadPeers& self) {
      RowFile file(path, {.peers = &self});
      FileSink sink(file);
      EstimateReport mine;
      // By blocks of another size each they would leave some out.
      const std::uint64_t memory = std::uint64_t{5U + static_cast<unsigned>(self.rank())} << 20;
      estimate_by_blocks(MemoryRanges(cloud), options, {.memory = memory, .peers = &self}, sink,
                         &mine);
      file.commit();
      made[static_cast<std::size_t>(self.rank())] = sink.made;
      if (self.rank() == 2) report = mine;
    });
    EXPECT_TRUE(read_text(path) == read_text(folder / "whole.ply"));
    const auto [least, most] = std::minmax_element(made.begin(), made.end());
    EXPECT_GT(*least, 0);
    EXPECT_LE(*most, *least + 1);
    EXPECT_EQ(report.mean_neighbors, whole.mean_neighbors);
    EXPECT_EQ(report.border, whole.border);
    EXPECT_EQ(report.orientation.components, whole.orientation.components);
  }
}

TEST(EstimateBlocks, ColorsThatAreNotFiniteAreCounted) {
  SurfelCloud cloud = sorted_points("sphere", 3000);
  cloud.color[5].x() = std::numeric_limits<float>::quiet_NaN();
  cloud.color[2999].y() = std::numeric_limits<float>::infinity();
  EstimateReport whole;
  estimate_surfels(cloud, up(), &whole);
  EXPECT_EQ(whole.unusable_colors, 2U);
  Collector collector;
  EstimateReport report;
  estimate_by_blocks(MemoryRanges(cloud), up(), {.most_points = 512}, collector, &report);
  EXPECT_EQ(report.unusable_colors, 2U);
}

TEST(EstimateBlocks, WhatCannotBeDoneIsRefusedBefore) {
  const SurfelCloud cloud = sorted_points("sphere", 3000);
  const auto refused = [&](const EstimateOptions& options) {
    Collector collector;
    EXPECT_THROW(estimate_by_blocks(MemoryRanges(cloud), options, {}, collector), Error);
    EXPECT_EQ(collector.announced, 0U);
    EXPECT_EQ(block_problems(options).size(), 1U);
  };
  EstimateOptions options = up();
  options.voxels.emplace();
  refused(options);
  options = up();
  options.smoothing.emplace();
  refused(options);
  options = up();
  options.edges.emplace();
  refused(options);
  options = up();
  options.outliers.emplace();
  refused(options);
  options = up();
  options.search = SearchMethod::kFlann;
  refused(options);
  for (const Orientation method : {Orientation::kMst, Orientation::kOutward}) {
    options = {};
    options.orientation.method = method;
    refused(options);
    for (const char* instead : {"winding", "up", "viewpoint"}) {
      EXPECT_NE(block_problems(options).front().find(instead), std::string::npos);
    }
  }
  EXPECT_TRUE(block_problems({}).empty());
  EXPECT_TRUE(block_problems(up()).empty());

  Collector collector;
  options = up();
  EXPECT_THROW(estimate_by_blocks(MemoryRanges(cloud), options, {.memory = 1000}, collector),
               Error);
  options.orientation.method = Orientation::kAlign;
  SurfelCloud without = cloud;
  without.normal[17] = Vec3f(0, 0, 0);
  EXPECT_THROW(estimate_by_blocks(MemoryRanges(without), options, {}, collector), Error);
  EXPECT_EQ(collector.announced, 0U);
}

TEST(EstimateBlocks, PointsWithoutOrderAreRefused) {
  SurfelCloud cloud = sorted_points("sphere", 20000);
  Array<std::uint32_t> order(cloud.size());
  for (std::uint32_t i = 0; i < order.size(); ++i) {
    order[i] = static_cast<std::uint32_t>((i * std::uint64_t{11677}) % order.size());
  }
  cloud = cloud.gathered(order);
  Collector collector;
  EXPECT_THROW(estimate_by_blocks(MemoryRanges(cloud), up(), {.most_points = 128}, collector),
               Error);
}

TEST(EstimateBlocks, StraysAreNoDisorder) {
  SurfelCloud cloud = sorted_points("terrain", 300000);
  const auto side = static_cast<float>(cloud.bounds().diagonal());
  for (std::size_t i = 0; i < 5; ++i) {
    cloud.position[i] = side * Vec3f(-300 - 0.01F * static_cast<float>(i), -4000, 0);
  }
  cloud = sorted(cloud);
  Collector collector;
  estimate_by_blocks(MemoryRanges(cloud), up(), {.memory = std::uint64_t{12} << 20}, collector);
  EXPECT_EQ(collector.surfels.size(), cloud.size());
}

TEST(PlaceSample, DependsOnThePlacesAlone) {
  std::vector<Vec3f> points;
  for (std::uint64_t i = 0; i < 200000; ++i) {
    points.emplace_back(static_cast<float>(random_uniform(1, i, 0)),
                        static_cast<float>(random_uniform(1, i, 1)), 0.0F);
  }
  const std::vector<Vec3f> sample = sample_places(points, 300);
  ASSERT_EQ(sample.size(), 300U);
  PlaceSample other(300);
  std::vector<Vec3f> twice(points.rbegin(), points.rend());
  twice.insert(twice.end(), points.begin(), points.begin() + 50000);
  for (Vec3f& p : twice) p.z() = -0.0F;
  for (std::size_t i = 0; i < twice.size(); i += 777) {
    other.add(
        std::span<const Vec3f>(twice).subspan(i, std::min<std::size_t>(777, twice.size() - i)));
  }
  EXPECT_EQ(other.places(), sample);
  // It is spread evenly.
  const auto left =
      std::count_if(sample.begin(), sample.end(), [](const Vec3f& p) { return p.x() < 0.5F; });
  EXPECT_NEAR(static_cast<double>(left), 150, 45);
  EXPECT_EQ(sample_places(std::span(points).first(5), 300).size(), 5U);
}

TEST(RunSearch, FindsWhatASearchOfAllPointsFinds) {
  // A lattice is full of points at equal distances.
  SurfelCloud cloud;
  for (int i = 0; i < 12 * 12 * 12; ++i) {
    cloud.position.emplace_back(static_cast<float>(i % 12), static_cast<float>(i / 12 % 12),
                                static_cast<float>(i / 144));
  }
  cloud.position.emplace_back(3.0F, 3.0F, 3.0F);
  cloud = sorted(cloud);
  RunIndex index(64);
  index.add(cloud.position);
  index.finish();
  const MemoryRanges ranges(cloud);
  RunSearch search(ranges, index);
  const auto exact = make_neighbor_search(cloud.position);
  auto expected = nearest_places(cloud.position, *exact);
  std::vector<Vec3f> near, all;
  for (std::size_t i = 0; i < cloud.size(); i += 7) {
    search.nearest(cloud.position[i], 20, near);
    expected(cloud.position[i], 20, all);
    EXPECT_EQ(near, all);
  }
  search.nearest(Vec3f(0, 0, 0), 5000, near);
  EXPECT_EQ(near.size(), cloud.size());
}

TEST(RunSearch, FindsTheDirectionsThatAllPointsHave) {
  SurfelCloud cloud;
  for (std::uint64_t i = 0; i < 6000; ++i) {
    const auto at = [&](std::uint64_t d) {
      return static_cast<float>(4 * random_uniform(15, i, d) - 2);
    };
    cloud.position.emplace_back(at(0), at(1), at(2));
  }
  cloud.position[5000] = Vec3f::Constant(std::numeric_limits<float>::quiet_NaN());
  cloud = sorted(cloud);
  RunIndex index(16);
  index.add(cloud.position);
  index.finish();
  const MemoryRanges ranges(cloud);
  RunSearch search(ranges, index);
  std::vector<float> found;
  for (const Vec3d& sensor : {Vec3d(0.1, 0.2, 0.3), Vec3d(5, 1, 0)}) {
    for (std::size_t i = 0; i < cloud.size(); i += 300) {
      const Vec3f direction = direction_from(sensor, cloud.position[i]);
      if (!direction.allFinite()) continue;
      std::vector<float> all;
      for (const Vec3f& p : cloud.position) {
        if (p.allFinite()) all.push_back((direction_from(sensor, p) - direction).squaredNorm());
      }
      std::sort(all.begin(), all.end());
      all.resize(20);
      search.nearest_directions(sensor, direction, 20, found);
      EXPECT_EQ(found, all);
    }
  }
  search.nearest_directions(Vec3d(0, 0, 0), Vec3f(0, 0, 1), 10000, found);
  EXPECT_EQ(found.size(), index.finite());
}

TEST(LoadedRuns, KnowUpToTheNearestPointThatIsNotThere) {
  SurfelCloud cloud;
  for (std::uint64_t i = 0; i < 4000; ++i) {
    const auto at = [&](std::uint64_t d) { return static_cast<float>(random_uniform(9, i, d)); };
    cloud.position.emplace_back(at(0), at(1), 0.1F * at(2));
  }
  cloud = sorted(cloud);
  constexpr std::size_t kRun = 50;
  RunIndex index(kRun);
  index.add(cloud.position);
  index.finish();
  LoadedRuns runs(index);
  RunBox box;
  box.add(Vec3f(0.4F, 0.4F, 0));
  box.add(Vec3f(0.5F, 0.5F, 0.1F));
  runs.add_near(box, 0.1F);
  EXPECT_LT(runs.finite(), cloud.size());
  Array<float> known(cloud.size());
  for (std::size_t run = 0; run < index.size(); ++run) {
    if (!runs.has(run)) continue;
    const std::span<const Vec3f> places(cloud.position.data() + run * kRun, kRun);
    runs.known_around(places, false, known.data() + run * kRun);
    std::array<float, kRun> exact{};
    runs.known_around(places, true, exact.data());
    for (std::size_t i = run * kRun; i < (run + 1) * kRun; ++i) {
      float to_run = std::numeric_limits<float>::infinity();
      for (std::size_t r = 0; r < index.size(); ++r) {
        if (!runs.has(r)) to_run = std::min(to_run, index[r].box.distance2(cloud.position[i]));
      }
      EXPECT_NEAR(exact[i - run * kRun], std::sqrt(to_run), 1e-5);
      EXPECT_LE(known[i], exact[i - run * kRun]);
      float nearest = std::numeric_limits<float>::infinity();
      for (std::size_t j = 0; j < cloud.size(); ++j) {
        if (!runs.has(j / kRun)) {
          nearest = std::min(nearest, (cloud.position[i] - cloud.position[j]).norm());
        }
      }
      EXPECT_LE(known[i], nearest);
      if (box.distance2(cloud.position[i]) == 0) {
        EXPECT_GE(known[i], 0.0999F);
      }
    }
  }
  for (std::size_t run = 0; run < index.size(); ++run) runs.add(run);
  EXPECT_EQ(runs.finite(), cloud.size());
  runs.known_around({cloud.position.data(), 1}, false, known.data());
  EXPECT_EQ(known[0], std::numeric_limits<float>::infinity());
}

}  // namespace
}  // namespace surfel::test
