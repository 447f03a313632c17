// Levels of detail in files: written, read, and refused where the tree lies.

#include <cmath>
#include <functional>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/tree_records.h>

#include "support/run_tool.h"

namespace surfel::test {
namespace {

/// Two clusters of three surfels under a root of two.
SurfelCloud small_tree() {
  SurfelCloud cloud;
  for (int i = 0; i < 8; ++i) {
    cloud.position.push_back({static_cast<float>(i), 1, 2});
    cloud.variance.push_back(1);
    cloud.level.push_back(i < 2 ? 1 : 0);
  }
  const auto cluster = [&](std::uint32_t begin, std::uint32_t end, std::uint8_t level) {
    TreeCluster c;
    c.begin = begin;
    c.end = end;
    c.level = level;
    c.spacing = 1.5F;
    c.bounds = {{2.5F, 1, 2}, 4, 1, {0, 0, 1}, 0.25F};
    c.reach_min = {static_cast<float>(begin) - 1, 0, 1};
    c.reach_max = {static_cast<float>(end), 2, 3};
    cloud.tree.push_back(c);
  };
  cluster(0, 2, 1);
  cluster(2, 5, 0);
  cluster(5, 8, 0);
  cloud.tree[0].first_child = 1;
  cloud.tree[0].child_count = 2;
  return cloud;
}

TEST(TreeProblem, IsNoneOfASoundTree) {
  EXPECT_EQ(tree_problem(small_tree().tree, 8), "");
  EXPECT_EQ(tree_problem({}, 8), "");
  EXPECT_EQ(first_leaf(small_tree().tree), 1U);
}

TEST(TreeProblem, NamesEveryLie) {
  const std::vector<std::function<void(ClusterTree&)>> lies = {
      [](ClusterTree& t) { t[0].first_child = 0; },            // a cycle
      [](ClusterTree& t) { t[0].first_child = 2; },            // past the end
      [](ClusterTree& t) { t[0].child_count = 3; },            // past the end
      [](ClusterTree& t) { t[0].child_count = 4000000000U; },  // and around
      [](ClusterTree& t) { t[0].child_count = 1; },            // an orphan
      [](ClusterTree& t) { t[0].child_count = 0; },            // a leaf above level 0
      [](ClusterTree& t) { t[2].child_count = 1; },            // a parent of level 0
      [](ClusterTree& t) { t[1].level = 1; },                  // a child of its own level
      [](ClusterTree& t) { t[0].level = 2; },                  // a gap
      [](ClusterTree& t) { t[1].begin = 3; },                  // a surfel of nobody's
      [](ClusterTree& t) { t[1].begin = 1; },                  // a surfel drawn twice
      [](ClusterTree& t) { t[1].end = t[1].begin; },           // an empty cluster
      [](ClusterTree& t) { t[2].end = 9; },                    // past the surfels
      [](ClusterTree& t) { t[2].end = 7; },                    // short of them
      [](ClusterTree& t) { t[0].end = 4000000000U; },
      [](ClusterTree& t) { t[1].bounds.radius = -1; },
      [](ClusterTree& t) { t[1].bounds.radius = NAN; },
      [](ClusterTree& t) { t[1].bounds.max_deviation = INFINITY; },
      [](ClusterTree& t) { t[1].bounds.center.x() = NAN; },
      [](ClusterTree& t) { t[1].bounds.cone_axis.x() = NAN; },
      [](ClusterTree& t) { t[1].bounds.cone_cosine = NAN; },
      [](ClusterTree& t) { t[1].spacing = NAN; },
      [](ClusterTree& t) { t[1].reach_min.y() = NAN; },
      [](ClusterTree& t) { t[1].reach_max.z() = INFINITY; },
      [](ClusterTree& t) { t[1].reach_max.x() = t[1].reach_min.x() - 1; },
      [](ClusterTree& t) { t.pop_back(); }};
  const TemporaryFolder folder;
  for (std::size_t i = 0; i < lies.size(); ++i) {
    SurfelCloud cloud = small_tree();
    lies[i](cloud.tree);
    EXPECT_NE(tree_problem(cloud.tree, cloud.size()), "") << i;
    EXPECT_THROW(write_cloud(cloud, folder / "lie.ply"), Error) << i;
  }
  // A cluster of more than are drawn at a time.
  ClusterTree wide(1);
  wide[0].end = kClusterSurfels + 1;
  EXPECT_NE(tree_problem(wide, kClusterSurfels + 1), "");
}

TEST(TreeRecords, ReadBackAsWritten) {
  const TemporaryFolder folder;
  SurfelCloud cloud = small_tree();
  for (const bool far : {false, true}) {
    if (far) cloud.origin = Vec3d(500000.125, 5000000, -300000);
    for (const bool ascii : {false, true}) {
      const std::string file = folder / "tree.ply";
      write_cloud(cloud, file, {.ascii = ascii});
      const SurfelCloud all = read_cloud(file, {.levels = true});
      ASSERT_EQ(all.size(), 8U);
      EXPECT_EQ(all.level, cloud.level);
      EXPECT_EQ(all.coarser_skipped, 0U);
      ASSERT_EQ(all.tree.size(), cloud.tree.size());
      for (std::size_t i = 0; i < all.tree.size(); ++i) {
        const TreeCluster& a = cloud.tree[i];
        const TreeCluster& b = all.tree[i];
        EXPECT_EQ(a.begin, b.begin);
        EXPECT_EQ(a.end, b.end);
        EXPECT_EQ(a.first_child, b.first_child);
        EXPECT_EQ(a.child_count, b.child_count);
        EXPECT_EQ(a.level, b.level);
        EXPECT_EQ(a.spacing, b.spacing);
        EXPECT_EQ(a.bounds.radius, b.bounds.radius);
        EXPECT_EQ(a.bounds.max_deviation, b.bounds.max_deviation);
        EXPECT_EQ(a.bounds.cone_axis, b.bounds.cone_axis);
        EXPECT_EQ(a.bounds.cone_cosine, b.bounds.cone_cosine);
        const auto moved = [&](const Vec3f& from, const Vec3f& to) {
          return (cloud.origin + from.cast<double>() - all.origin - to.cast<double>()).norm();
        };
        EXPECT_LT(moved(a.bounds.center, b.bounds.center), 1e-5);
        EXPECT_LT(moved(a.reach_min, b.reach_min), 1e-5);
        EXPECT_LT(moved(a.reach_max, b.reach_max), 1e-5);
      }
      // Who does not ask for levels has the finest alone.
      const SurfelCloud finest = read_cloud(file);
      EXPECT_EQ(finest.size(), 6U);
      EXPECT_EQ(finest.coarser_skipped, 2U);
      EXPECT_TRUE(finest.level.empty());
      EXPECT_TRUE(finest.tree.empty());
      EXPECT_EQ(finest.world(0), cloud.world(2));
      EXPECT_EQ(finest.world(5), cloud.world(7));
    }
  }
}

TEST(TreeRecords, AreKeptInPlyOnly) {
  const TemporaryFolder folder;
  EXPECT_THROW(write_cloud(small_tree(), folder / "tree.pcd"), Error);
  EXPECT_TRUE(small_tree().gathered({7, 6, 5}).tree.empty());
}

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

TEST(TreeRecords, BrokenFilesAreRefusedWithTheirName) {
  const TemporaryFolder folder;
  const std::string file = folder / "tree.ply";
  write_cloud(small_tree(), file, {.ascii = true});
  const std::string text = read_text(file);
  // The root's line: begin count first_child child_count level ...
  const std::string root = "0 2 1 2 1 2.5 ";
  const std::string box = " 0.25 -1 0 1 2 2 3";  // ... cone_cosine, its last values.
  const std::pair<std::string, std::string> edits[] = {
      {root, "0 2 0 2 1 2.5 "},
      {root, "0 2 1 9 1 2.5 "},
      {root, "0 2 1 2 300 2.5 "},
      {root, "0 2 1 2 1 nan "},
      {root, "0 2 1 2 1 1e300 "},
      {box, " 0.25 nan 0 1 2 2 3"},
      {box, " 0.25 5 0 1 2 2 3"},
      {box, " 0.25 -1 0 1 2 2 1e300"},
      {"property uint begin", "property uint start"},
      {"property uchar level\nproperty double x", "property int level\nproperty double x"},
      {"element surfel_cluster 3", "element surfel_cluster 2"},
      {"element surfel_cluster 3", "element surfel_cluster 4"},
      {"element surfel_cluster 3", "element surfel_cluster 0"},
      {"property uint first_child", "property list uchar uint first_child"}};
  for (const auto& [from, to] : edits) {
    std::string broken = replaced(text, from, to);
    if (to.starts_with("property int level")) broken = replaced(broken, root, "0 2 1 2 -1 2.5 ");
    write_text(file, broken);
    for (const bool levels : {false, true}) {
      try {
        read_cloud(file, {.levels = levels});
        ADD_FAILURE() << to;
      } catch (const Error& error) {
        EXPECT_NE(std::string(error.what()).find("tree.ply"), std::string::npos) << error.what();
      }
    }
  }
}

}  // namespace
}  // namespace surfel::test
