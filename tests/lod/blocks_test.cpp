// Levels of detail that are made in several blocks.

#include <atomic>
#include <cmath>
#include <cstring>
#include <numeric>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/morton.h>
#include <surfel/base/parallel.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/cloud_ranges.h>
#include <surfel/io/levels_writer.h>
#include <surfel/lod/hierarchy.h>
#include <surfel/lod/level_plan.h>

#include "render/scenes.h"
#include "support/message_of.h"
#include "support/run_tool.h"
#include "support/thread_peers.h"

namespace surfel::test {
namespace {

/// The reduction of the smallest blocks, of 20,736 surfels.
constexpr int kReduction = 9;
constexpr int kSurfels = 200000;

SurfelCloud sphere(int count = kSurfels) {
  SurfelCloud cloud = fibonacci_sphere(count, 1);
  ExtraProperty& extra = cloud.extra.emplace_back(ExtraProperty{"tag", ScalarType::kUint16, {}});
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    cloud.coefficient[i] = Vec3f(0.5F + cloud.position[i].x() / 2, 0.5F, 1);
    cloud.source.push_back(static_cast<std::uint32_t>(i));
    extra.data.push_back(static_cast<std::byte>(i & 0xff));
    extra.data.push_back(static_cast<std::byte>(i >> 8 & 0xff));
  }
  return cloud;
}

/// Writes the levels of a file that is read block by block; returns the file's bytes.
std::string levels_of_file(const std::string& from, const std::string& to,
                           const HierarchyOptions& options, HierarchyReport* report = nullptr) {
  const auto ranges = CloudRanges::open(from);
  LevelsWriter writer(to, {});
  EXPECT_TRUE(build_hierarchy(*ranges, options, writer, report));
  writer.commit();
  return read_text(to);
}

TEST(HierarchyBlocks, AreAFewClustersToTheHighestPower) {
  for (int reduction = 2; reduction <= 16; ++reduction) {
    std::size_t size = most_block_surfels(reduction);
    EXPECT_LE(size, 1U << 17);
    EXPECT_GT(size * static_cast<std::size_t>(reduction), 1U << 17);
    while (size > kClusterSurfels) {
      EXPECT_EQ(size % static_cast<std::size_t>(reduction), 0U);
      size /= static_cast<std::size_t>(reduction);
    }
    EXPECT_EQ(size, kClusterSurfels);
  }
}

TEST(HierarchyBlocks, NeitherMemoryNorThreadsNorWhereTheSurfelsAreMatter) {
  const TemporaryFolder folder;
  for (const Vec3d& origin : {Vec3d(0, 0, 0), Vec3d(455000.25, 5401000, 200)}) {
    SurfelCloud cloud = sphere();
    cloud.origin = origin;
    write_cloud(cloud.gathered(morton_order(cloud.position)), folder / "sorted.ply");
    const SurfelCloud read = read_cloud(folder / "sorted.ply");
    const HierarchyOptions options{.reduction = kReduction};
    HierarchyReport whole;
    const SurfelCloud levels = build_hierarchy(read, options, &whole);
    write_cloud(levels, folder / "whole.ply");
    const std::string expected = read_text(folder / "whole.ply");
    EXPECT_GE(whole.blocks, 8U);
    ASSERT_EQ(tree_problem(levels.tree, levels.size()), "");

    // The least memory lets threads work on one block together, more memory on one each.
    std::uint64_t least = 1 << 19;
    while (!message_of([&] {
              levels_of_file(folder / "sorted.ply", folder / "levels.ply",
                             {.reduction = kReduction, .memory = least});
            }).empty()) {
      least += 1 << 19;
    }
    for (const std::uint64_t memory : {least, 64 * least, std::uint64_t{0}}) {
      for (const int threads : {1, 2}) {
        set_thread_count(threads);
        HierarchyReport report;
        const std::string bytes =
            levels_of_file(folder / "sorted.ply", folder / "levels.ply",
                           {.reduction = kReduction, .memory = memory}, &report);
        EXPECT_EQ(report.blocks_at_once, memory == least ? 1U : static_cast<std::size_t>(threads));
        EXPECT_TRUE(bytes == expected) << memory << ' ' << threads;
        EXPECT_EQ(report.levels, whole.levels);
        EXPECT_EQ(report.spacing, whole.spacing);
        EXPECT_EQ(report.surfels, levels.size());
      }
    }
    set_thread_count(0);
  }
}

TEST(HierarchyBlocks, DoNotDependOnTheOrderInMemory) {
  const SurfelCloud cloud = sphere(60000);
  Array<std::uint32_t> order(cloud.size());
  std::iota(order.begin(), order.end(), 0U);
  for (std::size_t i = order.size(); i-- > 1;) {
    std::swap(order[i], order[random_bits(1, i) % (i + 1)]);
  }
  const TemporaryFolder folder;
  write_cloud(build_hierarchy(cloud, {.reduction = kReduction}), folder / "a.ply");
  write_cloud(build_hierarchy(cloud.gathered(order), {.reduction = kReduction}), folder / "b.ply");
  EXPECT_TRUE(read_text(folder / "a.ply") == read_text(folder / "b.ply"));
}

TEST(HierarchyBlocks, HoldEverySurfelOnceAndMergeAllOfThem) {
  const SurfelCloud cloud = sphere();
  HierarchyReport report;
  const SurfelCloud levels = build_hierarchy(cloud, {.reduction = kReduction}, &report);
  EXPECT_GE(report.blocks, 8U);
  const std::size_t finest = levels.tree[first_leaf(levels.tree)].begin;
  ASSERT_EQ(levels.size() - finest, cloud.size());
  std::vector<bool> seen(cloud.size(), false);
  for (std::size_t i = finest; i < levels.size(); ++i) {
    const std::uint32_t k = levels.source[i];
    EXPECT_FALSE(seen[k]);
    seen[k] = true;
    EXPECT_EQ(levels.position[i], cloud.position[k]);
  }
  // What is not merged comes from one surfel, through all levels.
  const Array<std::byte>& tags = levels.extra.at(0).data;
  for (std::size_t i = 0; i < levels.size(); ++i) {
    ASSERT_EQ(
        std::memcmp(tags.data() + 2 * i, cloud.extra[0].data.data() + 2 * levels.source[i], 2), 0);
  }
  std::vector<double> area(report.levels.size(), 0);
  std::vector<Vec3d> light(report.levels.size(), Vec3d::Zero());
  for (std::size_t i = 0; i < levels.size(); ++i) {
    area[levels.level[i]] += levels.area[i];
    light[levels.level[i]] +=
        static_cast<double>(levels.area[i]) * levels.coefficient[i].cast<double>();
  }
  for (std::size_t l = 1; l < area.size(); ++l) {
    // A piece of a sphere is larger than what it covers as seen from above.
    const double tolerance = 1e-3 + 2 / static_cast<double>(report.levels[l]);
    EXPECT_NEAR(area[l] / area[0], 1, tolerance) << l;
    EXPECT_LT((light[l] / area[l] - light[0] / area[0]).norm(), tolerance) << l;
  }
}

TEST(HierarchyBlocks, HaveBoundsThatHoldEverythingBelow) {
  const SurfelCloud levels = build_hierarchy(sphere(), {.reduction = kReduction});
  const ClusterTree& tree = levels.tree;
  const std::size_t leaf = first_leaf(tree);
  for (std::size_t c = 0; c < tree.size(); ++c) {
    std::size_t first = c;
    std::size_t last = c;
    while (first < leaf) first = tree[first].first_child;
    while (last < leaf) last = tree[last].first_child + tree[last].child_count - 1;
    const ClusterBounds& bounds = tree[c].bounds;
    const auto expect_inside = [&](std::uint32_t i) {
      ASSERT_LE((levels.position[i] - bounds.center).norm(), bounds.radius) << c;
      ASSERT_LE(std::sqrt(levels.variance_u[i]), bounds.max_deviation * (1 + 1e-5F)) << c;
      if (bounds.cone_cosine > 0) {
        ASSERT_GE(bounds.cone_axis.dot(levels.normal[i]), bounds.cone_cosine - 1e-5F) << c;
      }
    };
    for (std::uint32_t i = tree[c].begin; i < tree[c].end; ++i) expect_inside(i);
    Vec3f reach_min = Vec3f::Constant(INFINITY);
    Vec3f reach_max = -reach_min;
    for (std::uint32_t i = tree[first].begin; i < tree[last].end; ++i) {
      expect_inside(i);
      const Vec3f reach = Vec3f::Constant(std::sqrt(levels.variance_u[i]));
      reach_min = reach_min.cwiseMin(levels.position[i] - reach);
      reach_max = reach_max.cwiseMax(levels.position[i] + reach);
    }
    EXPECT_EQ(tree[c].reach_min, reach_min) << c;
    EXPECT_EQ(tree[c].reach_max, reach_max) << c;
  }
  // Spheres are no larger than they must be by far.
  EXPECT_LT(tree.front().bounds.radius, 1.8F);
}

TEST(HierarchyBlocks, OfPlacesAndOutliersAndSurfelsThatCannotBeDrawn) {
  SurfelCloud coincident;
  for (int i = 0; i < 50000; ++i) add_surfel(coincident, {1, 2, 3}, {0, 0, 1}, 1, 1, {1, 1, 1});
  SurfelCloud outliers = sphere(50000);
  outliers.position[100] = {1e6F, 0, 0};
  outliers.position[200] = {-1e6F, 1e6F, 5e5F};
  SurfelCloud broken = sphere(50000);
  for (std::size_t i = 0; i < broken.size(); i += 2) broken.variance[i] = -1;
  for (std::size_t i = 0; i < 30000; ++i) broken.position[i].z() = NAN;
  for (const SurfelCloud& cloud : {coincident, outliers, broken}) {
    HierarchyReport report;
    const SurfelCloud levels = build_hierarchy(cloud, {.reduction = kReduction}, &report);
    EXPECT_EQ(tree_problem(levels.tree, levels.size()), "");
    EXPECT_EQ(report.levels.front() + report.dropped.total(), cloud.size());
    EXPECT_LE(levels.tree.front().end, kClusterSurfels);
    for (std::size_t i = 0; i < levels.size(); ++i) {
      ASSERT_TRUE(levels.position[i].allFinite());
      ASSERT_GT(levels.variance_v[i], 0);
    }
  }
  HierarchyReport report;
  build_hierarchy(broken, {.reduction = kReduction}, &report);
  EXPECT_EQ(report.dropped.position, 30000U);
  EXPECT_EQ(report.dropped.variance, 10000U);
}

TEST(HierarchyBlocks, RefuseTooLittleMemoryAndOtherOrders) {
  const SurfelCloud cloud = sphere(60000);
  const std::string message =
      message_of([&] { build_hierarchy(cloud, {.memory = 1 << 20}, nullptr, "cloud.ply"); });
  EXPECT_NE(message.find("cloud.ply: levels of its surfels take"), std::string::npos) << message;
  EXPECT_NE(message.find("and `memory` is 1 MB"), std::string::npos) << message;

  const TemporaryFolder folder;
  write_cloud(cloud, folder / "spiral.ply");
  const auto ranges = CloudRanges::open(folder / "spiral.ply");
  {
    LevelsWriter writer(folder / "levels.ply", {});
    EXPECT_FALSE(build_hierarchy(*ranges, {}, writer));
  }
  EXPECT_EQ(CloudRanges::open(folder / "spiral.ply")->size(), cloud.size());
  EXPECT_THROW(CloudRanges::open(folder / "levels.ply"), Error);
}

TEST(HierarchyBlocks, FinishedBlocksAreKeptForALaterRun) {
  const TemporaryFolder folder;
  const SurfelCloud cloud = sphere(60000);
  write_cloud(cloud.gathered(morton_order(cloud.position)), folder / "sorted.ply");
  const HierarchyOptions plain{.reduction = kReduction};
  const std::string expected = levels_of_file(folder / "sorted.ply", folder / "whole.ply", plain);
  const auto ranges = CloudRanges::open(folder / "sorted.ply");
  const std::string to = folder / "levels.ply";

  /// Fails once so many blocks are finished, as a run that is killed.
  class Stopping final : public Checkpoints {
   public:
    Stopping(Checkpoints& to, int blocks) : to_(to), left_(blocks) {}
    std::optional<std::string> finished(std::uint64_t part) override {
      std::optional<std::string> state = to_.finished(part);
      taken_ += state ? 1 : 0;
      return state;
    }
    void finish(std::uint64_t part, std::span<const RowSpan> rows,
                const std::string& state) override {
      if (left_-- <= 0) throw Error(ErrorKind::kIo, "stopped");
      to_.finish(part, rows, state);
    }
    int taken() const { return taken_; }

   private:
    Checkpoints& to_;
    std::atomic<int> left_;
    std::atomic<int> taken_{0};
  };
  const auto run = [&](int blocks, int expected_taken) {
    LevelsWriter writer(to, {}, {.job = "levels"});
    Stopping stopping(writer.file(), blocks);
    HierarchyOptions options = plain;
    options.checkpoints = &stopping;
    options.memory = std::uint64_t{48} << 20;
    const bool stopped = !message_of([&] { build_hierarchy(*ranges, options, writer); }).empty();
    EXPECT_EQ(stopping.taken(), expected_taken);
    if (!stopped) writer.commit();
    return stopped;
  };
  EXPECT_TRUE(run(2, 0));
  EXPECT_TRUE(run(1, 2));
  EXPECT_FALSE(run(1000, 3));
  EXPECT_TRUE(read_text(to) == expected);
}

TEST(HierarchyBlocks, PeersShareThem) {
  const TemporaryFolder folder;
  const SurfelCloud cloud = sphere(120000);
  write_cloud(cloud.gathered(morton_order(cloud.position)), folder / "sorted.ply");
  const HierarchyOptions plain{.reduction = kReduction};
  const std::string expected = levels_of_file(folder / "sorted.ply", folder / "whole.ply", plain);
  const auto ranges = CloudRanges::open(folder / "sorted.ply");
  const std::string to = folder / "levels.ply";

  /// Counts the surfels that a process writes.
  class Counting final : public LevelSink {
   public:
    explicit Counting(LevelSink& to) : to_(to) {}
    void begin(const SurfelCloud& like, std::size_t surfels, std::size_t clusters) override {
      all = surfels;
      to_.begin(like, surfels, clusters);
    }
    void put(const SurfelCloud& part, std::size_t begin, std::size_t end, std::size_t at) override {
      written += end - begin;
      to_.put(part, begin, end, at);
    }
    void finish(ClusterTree tree) override { to_.finish(std::move(tree)); }
    std::atomic<std::size_t> written = 0;
    std::size_t all = 0;

   private:
    LevelSink& to_;
  };
  std::atomic<std::size_t> written = 0;
  std::atomic<std::size_t> all = 0;
  run_peers(3, [&](ThreadPeers& self) {
    LevelsWriter writer(to, {}, {.peers = &self});
    Counting counting(writer);
    HierarchyOptions options = plain;
    options.peers = &self;
    EXPECT_TRUE(build_hierarchy(*ranges, options, counting));
    writer.commit();
    EXPECT_LT(counting.written, counting.all / 2);
    EXPECT_GT(counting.written, 0U);
    written += counting.written;
    all = counting.all;
  });
  EXPECT_EQ(written, all);
  EXPECT_TRUE(read_text(to) == expected);
}

}  // namespace
}  // namespace surfel::test
