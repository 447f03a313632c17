#include <cmath>
#include <numbers>

#include <gtest/gtest.h>
#include <surfel/base/random.h>
#include <surfel/sp06/least_overlap.h>

#include "sp06/clouds.h"

namespace surfel {
namespace {

TEST(LensArea, IsThatOfClosedForms) {
  EXPECT_EQ(lens_area(1, 2, 3), 0);
  EXPECT_EQ(lens_area(1, 2, 5), 0);
  EXPECT_DOUBLE_EQ(lens_area(1, 2, 0.5), std::numbers::pi);
  EXPECT_DOUBLE_EQ(lens_area(2, 1, 1), std::numbers::pi);
  EXPECT_DOUBLE_EQ(lens_area(1, 1, 0), std::numbers::pi);
  // Equal discs through each other's centres.
  EXPECT_NEAR(lens_area(1, 1, 1), 2 * std::numbers::pi / 3 - std::sqrt(3.0) / 2, 1e-14);
  // The small one's centre on the large one's rim: nearly half of it.
  EXPECT_NEAR(lens_area(1e-3, 1, 1), std::numbers::pi / 2 * 1e-6, 1e-9);
  EXPECT_DOUBLE_EQ(lens_area(1e-6, 1e3, 1e3), lens_area(1e3, 1e-6, 1e3));
}

TEST(LensArea, IsTheIntegralOfItsSlope) {
  // d A / d distance = - the length of the lens' chord.
  constexpr double kA = 0.7;
  constexpr double kB = 1.1;
  constexpr double kStep = 1e-5;
  for (double d = 0.45; d < 1.75; d += 0.1) {
    const double foot = (d * d + kA * kA - kB * kB) / (2 * d);
    const double chord = 2 * std::sqrt(kA * kA - foot * foot);
    const double slope =
        (lens_area(kA, kB, d + kStep) - lens_area(kA, kB, d - kStep)) / (2 * kStep);
    EXPECT_NEAR(slope, -chord, 1e-6) << d;
  }
}

struct Groups {
  SurfelCloud cloud;
  OverlapGraph graph;
  Coloring coloring;
  LeastOverlapReport report;

  Groups(SurfelCloud splats, std::uint32_t count) : cloud(std::move(splats)) {
    graph = make_overlap_graph(cloud, {});
    coloring = least_overlap_groups(
        cloud, graph, 1, coloring_order(graph, ColoringOrder::kLargestFirst), count, &report);
  }
  /// What splat v would share with the splats of group g.
  double overlap(std::uint32_t v, std::uint32_t g) const {
    double sum = 0;
    for (const std::uint32_t w : graph.neighbors(v)) {
      if (coloring.color[w] != g) continue;
      const std::uint32_t i = graph.splat[v];
      const std::uint32_t j = graph.splat[w];
      sum += lens_area(splat_radius(cloud, i, 1), splat_radius(cloud, j, 1),
                       (cloud.position[i] - cloud.position[j]).cast<double>().norm());
    }
    return sum;
  }
};

TEST(LeastOverlap, NoSplatWouldOverlapLessElsewhere) {
  const Groups groups(test::sphere_cloud(3000, 17), 4);
  double total = 0;
  for (std::uint32_t v = 0; v < groups.graph.size(); ++v) {
    const double here = groups.overlap(v, groups.coloring.color[v]);
    for (std::uint32_t g = 0; g < 4; ++g) {
      ASSERT_LE(here, groups.overlap(v, g) * (1 + 1e-4) + 1e-9) << v;
    }
    total += here / 2;
  }
  EXPECT_NEAR(groups.report.overlap_area, total, 1e-4 * total);
  double discs = 0;
  for (const float variance : groups.cloud.variance) discs += 2 * std::numbers::pi * variance;
  EXPECT_NEAR(groups.report.disc_area, discs, 1e-5 * discs);
  EXPECT_LT(groups.report.overlap_area, groups.report.placed_overlap_area);
  EXPECT_EQ(groups.report.moved_last, 0U);
  EXPECT_GT(groups.report.overlapping_pairs, 0U);
}

TEST(LeastOverlap, MoreGroupsOverlapLessAndEnoughNotAtAll) {
  double before = std::numeric_limits<double>::infinity();
  for (const std::uint32_t count : {1U, 2U, 4U, 8U, 40U}) {
    const Groups groups(test::sphere_cloud(1000, 12), count);
    EXPECT_LT(groups.report.overlap_area, before) << count;
    before = groups.report.overlap_area;
  }
  EXPECT_EQ(before, 0);
}

TEST(LeastOverlap, SpreadsSplatsThatOverlapNothing) {
  SurfelCloud cloud;
  for (int i = 0; i < 30; ++i) test::add_splat(cloud, {3.0 * i, 0, 0}, {0, 0, 1}, 1);
  const Groups groups(std::move(cloud), 3);
  for (std::uint16_t g = 0; g < 3; ++g) {
    EXPECT_EQ(std::count(groups.coloring.color.begin(), groups.coloring.color.end(), g), 10);
  }
}

TEST(LeastOverlap, CoincidentSplatsAreDealtOut) {
  const Groups groups(test::coincident_cloud(40), 4);
  for (std::uint16_t g = 0; g < 4; ++g) {
    EXPECT_EQ(std::count(groups.coloring.color.begin(), groups.coloring.color.end(), g), 10);
  }
}

}  // namespace
}  // namespace surfel
