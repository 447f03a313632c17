#include <cmath>
#include <limits>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/sp06/overlap_graph.h>

#include "sp06/clouds.h"

namespace surfel {
namespace {

using test::add_splat;
using test::edges_of;
using test::overlapping_pairs;
using test::Pair;

TEST(OverlapOptions, DefaultsAreValidAndBadValuesAreNot) {
  EXPECT_TRUE(OverlapOptions().problems().empty());
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const double bad : {-1.0, nan, 1e9}) {
    EXPECT_EQ(OverlapOptions{.cutoff = bad}.problems().size(), 1U);
    EXPECT_EQ(OverlapOptions{.overlap = bad}.problems().size(), 1U);
    EXPECT_EQ(OverlapOptions{.coplanar_angle = bad}.problems().size(), 1U);
    EXPECT_EQ(OverlapOptions{.coplanar_color = bad}.problems().size(), 1U);
  }
  EXPECT_THROW(make_overlap_graph(test::plane_cloud(4, 1), {.cutoff = 0}), Error);
}

TEST(SplatRadius, IsWhereBetaReachesTheCutoff) {
  SurfelCloud cloud;
  add_splat(cloud, {0, 0, 0}, {0, 0, 1}, 3);
  EXPECT_FLOAT_EQ(splat_radius(cloud, 0, 1), 3.0F);
  EXPECT_FLOAT_EQ(splat_radius(cloud, 0, 4), 6.0F);
  cloud.tangent.assign(1, Vec3f(1, 0, 0));
  cloud.variance_u.assign(1, 0.5F);
  cloud.variance_v.assign(1, 2.0F);
  EXPECT_FLOAT_EQ(splat_radius(cloud, 0, 1), 2.0F);
  cloud.variance_u[0] = -1;
  EXPECT_EQ(splat_radius(cloud, 0, 1), 0.0F);
}

TEST(OverlapGraph, HasTheEdgesOfBruteForce) {
  const SurfelCloud cloud = test::sphere_cloud(2000, 20);
  for (const double overlap : {1.0, 0.4, 2.0, 0.0}) {
    for (const double cutoff : {1.0, 0.5}) {
      const OverlapGraph graph = make_overlap_graph(cloud, {.cutoff = cutoff, .overlap = overlap});
      const std::vector<Pair> expected = overlapping_pairs(cloud, cutoff, overlap);
      EXPECT_EQ(edges_of(graph), expected) << overlap;
      EXPECT_EQ(graph.edges(), expected.size());
    }
  }
}

TEST(OverlapGraph, HasTheEdgesOfBruteForceForRadiiOfNineDecades) {
  const SurfelCloud cloud = test::cloud_of_all_radii(2500);
  const OverlapGraph graph = make_overlap_graph(cloud, {});
  const std::vector<Pair> expected = overlapping_pairs(cloud, 1, 1);
  EXPECT_GT(expected.size(), 100000U);
  EXPECT_EQ(edges_of(graph), expected);
}

TEST(OverlapGraph, HugeRadiiDoNotMakeSmallOnesSlow) {
  // A hundred splats of radius 1000, far above 30 thousand of radius 0.01: if the search looked at
  // every small one wherever it shares a box with a large one, this would take minutes.
  SurfelCloud cloud = test::plane_cloud(30000, 12);
  for (int i = 0; i < 100; ++i) {
    add_splat(cloud, {i * 1e-3, 0.5, 1500 + 1e4 * i}, {0, 0, 1}, 1000);
  }
  const OverlapGraph graph = make_overlap_graph(cloud, {});
  EXPECT_LT(graph.mean_degree(), 14);
  EXPECT_GT(graph.mean_degree(), 10);
}

TEST(OverlapGraph, RowsAreAscendingAndSymmetric) {
  const OverlapGraph graph = make_overlap_graph(test::sphere_cloud(1000, 15), {});
  for (std::uint32_t v = 0; v < graph.size(); ++v) {
    const auto row = graph.neighbors(v);
    EXPECT_TRUE(std::is_sorted(row.begin(), row.end(), std::less_equal<>()));
    for (const std::uint32_t w : row) {
      EXPECT_NE(w, v);
      const auto other = graph.neighbors(w);
      EXPECT_TRUE(std::binary_search(other.begin(), other.end(), v));
    }
  }
}

TEST(OverlapGraph, TouchingDiscsDoNotOverlap) {
  SurfelCloud cloud;
  for (int i = 0; i < 3; ++i) add_splat(cloud, {2.0 * i, 0, 0}, {0, 0, 1}, 1);
  cloud.position[2].x() = std::nextafter(4.0F, 0.0F);
  EXPECT_EQ(edges_of(make_overlap_graph(cloud, {})), std::vector<Pair>({{1, 2}}));
}

TEST(OverlapGraph, KeepsExtremeScales) {
  for (const double scale : {1e-18, 1e-6, 1e6, 1e18}) {
    SurfelCloud cloud;
    for (int i = 0; i < 20; ++i) add_splat(cloud, {1.5 * i * scale, 0, 0}, {0, 0, 1}, scale);
    EXPECT_EQ(make_overlap_graph(cloud, {}).edges(), 19U) << scale;
  }
}

TEST(OverlapGraph, LeavesOutUnusableSplats) {
  SurfelCloud cloud = test::coincident_cloud(6);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  cloud.position[1].y() = nan;
  cloud.position[2].z() = std::numeric_limits<float>::infinity();
  cloud.variance[3] = 0;
  cloud.variance[4] = nan;
  const OverlapGraph graph = make_overlap_graph(cloud, {});
  EXPECT_EQ(graph.unusable, 4U);
  EXPECT_EQ(edges_of(graph), std::vector<Pair>({{0, 5}}));
  cloud.variance.assign(6, -1);
  EXPECT_THROW(make_overlap_graph(cloud, {}), Error);
  cloud.variance.clear();
  EXPECT_THROW(make_overlap_graph(cloud, {}), Error);
  EXPECT_THROW(make_overlap_graph(SurfelCloud(), {}), Error);
}

TEST(OverlapGraph, OfOneSplatHasNoEdge) {
  const OverlapGraph graph = make_overlap_graph(test::coincident_cloud(1), {});
  EXPECT_EQ(graph.size(), 1U);
  EXPECT_EQ(graph.edges(), 0U);
  EXPECT_EQ(graph.max_degree(), 0U);
}

TEST(OverlapGraph, RefusesMoreEdgesThanMemoryHolds) {
  const SurfelCloud cloud = test::coincident_cloud(3000);
  EXPECT_EQ(make_overlap_graph(cloud, {}).edges(), 3000U * 2999 / 2);
  try {
    make_overlap_graph(cloud, {.max_memory = 1 << 20}, nullptr, "one_place.ply");
    FAIL() << "not refused";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kInput);
    EXPECT_NE(std::string(error.what()).find("one_place.ply: "), std::string::npos);
    EXPECT_NE(std::string(error.what()).find("`max_memory`"), std::string::npos);
  }
}

