#include <algorithm>
#include <cmath>
#include <set>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/lod/surfel_partition.h>

#include "lod/merge_surfels.h"
#include "render/scenes.h"

namespace surfel::test {
namespace {

SurfelPartition partition(const std::vector<MergeSurfel>& surfels, std::size_t groups) {
  SurfelPartition parts;
  parts.run(surfels, groups, {});
  return parts;
}

/// Every surfel is in one group, and no group is empty.
void expect_partition(const SurfelPartition& parts, std::size_t surfels, std::size_t groups) {
  ASSERT_EQ(parts.size(), groups);
  std::vector<int> seen(surfels, 0);
  for (std::size_t g = 0; g < groups; ++g) {
    EXPECT_FALSE(parts.members(g).empty());
    for (const std::uint32_t i : parts.members(g)) ++seen.at(i);
  }
  EXPECT_EQ(std::count(seen.begin(), seen.end(), 1), static_cast<std::ptrdiff_t>(surfels));
}

TEST(SurfelPartition, RefusesBadRules) {
  const auto surfels = merge_surfels(jittered_plane(2, 1, 0));
  SurfelPartition parts;
  EXPECT_THROW(parts.run(surfels, 2, {.normal_angle = 0}), Error);
  EXPECT_THROW(parts.run(surfels, 2, {.sheet_weight = 0.5}), Error);
}

TEST(SurfelPartition, GivesAsManyGroupsAsAskedFor) {
  const auto surfels = merge_surfels(jittered_plane(12, 1, 0.35));
  for (const std::size_t groups : {1, 2, 36, 143, 144}) {
    expect_partition(partition(surfels, groups), 144, groups);
  }
  // Nothing tells these apart.
  const std::vector<MergeSurfel> alike(9, surfels[0]);
  for (const std::size_t groups : {1, 4, 9}) {
    expect_partition(partition(alike, groups), 9, groups);
  }
}

TEST(SurfelPartition, PiecesOfAPlaneAreAboutSquareAndAlike) {
  const auto surfels = merge_surfels(jittered_plane(32, 1, 0.35));
  const SurfelPartition parts = partition(surfels, 256);
  const double side = 2.0 / 16;
  std::size_t most = 0;
  for (std::size_t g = 0; g < parts.size(); ++g) {
    most = std::max(most, parts.members(g).size());
    EXPECT_LT(std::sqrt(parts.extent2(g)), 2 * side);
  }
  EXPECT_LE(most, 8U);
}

TEST(SurfelPartition, KeepsSheetsApart) {
  // Two sides of a wall, thinner than the spacing; two floors of the same direction.
  for (const float turned : {-1.0F, 1.0F}) {
    SurfelCloud cloud = jittered_plane(16, 1, 0.35);
    const SurfelCloud below = jittered_plane(16, 1, 0.35, 2, turned < 0 ? -0.02 : -0.2);
    for (std::size_t i = 0; i < below.size(); ++i) {
      add_surfel(cloud, below.position[i], turned * below.normal[i], below.variance[i],
                 below.area[i], below.coefficient[i]);
    }
    const SurfelPartition parts = partition(merge_surfels(cloud), 128);
    for (std::size_t g = 0; g < parts.size(); ++g) {
      std::set<bool> upper;
      for (const std::uint32_t i : parts.members(g)) upper.insert(i < 256);
      EXPECT_EQ(upper.size(), 1U) << g;
    }
  }
}

TEST(SurfelPartition, KeepsMaterialsAndSharpEdgesApart) {
  SurfelCloud cloud = jittered_plane(16, 1, 0);
  // A fold of 90 degrees along x = 0, and two materials that meet at y = 0.
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    Vec3f& p = cloud.position[i];
    cloud.material.push_back(p.y() < 0 ? 1 : 2);
    if (p.x() < 0) {
      cloud.normal[i] = Vec3f(-1, 0, 0);
      p = Vec3f(0, p.y(), p.x());
    }
  }
  const SurfelPartition parts = partition(merge_surfels(cloud), 64);
  for (std::size_t g = 0; g < parts.size(); ++g) {
    std::set<std::pair<float, int>> kinds;
    for (const std::uint32_t i : parts.members(g)) {
      kinds.insert({cloud.normal[i].x(), cloud.material[i]});
    }
    EXPECT_EQ(kinds.size(), 1U) << g;
  }
}

TEST(SurfelPartition, MergesEvenWhatItShouldNotWhereItMust) {
  SurfelCloud cloud = jittered_plane(8, 1, 0.35);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    cloud.material.push_back(static_cast<std::uint16_t>(i));
    cloud.normal[i] = Vec3f(static_cast<float>(random_uniform(4, i, 0)) - 0.5F,
                            static_cast<float>(random_uniform(4, i, 1)) - 0.5F,
                            static_cast<float>(random_uniform(4, i, 2)) - 0.5F)
                          .normalized();
  }
  expect_partition(partition(merge_surfels(cloud), 16), 64, 16);
}

}  // namespace
}  // namespace surfel::test
