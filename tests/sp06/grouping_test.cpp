#include <cmath>
#include <limits>
#include <numeric>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/sp06/grouping.h>

#include "sp06/clouds.h"

namespace surfel {
namespace {

TEST(GroupingOptions, DefaultsAreValidAndBadValuesAreNot) {
  EXPECT_TRUE(GroupingOptions().problems().empty());
  EXPECT_EQ(GroupingOptions{.groups = -1}.problems().size(), 1U);
  EXPECT_EQ(GroupingOptions{.groups = 65536}.problems().size(), 1U);
  EXPECT_EQ((GroupingOptions{.overlap = {.cutoff = 0}, .groups = -1}.problems().size()), 2U);
}

TEST(Grouping, NoTwoSplatsOfAGroupOverlapButByARelaxation) {
  SurfelCloud cloud = test::sphere_cloud(test::kManySplats, 18);
  for (std::size_t i = 0; i < cloud.size(); i += 3) cloud.normal[i] = -cloud.normal[i];
  const std::vector<test::Pair> pairs = test::overlapping_pairs(cloud, 1, 1);
  ASSERT_GT(pairs.size(), cloud.size() * 8);
  for (const ColoringOrder order : test::kColoringOrders) {
    for (const double overlap : {1.0, 0.6}) {
      for (const bool opposite : {false, true}) {
        for (const bool coplanar : {false, true}) {
          GroupingOptions options{.overlap = {.overlap = overlap,
                                              .relax_coplanar = coplanar,
                                              .coplanar_angle = 2,
                                              .relax_opposite = opposite},
                                  .order = order};
          GroupingReport report;
          const Array<std::uint16_t> group = make_groups(cloud, options, &report);
          ASSERT_LE(report.groups, report.max_degree + 1);
          std::size_t relaxed = 0;
          for (const auto& [i, j] : pairs) {
            if (group[i] != group[j]) continue;
            const Vec3d d = cloud.position[j].cast<double>() - cloud.position[i].cast<double>();
            const double reach = overlap * (static_cast<double>(splat_radius(cloud, i, 1)) +
                                            static_cast<double>(splat_radius(cloud, j, 1)));
            if (d.norm() >= reach) continue;
            ++relaxed;
            const double cosine =
                cloud.normal[i].cast<double>().dot(cloud.normal[j].cast<double>());
            const bool by_opposite = opposite && cosine < 0;
            // Neighbours on a sphere: the normals say it all.
            const bool by_coplanar = coplanar && cosine > std::cos(2.0001 * std::numbers::pi / 180);
            ASSERT_TRUE(by_opposite || by_coplanar) << i << " " << j;
          }
          ASSERT_EQ(relaxed > 0, opposite || coplanar);
        }
      }
    }
  }
}

TEST(Grouping, ReportsWhatIsThere) {
  SurfelCloud cloud = test::sphere_cloud(1000, 10);
  cloud.position[17].x() = std::numeric_limits<float>::quiet_NaN();
  cloud.group_radius.assign(1000, 1.0F);
  GroupingReport report;
  group_splats(cloud, {}, &report);
  EXPECT_EQ(cloud.group.size(), 1000U);
  EXPECT_EQ(cloud.group[17], 0);
  EXPECT_TRUE(cloud.group_radius.empty());
  EXPECT_EQ(report.splats, 1000U);
  EXPECT_EQ(report.unusable, 1U);
  EXPECT_EQ(report.sizes.size(), report.groups);
  EXPECT_EQ(std::accumulate(report.sizes.begin(), report.sizes.end(), std::size_t{0}), 999U);
  EXPECT_DOUBLE_EQ(report.mean_degree, 2.0 * static_cast<double>(report.edges) / 999);
  EXPECT_GT(report.max_degree, report.mean_degree);
  EXPECT_EQ(report.edges, test::overlapping_pairs(cloud, 1, 1).size());
  EXPECT_FALSE(report.overlap.has_value());
}

TEST(Grouping, FewerGroupsForASmallerOverlap) {
  const SurfelCloud cloud = test::sphere_cloud(4000, 18);
  std::uint32_t before = std::numeric_limits<std::uint32_t>::max();
  for (const double overlap : {1.0, 0.8, 0.6, 0.4, 0.0}) {
    GroupingReport report;
    make_groups(cloud, {.overlap = {.overlap = overlap}}, &report);
    EXPECT_LT(report.groups, before);
    before = report.groups;
  }
  EXPECT_EQ(before, 1U);
}

TEST(Grouping, IsTheSameForAnyNumberOfThreads) {
  const SurfelCloud cloud = test::sphere_cloud(5000, 18);
  for (const ColoringOrder order : test::kColoringOrders) {
    for (const int groups : {0, 4}) {
      const GroupingOptions options{.order = order, .groups = groups};
      const Array<std::uint16_t> first = make_groups(cloud, options);
      for (const int threads : {1, 2, 5}) {
        set_thread_count(threads);
        EXPECT_EQ(make_groups(cloud, options), first);
      }
      set_thread_count(0);
    }
  }
}

TEST(Grouping, OfShuffledSplatsIsTheSame) {
  const SurfelCloud cloud = test::sphere_cloud(2000, 18);
  Array<std::uint32_t> order(cloud.size());
  for (std::uint32_t i = 0; i < order.size(); ++i) order[i] = (i * 7 + 3) % 2000;
  const SurfelCloud shuffled = cloud.gathered(order);
  for (const ColoringOrder coloring : test::kColoringOrders) {
    const Array<std::uint16_t> group = make_groups(cloud, {.order = coloring});
    const Array<std::uint16_t> other = make_groups(shuffled, {.order = coloring});
    for (std::size_t i = 0; i < order.size(); ++i) ASSERT_EQ(other[i], group[order[i]]);
  }
}

TEST(Grouping, OfOneSplatAndOfSplatsInOnePlace) {
  GroupingReport report;
  EXPECT_EQ(make_groups(test::coincident_cloud(1), {}, &report), Array<std::uint16_t>{0});
  EXPECT_EQ(report.groups, 1U);
  make_groups(test::coincident_cloud(300), {}, &report);
  EXPECT_EQ(report.groups, 300U);
  EXPECT_EQ(report.max_degree, 299U);
}

}  // namespace
}  // namespace surfel