TEST(OverlapGraph, RefusesHopelessInputBeforeMemoryIsFull) {
  // A sample tells; making these edges would take gigabytes and a minute.
  EXPECT_THROW(make_overlap_graph(test::coincident_cloud(200000), {.max_memory = 1 << 30}), Error);
}

TEST(OverlapGraph, PairsAreBoundedByTheNumberOfSplats) {
  // Each would have more than a billion of pairs, of which a relaxation takes out all.
  const SurfelCloud cloud = test::coincident_cloud(50000);
  EXPECT_THROW(make_overlap_graph(cloud, {}), Error);
  EXPECT_THROW(make_overlap_graph(cloud, {.relax_coplanar = true}), Error);
  EXPECT_GT(make_overlap_graph(test::sphere_cloud(20000, 100), {}).mean_degree(), 80);
}

TEST(OverlapGraph, OneSplatOverAllOthersIsNotHopeless) {
  SurfelCloud cloud = test::plane_cloud(4000, 5);
  add_splat(cloud, {0.5, 0.5, 0}, {0, 0, 1}, 10);
  const OverlapGraph graph = make_overlap_graph(cloud, {.max_memory = 1 << 20});
  EXPECT_EQ(graph.max_degree(), 4000U);
}

TEST(OverlapGraph, OppositeNormalsAreRelaxed) {
  SurfelCloud cloud = test::coincident_cloud(4);
  cloud.normal[1] = {0, 0, -1};
  cloud.normal[2] = {1, 0, 0};  // At right angles to both: not opposite.
  cloud.normal[3] = {0, 0, 0};  // Unknown.
  EXPECT_EQ(make_overlap_graph(cloud, {}).edges(), 6U);
  EXPECT_EQ(edges_of(make_overlap_graph(cloud, {.relax_opposite = true})),
            std::vector<Pair>({{0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}}));
}

