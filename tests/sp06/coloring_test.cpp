#include <numeric>
#include <set>

#include <boost/graph/compressed_sparse_row_graph.hpp>
#include <boost/graph/sequential_vertex_coloring.hpp>
#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/sp06/coloring.h>

#include "sp06/clouds.h"

namespace surfel {
namespace {

using test::graph_of;
using test::Pair;

/// No edge within a color, all colors in use, no more than Brooks' simple bound.
void expect_valid(const OverlapGraph& graph, const Coloring& coloring) {
  std::set<std::uint16_t> used;
  for (std::size_t v = 0; v < graph.size(); ++v) {
    used.insert(coloring.color[v]);
    for (const std::uint32_t w : graph.neighbors(v)) {
      ASSERT_NE(coloring.color[v], coloring.color[w]) << v << " " << w;
    }
  }
  EXPECT_EQ(used.size(), coloring.colors);
  EXPECT_TRUE(used.empty() || *used.rbegin() == coloring.colors - 1);
  EXPECT_LE(coloring.colors, graph.max_degree() + 1);
}

Coloring colored(const OverlapGraph& graph, ColoringOrder order) {
  return greedy_coloring(graph, coloring_order(graph, order));
}

/// Crown graph: a_i and b_j are joined for all i != j. Two colors suffice; in the order a_0 b_0 a_1
/// b_1 ... greedy takes n.
OverlapGraph crown(std::uint32_t n) {
  std::vector<Pair> edges;
  for (std::uint32_t i = 0; i < n; ++i) {
    for (std::uint32_t j = 0; j < n; ++j) {
      if (i != j) edges.emplace_back(2 * i, 2 * j + 1);
    }
  }
  return graph_of(std::size_t{2} * n, edges);
}

TEST(Coloring, OfGraphsDrawnByHand) {
  for (const ColoringOrder order : test::kColoringOrders) {
    EXPECT_EQ(colored(graph_of(0, {}), order).colors, 0U);
    EXPECT_EQ(colored(graph_of(3, {}), order).colors, 1U);
    EXPECT_EQ(colored(graph_of(2, {{0, 1}}), order).colors, 2U);
    EXPECT_EQ(colored(graph_of(5, {{0, 1}, {1, 2}, {2, 3}, {3, 4}, {4, 0}}), order).colors, 3U);
  }
  // DSATUR is exact on bipartite graphs (Brelaz 1979).
  EXPECT_EQ(colored(crown(50), ColoringOrder::kDsatur).colors, 2U);
  // Largest-first keeps the order of the vertices here: the worst case of greedy colouring.
  EXPECT_EQ(colored(crown(50), ColoringOrder::kLargestFirst).colors, 50U);
}

TEST(Coloring, LargestFirstIsByDegreeThenIndex) {
  const OverlapGraph graph = graph_of(6, {{0, 5}, {5, 1}, {5, 3}, {3, 4}});
  EXPECT_EQ(coloring_order(graph, ColoringOrder::kLargestFirst),
            (Array<std::uint32_t>{5, 3, 0, 1, 4, 2}));
}

/// Of every vertex the neighbours that come before it; the largest number of them.
std::size_t most_before(const OverlapGraph& graph, const Array<std::uint32_t>& order) {
  std::vector<std::size_t> place(graph.size());
  for (std::size_t i = 0; i < order.size(); ++i) place[order[i]] = i;
  std::size_t most = 0;
  for (std::size_t v = 0; v < graph.size(); ++v) {
    const auto row = graph.neighbors(v);
    most = std::max<std::size_t>(most, std::count_if(row.begin(), row.end(), [&](std::uint32_t w) {
                                   return place[w] < place[v];
                                 }));
  }
  return most;
}

TEST(Coloring, SmallestLastTakesTheLeastDegreeOfWhatRemains) {
  const OverlapGraph graph = make_overlap_graph(test::sphere_cloud(1500, 10), {});
  const Array<std::uint32_t> order = coloring_order(graph, ColoringOrder::kSmallestLast);
  std::vector<std::size_t> degree(graph.size());
  std::vector<bool> removed(graph.size(), false);
  for (std::size_t v = 0; v < graph.size(); ++v) degree[v] = graph.degree(v);
  for (std::size_t i = order.size(); i-- > 0;) {
    const std::uint32_t v = order[i];
    ASSERT_FALSE(removed[v]);
    for (std::size_t w = 0; w < graph.size(); ++w) {
      ASSERT_TRUE(removed[w] || degree[v] <= degree[w]) << i;
    }
    removed[v] = true;
    for (const std::uint32_t w : graph.neighbors(v)) --degree[w];
  }
  // Hence no more colors than the degeneracy and one.
  EXPECT_LE(greedy_coloring(graph, order).colors, most_before(graph, order) + 1);
}

TEST(Coloring, DsaturTakesTheVertexWithMostColorsAround) {
  const OverlapGraph graph = make_overlap_graph(test::sphere_cloud(700, 10), {});
  const Array<std::uint32_t> order = coloring_order(graph, ColoringOrder::kDsatur);
  const Array<std::uint32_t> by_degree = coloring_order(graph, ColoringOrder::kLargestFirst);
  const Coloring coloring = greedy_coloring(graph, order);
  std::vector<std::set<std::uint16_t>> around(graph.size());
  std::vector<bool> done(graph.size(), false);
  for (const std::uint32_t v : order) {
    std::uint32_t expected = v;
    for (const std::uint32_t w : by_degree) {
      if (done[w]) continue;
      if (done[expected] || around[w].size() > around[expected].size() ||
          (around[w].size() == around[expected].size() &&
           graph.degree(w) > graph.degree(expected)) ||
          (around[w].size() == around[expected].size() &&
           graph.degree(w) == graph.degree(expected) && w < expected)) {
        expected = w;
      }
    }
    ASSERT_EQ(v, expected);
    done[v] = true;
    for (const std::uint32_t w : graph.neighbors(v)) around[w].insert(coloring.color[v]);
  }
}

TEST(Coloring, IsValidForEveryOrder) {
  // Degrees below and above a machine word; hubs whose neighbours have few.
  std::vector<OverlapGraph> graphs;
  graphs.push_back(make_overlap_graph(test::sphere_cloud(3000, 17), {}));
  graphs.push_back(make_overlap_graph(test::sphere_cloud(600, 150), {}));
  graphs.push_back(make_overlap_graph(test::cloud_of_all_radii(700), {}));
  graphs.push_back(make_overlap_graph(test::coincident_cloud(200), {}));
  for (const OverlapGraph& graph : graphs) {
    for (const ColoringOrder order : test::kColoringOrders) {
      const Array<std::uint32_t> permutation = coloring_order(graph, order);
      EXPECT_EQ(std::set<std::uint32_t>(permutation.begin(), permutation.end()).size(),
                graph.size());
      expect_valid(graph, greedy_coloring(graph, permutation));
    }
  }
}

TEST(Coloring, EqualsBoostsInTheSameOrder) {
  const OverlapGraph graph = make_overlap_graph(test::sphere_cloud(test::kManySplats, 18), {});
  using Graph =
      boost::compressed_sparse_row_graph<boost::directedS, boost::no_property, boost::no_property,
                                         boost::no_property, std::uint32_t, std::uint64_t>;
  std::vector<Pair> edges;
  for (std::uint32_t v = 0; v < graph.size(); ++v) {
    for (const std::uint32_t w : graph.neighbors(v)) edges.emplace_back(v, w);
  }
  const Graph boost_graph(boost::edges_are_sorted, edges.begin(), edges.end(),
                          static_cast<std::uint32_t>(graph.size()));
  for (const ColoringOrder order : test::kColoringOrders) {
    const Array<std::uint32_t> permutation = coloring_order(graph, order);
    std::vector<std::uint32_t> color(graph.size());
    const auto colors = boost::sequential_vertex_coloring(
        boost_graph,
        boost::make_iterator_property_map(permutation.begin(), boost::identity_property_map()),
        boost::make_iterator_property_map(color.begin(), get(boost::vertex_index, boost_graph)));
    const Coloring ours = greedy_coloring(graph, permutation);
    EXPECT_EQ(ours.colors, colors);
    EXPECT_TRUE(std::equal(color.begin(), color.end(), ours.color.begin()));
  }
}

TEST(Coloring, RefusesMoreColorsThanTheColumnHolds) {
  const OverlapGraph graph = make_overlap_graph(test::coincident_cloud(100), {});
  Array<std::uint32_t> order(100);
  std::iota(order.begin(), order.end(), 0U);
  EXPECT_EQ(greedy_coloring(graph, order, 100).colors, 100U);
  EXPECT_THROW(greedy_coloring(graph, order, 99, "one_place.ply"), Error);
}

}  // namespace
}  // namespace surfel
