#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/lod/hierarchy.h>

#include "render/scenes.h"

namespace surfel::test {
namespace {

/// Surfels below a cluster, of the finest level.
std::pair<std::uint32_t, std::uint32_t> finest_below(const ClusterTree& tree, std::size_t i) {
  std::size_t first = i;
  std::size_t last = i;
  while (tree[first].child_count > 0) first = tree[first].first_child;
  while (tree[last].child_count > 0) last = tree[last].first_child + tree[last].child_count - 1;
  return {tree[first].begin, tree[last].end};
}

template <class T>
bool same_bytes(const Array<T>& a, const Array<T>& b) {
  return a.size() == b.size() &&
         (a.empty() || std::memcmp(static_cast<const void*>(a.data()),
                                   static_cast<const void*>(b.data()), a.size() * sizeof(T)) == 0);
}

bool same_surfels(const SurfelCloud& a, const SurfelCloud& b) {
  std::vector<bool> same;
  same.push_back(same_bytes(a.position, b.position) && same_bytes(a.normal, b.normal));
  same.push_back(same_bytes(a.tangent, b.tangent) && same_bytes(a.variance_u, b.variance_u));
  same.push_back(same_bytes(a.variance_v, b.variance_v) && same_bytes(a.area, b.area));
  same.push_back(same_bytes(a.coefficient, b.coefficient) && same_bytes(a.level, b.level));
  return std::find(same.begin(), same.end(), false) == same.end();
}

TEST(Hierarchy, RefusesOptionsAndCloudsThatMeanNothing) {
  EXPECT_TRUE(HierarchyOptions{}.problems().empty());
  EXPECT_FALSE(HierarchyOptions{.reduction = 1}.problems().empty());
  EXPECT_FALSE(HierarchyOptions{.reduction = 17}.problems().empty());
  EXPECT_THROW(build_hierarchy(jittered_plane(4, 1, 0), {.reduction = 0}), Error);
  EXPECT_THROW(build_hierarchy(jittered_plane(4, 1, 0), {.sheets = {.normal_angle = 0}}), Error);
  EXPECT_THROW(build_hierarchy(SurfelCloud{}, {}), Error);
  SurfelCloud bare;
  bare.position.push_back({0, 0, 0});
  EXPECT_THROW(build_hierarchy(bare, {}), Error);
  SurfelCloud broken = jittered_plane(1, 1, 0);
  broken.variance[0] = NAN;
  EXPECT_THROW(build_hierarchy(broken, {}), Error);
}

TEST(Hierarchy, ReportTellsOfOneCloudHoweverOftenItIsUsed) {
  const SurfelCloud plane = jittered_plane(40, 1, 0.3);
  HierarchyReport once;
  build_hierarchy(plane, {}, &once);
  HierarchyReport twice = once;
  build_hierarchy(plane, {}, &twice);
  EXPECT_EQ(twice.levels, once.levels);
  EXPECT_EQ(twice.clusters, once.clusters);
}

TEST(Hierarchy, IsSoundForAnyCountAndReduction) {
  for (const int reduction : {2, 3, 4, 16}) {
    for (const int side : {1, 16, 17, 40, 73}) {
      const SurfelCloud cloud = jittered_plane(side, 1, 0.35);
      HierarchyReport report;
      const SurfelCloud lod = build_hierarchy(cloud, {.reduction = reduction}, &report);
      ASSERT_EQ(tree_problem(lod.tree, lod.size()), "") << side << ' ' << reduction;
      EXPECT_NO_THROW(lod.check_columns(""));
      EXPECT_EQ(report.levels.front(), cloud.size());
      EXPECT_EQ(std::accumulate(report.levels.begin(), report.levels.end(), std::size_t{0}),
                lod.size());
      EXPECT_EQ(report.levels.size(), lod.tree.front().level + 1U);
      for (std::size_t l = 1; l < report.levels.size(); ++l) {
        EXPECT_LE(report.levels[l], report.levels[l - 1] / reduction + lod.tree.size());
      }
      for (const TreeCluster& cluster : lod.tree) {
        for (std::uint32_t i = cluster.begin; i < cluster.end; ++i) {
          ASSERT_EQ(lod.level[i], cluster.level);
        }
      }
    }
  }
}

TEST(Hierarchy, HoldsTheOriginalSurfelsUnchanged) {
  SurfelCloud cloud = jittered_plane(40, 1, 0.35);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    cloud.source.push_back(static_cast<std::uint32_t>(i));
  }
  cloud.area.clear();
  const SurfelCloud lod = build_hierarchy(cloud, {});
  const std::size_t first = lod.tree[first_leaf(lod.tree)].begin;
  ASSERT_EQ(lod.size() - first, cloud.size());
  std::vector<bool> seen(cloud.size(), false);
  for (std::size_t i = first; i < lod.size(); ++i) {
    const std::uint32_t k = lod.source[i];
    EXPECT_FALSE(seen[k]);
    seen[k] = true;
    EXPECT_EQ(lod.position[i], cloud.position[k]);
    EXPECT_EQ(lod.normal[i], cloud.normal[k]);
    EXPECT_EQ(lod.coefficient[i], cloud.coefficient[k]);
    EXPECT_EQ(lod.variance_u[i], cloud.variance[k]);
    EXPECT_EQ(lod.variance_v[i], cloud.variance[k]);
    EXPECT_EQ(lod.area[i], cloud.variance[k]);  // what renderers take without the column
  }
}

TEST(Hierarchy, EveryLevelKeepsAreaAndLight) {
  for (const SurfelCloud& cloud : {jittered_plane(60, 1, 0.35), fibonacci_sphere(5000, 1)}) {
    SurfelCloud colored = cloud;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      colored.coefficient[i] =
          Vec3f(0.5F + 0.5F * cloud.position[i].x(), static_cast<float>(i % 2), 1);
    }
    const SurfelCloud lod = build_hierarchy(colored, {.reduction = 3});
    const std::size_t levels = lod.tree.front().level + 1U;
    std::vector<double> area(levels, 0);
    std::vector<Vec3d> light(levels, Vec3d::Zero());
    for (std::size_t i = 0; i < lod.size(); ++i) {
      area[lod.level[i]] += lod.area[i];
      light[lod.level[i]] += static_cast<double>(lod.area[i]) * lod.coefficient[i].cast<double>();
    }
    const bool flat = cloud.normal[0] == cloud.normal[1];
    // A curved piece covers less in projection; the coarsest of 200 surfels or so bend by 10
    // degrees.
    const double tolerance = flat ? 1e-4 : 0.03;
    for (std::size_t l = 1; l < levels; ++l) {
      EXPECT_NEAR(area[l] / area[0], 1, tolerance) << l;
      EXPECT_LT((light[l] / area[l] - light[0] / area[0]).norm(), tolerance) << l;
    }
  }
}

