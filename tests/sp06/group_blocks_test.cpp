#include <algorithm>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/morton.h>
#include <surfel/base/parallel.h>
#include <surfel/scene/surfel_ranges.h>
#include <surfel/sp06/group_blocks.h>

#include "sp06/clouds.h"
#include "support/interrupted.h"

namespace surfel {
namespace {

class GroupSink final : public SurfelSink {
 public:
  explicit GroupSink(std::vector<std::uint16_t>& to) : to_(to) {}
  void begin(const SurfelCloud& like, std::size_t /*count*/) override {
    EXPECT_EQ(like.group.size(), 1U);
    EXPECT_TRUE(like.group_radius.empty());
    to_.clear();
  }
  void put(SurfelCloud surfels, std::size_t at) override {
    EXPECT_EQ(at, to_.size());
    EXPECT_TRUE(surfels.group_radius.empty());
    to_.insert(to_.end(), surfels.group.begin(), surfels.group.end());
  }

 private:
  std::vector<std::uint16_t>& to_;
};

/// Groups by number in the order of the cloud; empty if the cloud is in no order.
std::vector<std::uint16_t> groups_of(const SurfelRanges& cloud, const GroupingOptions& options,
                                     std::size_t most, GroupingReport* report = nullptr) {
  std::vector<std::uint16_t> out;
  GroupSink sink(out);
  group_by_blocks(cloud, options, sink, report, "cloud", {.most = most});
  return out;
}

/// Large splats among small ones, some of which cannot be drawn.
SurfelCloud uneven_cloud() {
  SurfelCloud cloud = test::sphere_cloud(4000, 14);
  for (std::size_t i = 0; i < cloud.size(); i += 150) cloud.variance[i] *= 300;
  cloud.variance[77] = -1;
  cloud.position[78].x() = std::numeric_limits<float>::quiet_NaN();
  cloud.variance.back() = 0;
  return cloud.gathered(morton_order(cloud.position));
}

TEST(GroupBlocks, NoTwoSplatsOfAGroupOverlapWhateverTheBlocks) {
  const SurfelCloud cloud = uneven_cloud();
  const OrderedCloud ranges(cloud);
  const std::vector<test::Pair> pairs = test::overlapping_pairs(cloud, 1, 1);
  GroupingReport whole;
  make_groups(cloud, {}, &whole);
  for (const ColoringOrder order : test::kColoringOrders) {
    for (const std::size_t most : {64, 500, 100000}) {
      GroupingReport report;
      const auto group = groups_of(ranges, {.order = order}, most, &report);
      ASSERT_EQ(group.size(), cloud.size());
      for (const auto& [i, j] : pairs) ASSERT_NE(group[i], group[j]) << i << " " << j;
      // All edges are found, at both ends.
      EXPECT_EQ(report.edges, whole.edges);
      EXPECT_EQ(report.max_degree, whole.max_degree);
      EXPECT_EQ(report.unusable, 3U);
      EXPECT_EQ(report.groups, report.sizes.size());
      EXPECT_LE(report.groups, report.max_degree + 1);
      std::size_t splats = 0;
      for (const std::size_t size : report.sizes) splats += size;
      EXPECT_EQ(splats, cloud.size() - 3);
    }
  }
}

TEST(GroupBlocks, OneBlockIsTheWholeCloud) {
  const SurfelCloud cloud = uneven_cloud();
  const Array<std::uint16_t> whole = make_groups(cloud, {});
  const auto group = groups_of(OrderedCloud(cloud), {}, cloud.size());
  EXPECT_TRUE(std::equal(whole.begin(), whole.end(), group.begin(), group.end()));
}

TEST(GroupBlocks, TheResultDoesNotDependOnThreads) {
  const SurfelCloud cloud = uneven_cloud();
  const OrderedCloud ranges(cloud);
  set_thread_count(1);
  const auto one = groups_of(ranges, {}, 300);
  set_thread_count(3);
  EXPECT_EQ(groups_of(ranges, {}, 300), one);
  set_thread_count(0);
}

TEST(GroupBlocks, ManySplatsAreGroupedByBlocksInMemory) {
  const SurfelCloud cloud = test::sphere_cloud(kMostGroupedAtOnce + 500, 2);
  GroupingReport report;
  const Array<std::uint16_t> group = make_groups(cloud, {}, &report);
  const auto ordered = groups_of(OrderedCloud(cloud), {}, kGroupBlock);
  const Array<std::uint32_t> order = morton_order(cloud.position);
  for (std::size_t i = 0; i < order.size(); ++i) ASSERT_EQ(group[order[i]], ordered[i]);
}

TEST(GroupBlocks, RefusesWhatHasNoGroups) {
  SurfelCloud cloud = test::sphere_cloud(50, 4);
  EXPECT_THROW(groups_of(OrderedCloud(cloud), {.groups = 3}, 10), Error);
  for (float& variance : cloud.variance) variance = 0;
  EXPECT_THROW(groups_of(OrderedCloud(cloud), {}, 10), Error);
  cloud.variance = {};
  EXPECT_THROW(groups_of(OrderedCloud(cloud), {}, 10), Error);
}

TEST(GroupBlocks, GoOnWhereTheyWereInterrupted) {
  const SurfelCloud cloud = uneven_cloud();
  const OrderedCloud ranges(cloud);
  GroupingReport whole;
  const auto group = groups_of(ranges, {}, 300, &whole);
  test::InterruptedWork work;
  GroupingReport report;
  const int runs = work.complete([&] {
    group_by_blocks(ranges, {}, work, &report, "cloud", {.most = 300, .checkpoints = &work});
  });
  EXPECT_EQ(runs, static_cast<int>(work.blocks().size()) + 1);
  EXPECT_GT(runs, 12);
  for (const auto& [at, block] : work.blocks()) {
    EXPECT_TRUE(std::equal(block.group.begin(), block.group.end(),
                           group.begin() + static_cast<std::ptrdiff_t>(at)));
  }
  EXPECT_EQ(report.sizes, whole.sizes);
  EXPECT_EQ(report.edges, whole.edges);
  EXPECT_EQ(report.max_degree, whole.max_degree);
  EXPECT_EQ(report.unusable, whole.unusable);
}

}  // namespace
}  // namespace surfel