/// Whether two overlapping splats, the second one changed, keep their edge with relaxation 1.
bool coplanar_edge(const Vec3d& position, const Vec3d& normal, float red, float alpha,
                   std::uint16_t material) {
  SurfelCloud cloud;
  add_splat(cloud, {0, 0, 0}, {0, 0, 1}, 1);
  add_splat(cloud, position, normal, 1);
  cloud.color = {Vec3f(0.5F, 0.5F, 0.5F), Vec3f(red, 0.5F, 0.5F)};
  cloud.alpha = {1.0F, alpha};
  cloud.material = {7, material};
  const OverlapOptions options{.relax_coplanar = true};
  return make_overlap_graph(cloud, options).edges() == 1;
}

TEST(OverlapGraph, CoplanarSplatsOfOneLookAreRelaxed) {
  const auto tilted = [](double degrees) {
    const double angle = degrees * std::numbers::pi / 180;
    return Vec3d(std::sin(angle), 0, std::cos(angle));
  };
  const Vec3d beside(1, 0, 0);
  EXPECT_FALSE(coplanar_edge(beside, tilted(0), 0.5F, 1, 7));
  EXPECT_FALSE(coplanar_edge(beside, tilted(2.9), 0.51F, 0.99F, 7));
  EXPECT_FALSE(coplanar_edge({0, 0, 0}, tilted(0), 0.5F, 1, 7));
  EXPECT_TRUE(coplanar_edge(beside, tilted(3.1), 0.5F, 1, 7));
  EXPECT_TRUE(coplanar_edge({1, 0, 0.06}, tilted(0), 0.5F, 1, 7));
  EXPECT_TRUE(coplanar_edge(beside, tilted(180), 0.5F, 1, 7));
  EXPECT_TRUE(coplanar_edge(beside, {0, 0, 0}, 0.5F, 1, 7));
  EXPECT_TRUE(coplanar_edge(beside, tilted(0), 0.53F, 1, 7));
  EXPECT_TRUE(coplanar_edge(beside, tilted(0), 0.5F, 0.9F, 7));
  EXPECT_TRUE(coplanar_edge(beside, tilted(0), 0.5F, 1, 8));
}

TEST(OverlapGraph, IsTheSameForAnyNumberOfThreadsAndOrderOfTheSplats) {
  const SurfelCloud cloud = test::sphere_cloud(6000, 12);
  const OverlapGraph graph = make_overlap_graph(cloud, {});
  for (const int threads : {1, 2, 5}) {
    set_thread_count(threads);
    const OverlapGraph again = make_overlap_graph(cloud, {});
    EXPECT_EQ(again.splat, graph.splat);
    EXPECT_EQ(again.row_begin, graph.row_begin);
    EXPECT_EQ(again.neighbor, graph.neighbor);
  }
  set_thread_count(0);
  Array<std::uint32_t> reversed(cloud.size());
  for (std::uint32_t i = 0; i < cloud.size(); ++i) {
    reversed[i] = static_cast<std::uint32_t>(cloud.size()) - 1 - i;
  }
  const OverlapGraph other = make_overlap_graph(cloud.gathered(reversed), {});
  EXPECT_EQ(other.neighbor, graph.neighbor);
}

}  // namespace
}  // namespace surfel
