#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>
#include <surfel/base/parallel.h>
#include <surfel/lod/gaussian_hierarchy.h>
#include <surfel/scene/gaussian_mass.h>

#include "gaussian/random_gaussians.h"
#include "support/message_of.h"

namespace surfel::test {
namespace {

double mass_of(const GaussianCloud& cloud, std::size_t begin, std::size_t end) {
  double sum = 0;
  for (std::size_t i = begin; i < end; ++i) {
    sum += double{cloud.amplitude[i]} * mean_projection(cloud.scale[i].cast<double>());
  }
  return sum;
}

TEST(GaussianHierarchy, HasSoundLevelsOfFewerAndFewer) {
  GaussianCloud cloud = random_gaussians(5000, 2, 1);
  for (float& a : cloud.amplitude) a = std::max(a, 0.02F);
  cloud.amplitude[17] = 0.001F;
  GaussianHierarchyReport report;
  const GaussianCloud out = build_gaussian_hierarchy(cloud, {.reduction = 3}, "cloud", &report);
  EXPECT_EQ(report.unseen, 1U);
  EXPECT_EQ(tree_problem(out.tree, out.size()), "");
  ASSERT_EQ(report.levels.size(), 4U);
  EXPECT_EQ(report.levels[0], 4999U);
  EXPECT_EQ(report.levels[1], 1667U);
  EXPECT_EQ(report.clusters, out.tree.size());
  EXPECT_EQ(out.tree.front().level, 3);
  EXPECT_EQ(report.spacing[0], 0);
  EXPECT_TRUE(std::is_sorted(report.spacing.begin(), report.spacing.end()));
  EXPECT_EQ(out.origin, cloud.origin);
  EXPECT_EQ(out.degree, 1);

  // The finest level is the cloud.
  const std::size_t finest = out.tree[first_leaf(out.tree)].begin;
  EXPECT_EQ(out.size() - finest, 4999U);
  std::vector<float> before;
  std::vector<float> after;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (i != 17) before.push_back(cloud.position[i].x() + cloud.amplitude[i]);
  }
  for (std::size_t i = finest; i < out.size(); ++i) {
    after.push_back(out.position[i].x() + out.amplitude[i]);
  }
  std::sort(before.begin(), before.end());
  std::sort(after.begin(), after.end());
  EXPECT_EQ(before, after);
}

TEST(GaussianHierarchy, BoundsHoldAllGaussiansBelow) {
  const GaussianCloud out = build_gaussian_hierarchy(random_gaussians(3000, 4));
  for (const TreeCluster& cluster : out.tree) {
    for (std::uint32_t i = cluster.begin; i < cluster.end; ++i) {
      EXPECT_LE((out.position[i] - cluster.bounds.center).norm(), cluster.bounds.radius * 1.0001F);
      EXPECT_LE(out.scale[i].maxCoeff(), cluster.bounds.max_deviation);
    }
    for (std::uint32_t k = 0; k < cluster.child_count; ++k) {
      const TreeCluster& child = out.tree[cluster.first_child + k];
      EXPECT_LE(child.bounds.max_deviation, cluster.bounds.max_deviation);
      EXPECT_TRUE((child.reach_min.array() >= cluster.reach_min.array()).all());
      EXPECT_TRUE((child.reach_max.array() <= cluster.reach_max.array()).all());
    }
  }
}

TEST(GaussianHierarchy, LevelsKeepTheMassOfHaze) {
  GaussianCloud cloud = random_gaussians(4000, 6, 0, 0.3);
  for (float& a : cloud.amplitude) a = 0.02F;
  const GaussianCloud out = build_gaussian_hierarchy(cloud);
  const std::size_t finest = out.tree[first_leaf(out.tree)].begin;
  const double mass = mass_of(out, finest, out.size());
  std::size_t begin = 0;
  for (std::size_t c = 1; c <= out.tree.size(); ++c) {
    if (c < out.tree.size() && out.tree[c].level == out.tree[c - 1].level) continue;
    const std::size_t end = out.tree[c - 1].end;
    EXPECT_NEAR(mass_of(out, begin, end) / mass, 1, 0.1) << "level " << int{out.tree[c - 1].level};
    begin = end;
  }
}

TEST(GaussianHierarchy, DoesNotDependOnTheThreads) {
  const GaussianCloud cloud = random_gaussians(3000, 8, 1);
  const GaussianCloud many = build_gaussian_hierarchy(cloud, {.reduction = 2});
  set_thread_count(1);
  const GaussianCloud one = build_gaussian_hierarchy(cloud, {.reduction = 2});
  set_thread_count(0);
  EXPECT_EQ(many.position, one.position);
  EXPECT_EQ(many.scale, one.scale);
  EXPECT_EQ(many.rotation, one.rotation);
  EXPECT_EQ(many.amplitude, one.amplitude);
  EXPECT_EQ(many.harmonics, one.harmonics);
  ASSERT_EQ(many.tree.size(), one.tree.size());
  for (std::size_t c = 0; c < one.tree.size(); ++c) {
    EXPECT_EQ(many.tree[c].spacing, one.tree[c].spacing);
  }
}

TEST(GaussianHierarchy, RefusesWhatHasNoSense) {
  GaussianCloud cloud = random_gaussians(10, 1);
  EXPECT_EQ(message_of([&] { build_gaussian_hierarchy(cloud, {.reduction = 1}); }),
            "`reduction` is 1; it must be in 2..16");
  EXPECT_EQ(build_gaussian_hierarchy(cloud).tree.size(), 1U);
  for (float& a : cloud.amplitude) a = 0;
  EXPECT_NE(
      message_of([&] { build_gaussian_hierarchy(cloud, {}, "a.ply"); }).find("a.ply: holds no"),
      std::string::npos);
  GaussianCloud vast = random_gaussians(2000, 5);
  for (Vec3f& s : vast.scale) s.setConstant(1e18F);
  EXPECT_TRUE(message_of([&] {
                build_gaussian_hierarchy(vast, {}, "a.ply");
              }).starts_with("a.ply: its extent is too large"));
}

}  // namespace
}  // namespace surfel::test