TEST(Hierarchy, SpacingGrowsWithTheRootOfTheReduction) {
  HierarchyReport report;
  build_hierarchy(jittered_plane(128, 1, 0.35), {.reduction = 4}, &report);
  for (std::size_t l = 2; l < report.spacing.size(); ++l) {
    EXPECT_NEAR(report.spacing[l] / report.spacing[l - 1], 2, 0.3) << l;
  }
}

TEST(Hierarchy, BoundsHoldEverythingBelow) {
  const SurfelCloud lod = build_hierarchy(fibonacci_sphere(6000, 2), {.reduction = 2});
  for (std::size_t c = 0; c < lod.tree.size(); ++c) {
    const TreeCluster& cluster = lod.tree[c];
    const ClusterBounds& bounds = cluster.bounds;
    const auto holds = [&](std::uint32_t i) {
      EXPECT_LE((lod.position[i] - bounds.center).norm(), bounds.radius) << c;
      EXPECT_LE(std::sqrt(lod.variance_u[i]), bounds.max_deviation * (1 + 1e-5F)) << c;
      // Merged surfels are widened to cover their areas.
      if (lod.level[i] > 0) {
        EXPECT_LE(std::sqrt(lod.area[i]), bounds.max_deviation * (1 + 1e-5F)) << c;
      }
      if (bounds.cone_cosine > 0) {
        EXPECT_GE(bounds.cone_axis.dot(lod.normal[i]), bounds.cone_cosine - 1e-5F) << c;
      }
    };
    for (std::uint32_t i = cluster.begin; i < cluster.end; ++i) holds(i);
    const auto [first, last] = finest_below(lod.tree, c);
    Vec3f reach_min = Vec3f::Constant(std::numeric_limits<float>::infinity());
    Vec3f reach_max = -reach_min;
    for (std::uint32_t i = first; i < last; ++i) {
      holds(i);
      const Vec3f reach = Vec3f::Constant(std::sqrt(lod.variance_u[i]));
      reach_min = reach_min.cwiseMin(lod.position[i] - reach);
      reach_max = reach_max.cwiseMax(lod.position[i] + reach);
    }
    EXPECT_EQ(cluster.reach_min, reach_min) << c;
    EXPECT_EQ(cluster.reach_max, reach_max) << c;
  }
  EXPECT_LT(lod.tree.front().bounds.cone_cosine, 0);  // a whole sphere has no cone
  EXPECT_GT(lod.tree.back().bounds.cone_cosine, 0.5F);
}

