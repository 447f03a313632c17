#include <algorithm>
#include <cmath>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/random.h>
#include <surfel/simplify/sheet_clusters.h>

namespace surfel {
namespace {

/// A jittered grid of n x n surfels of spacing 1, at a height.
void add_plane(SurfelCloud& cloud, int n, float height, const Vec3f& normal) {
  for (int i = 0; i < n * n; ++i) {
    const auto index = cloud.size();
    cloud.position.emplace_back(static_cast<float>(i % n + 0.4 * random_uniform(3, index, 0)),
                                static_cast<float>(i / n + 0.4 * random_uniform(3, index, 1)),
                                height);
    cloud.normal.push_back(normal);
    cloud.variance.push_back(0.5F);
    cloud.area.push_back(1);
  }
}

SheetClusters cluster(const SurfelCloud& cloud, float radius, std::size_t fill_to = 0,
                      std::uint64_t seed = 1, const SheetRules& rules = {}) {
  const auto search = make_neighbor_search(cloud.position);
  const Array<float> radii(cloud.size(), radius);
  return cluster_sheets(cloud, *search, radii, rules, seed, fill_to);
}

void expect_partition(const SheetClusters& clusters, std::size_t surfels) {
  std::vector<int> seen(surfels, 0);
  for (std::size_t c = 0; c < clusters.size(); ++c) {
    const auto members = clusters.members(c);
    EXPECT_TRUE(std::find(members.begin(), members.end(), clusters.seed[c]) != members.end());
    EXPECT_TRUE(std::is_sorted(members.begin(), members.end()));
    for (const std::uint32_t i : members) ++seen[i];
  }
  EXPECT_TRUE(std::all_of(seen.begin(), seen.end(), [](int n) { return n == 1; }));
}

TEST(SheetClusters, RefusesBadRules) {
  SurfelCloud cloud;
  add_plane(cloud, 2, 0, Vec3f::UnitZ());
  EXPECT_THROW(cluster(cloud, 1, 0, 1, {.normal_angle = 91}), Error);
  EXPECT_THROW(cluster(cloud, 1, 0, 1, {.sheet_weight = 0}), Error);
}

TEST(SheetClusters, SeedsKeepTheirDistanceAndEverySurfelIsNearItsSeed) {
  SurfelCloud cloud;
  add_plane(cloud, 40, 0, Vec3f::UnitZ());
  constexpr float kRadius = 3;
  const SheetClusters clusters = cluster(cloud, kRadius);
  expect_partition(clusters, cloud.size());
  // A saturated set has 1.436 r^2 a sample (PoissonDisk).
  EXPECT_NEAR(static_cast<double>(clusters.size()), 1600 / (1.436 * 9), 25);
  for (std::size_t c = 0; c < clusters.size(); ++c) {
    const Vec3f& at = cloud.position[clusters.seed[c]];
    for (std::size_t d = 0; d < c; ++d) {
      EXPECT_GE((cloud.position[clusters.seed[d]] - at).norm(), kRadius);
    }
    for (const std::uint32_t i : clusters.members(c)) {
      const float own = (cloud.position[i] - at).norm();
      EXPECT_LE(own, kRadius);
      for (const std::uint32_t other : clusters.seed) {
        EXPECT_GE((cloud.position[i] - cloud.position[other]).norm(), own) << "not the nearest";
      }
    }
  }
}

TEST(SheetClusters, SheetsMaterialsAndUnknownNormalsStayApart) {
  SurfelCloud cloud;
  add_plane(cloud, 12, 0, Vec3f::UnitZ());
  add_plane(cloud, 12, 0.01F, -Vec3f::UnitZ());              // Back to back.
  add_plane(cloud, 12, 1.5F, Vec3f::UnitZ());                // A second layer.
  add_plane(cloud, 12, 0.02F, Vec3f(1, 0, 1).normalized());  // Turned by 45 degrees.
  cloud.normal[5].setZero();
  cloud.material.assign(cloud.size(), 0);
  for (std::size_t i = 0; i < 60; ++i) cloud.material[i] = 1;
  const SheetClusters clusters = cluster(cloud, 4);
  expect_partition(clusters, cloud.size());
  for (std::size_t c = 0; c < clusters.size(); ++c) {
    for (const std::uint32_t i : clusters.members(c)) {
      EXPECT_EQ(i / 144, clusters.seed[c] / 144) << "sheets were mixed";
      EXPECT_EQ(cloud.material[i], cloud.material[clusters.seed[c]]);
      EXPECT_TRUE(i != 5 || clusters.members(c).size() == 1);
    }
  }
  // With a larger angle the turned sheet is one with the first.
  const SheetClusters mixed = cluster(cloud, 4, 0, 1, {.normal_angle = 50});
  EXPECT_LT(mixed.size(), clusters.size());
}

TEST(SheetClusters, FillsUpToAnExactNumber) {
  SurfelCloud cloud;
  add_plane(cloud, 20, 0, Vec3f::UnitZ());
  const std::size_t least = cluster(cloud, 4).size();
  for (const std::size_t wanted : {least + 1, least + 30, cloud.size() - 1, cloud.size()}) {
    const SheetClusters clusters = cluster(cloud, 4, wanted);
    EXPECT_EQ(clusters.size(), wanted);
    expect_partition(clusters, cloud.size());
  }
  EXPECT_EQ(cluster(cloud, 4, 1).size(), least);
  EXPECT_EQ(cluster(cloud, 4, 10000).size(), cloud.size());
}

TEST(SheetClusters, CoincidentSurfelsAndNoRadiusAtAll) {
  SurfelCloud cloud;
  add_plane(cloud, 3, 0, Vec3f::UnitZ());
  for (Vec3f& p : cloud.position) p = Vec3f(1, 2, 3);
  EXPECT_EQ(cluster(cloud, 0.1F).size(), 1U);
  EXPECT_EQ(cluster(cloud, 0).size(), cloud.size());
  EXPECT_EQ(cluster(cloud, 0.1F, 4).size(), 4U);
  EXPECT_NE(cluster(cloud, 0.1F, 4, 1).seed, cluster(cloud, 0.1F, 4, 2).seed);
}

}  // namespace
}  // namespace surfel
