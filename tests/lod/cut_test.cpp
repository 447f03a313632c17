#include <gtest/gtest.h>
#include <surfel/base/random.h>
#include <surfel/lod/cut.h>
#include <surfel/lod/hierarchy.h>

#include "render/scenes.h"

namespace surfel::test {
namespace {

ClusterTree tree_of(int side) {
  return build_hierarchy(jittered_plane(side, 1, 0.35), {.reduction = 2}).tree;
}

/// How often every cluster of the finest level is drawn, by itself or by one above it.
std::vector<int> times_drawn(const ClusterTree& tree, const std::vector<std::uint32_t>& drawn) {
  std::vector<int> times(tree.size(), 0);
  for (const std::uint32_t i : drawn) ++times[i];
  // In breadth-first order a cluster comes before its children.
  for (const TreeCluster& cluster : tree) {
    for (std::uint32_t k = 0; k < cluster.child_count; ++k) {
      times[cluster.first_child + k] += times[&cluster - tree.data()];
    }
  }
  times.erase(times.begin(), times.begin() + static_cast<std::ptrdiff_t>(first_leaf(tree)));
  return times;
}

TEST(CutTree, DrawsEverySurfelOnceWhateverIsRefined) {
  const ClusterTree tree = tree_of(100);
  ASSERT_GT(tree.front().level, 4);
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const auto drawn = cut_tree(tree, [&](std::uint32_t i) {
      return random_uniform(seed, i) < 0.6 ? CutStep::kRefine : CutStep::kDraw;
    });
    EXPECT_TRUE(std::is_sorted(drawn.begin(), drawn.end()));
    const std::vector<int> times = times_drawn(tree, drawn);
    EXPECT_EQ(times, std::vector<int>(times.size(), 1)) << seed;
  }
}

TEST(CutTree, LeavesOutWhatIsSkippedAndAllBelow) {
  const ClusterTree tree = tree_of(60);
  const std::uint32_t skipped = tree.front().first_child;
  const auto drawn = cut_tree(
      tree, [&](std::uint32_t i) { return i == skipped ? CutStep::kSkip : CutStep::kRefine; });
  const std::vector<int> times = times_drawn(tree, drawn);
  const std::vector<int> below = times_drawn(tree, {skipped});
  for (std::size_t i = 0; i < times.size(); ++i) EXPECT_EQ(times[i] + below[i], 1);
  EXPECT_TRUE(cut_tree({}, [](std::uint32_t) { return CutStep::kDraw; }).empty());
}

TEST(FineEnough, ComparesTheProjectedSpacing) {
  TreeCluster cluster;
  cluster.spacing = 0.5F;
  EXPECT_TRUE(fine_enough(cluster, 100, 100, false, 0.51F));
  EXPECT_FALSE(fine_enough(cluster, 100, 100, false, 0.49F));
  EXPECT_FALSE(fine_enough(cluster, 50, 100, false, 0.51F));
  // Of a parallel projection depth does not matter, and it may be behind the eye.
  EXPECT_TRUE(fine_enough(cluster, -7, 1, true, 0.51F));
  EXPECT_FALSE(fine_enough(cluster, 1000, 100, true, 0.51F));
  // What reaches the eye is never coarse.
  EXPECT_FALSE(fine_enough(cluster, 0, 1, false, 1e6F));
  EXPECT_FALSE(fine_enough(cluster, -1, 1, false, 1e6F));
}

TEST(CoveringVariance, FillsUpWhatTheFilterLacks) {
  EXPECT_EQ(covering_variance(1, 1), 0);
  EXPECT_EQ(covering_variance(0, 1), 0);
  // Spacing 1 in pieces `error` pixels long: V and the filter together are the spacing's square.
  for (const double error : {2.0, 5.0, 100.0}) {
    const double filter = std::pow(1.5 * kLongerSide / error, 2);
    EXPECT_NEAR(covering_variance(error, 1.5) + std::min(1.0, filter), 1, 1e-6);
  }
  EXPECT_NEAR(covering_variance(1, 1e-3), 1, 1e-5);
}

}  // namespace
}  // namespace surfel::test