TEST(Hierarchy, DependsNeitherOnThreadsNorOnTheOrder) {
  const SurfelCloud cloud = jittered_plane(50, 1, 0.35);
  const SurfelCloud first = build_hierarchy(cloud, {});
  Array<std::uint32_t> order(cloud.size());
  std::iota(order.begin(), order.end(), 0U);
  for (std::size_t i = order.size(); i-- > 1;) {
    std::swap(order[i], order[random_bits(1, i) % (i + 1)]);
  }
  set_thread_count(3);
  const SurfelCloud other = build_hierarchy(cloud.gathered(order), {});
  set_thread_count(0);
  EXPECT_TRUE(same_surfels(first, other));
  ASSERT_EQ(first.tree.size(), other.tree.size());
  for (std::size_t c = 0; c < first.tree.size(); ++c) {
    EXPECT_EQ(first.tree[c].spacing, other.tree[c].spacing);
    EXPECT_EQ(first.tree[c].bounds.radius, other.tree[c].bounds.radius);
  }
}

TEST(Hierarchy, LeavesOutWhatCannotBeDrawn) {
  SurfelCloud cloud = jittered_plane(20, 1, 0.35);
  cloud.position[3].x() = INFINITY;
  cloud.variance[5] = -1;
  cloud.coefficient[7].y() = NAN;
  HierarchyReport report;
  const SurfelCloud lod = build_hierarchy(cloud, {}, &report);
  EXPECT_EQ(report.dropped.position, 1U);
  EXPECT_EQ(report.dropped.variance, 1U);
  EXPECT_EQ(report.dropped.color, 1U);
  EXPECT_EQ(report.levels.front(), 397U);
}

TEST(Hierarchy, CoincidentAndCollinearPointsHaveVariances) {
  for (const float step : {0.0F, 1.0F}) {
    SurfelCloud cloud;
    for (int i = 0; i < 1500; ++i) {
      add_surfel(cloud, {step * static_cast<float>(i), 0, 0}, {0, 0, 1}, 1e-12F, 1, {1, 1, 1});
    }
    const SurfelCloud lod = build_hierarchy(cloud, {});
    for (std::size_t i = 0; i < lod.size(); ++i) {
      EXPECT_GT(lod.variance_u[i], 0);
      EXPECT_GT(lod.variance_v[i], 0);
      EXPECT_TRUE(lod.position[i].allFinite());
    }
  }
}

}  // namespace
}  // namespace surfel::test
