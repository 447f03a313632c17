#include <algorithm>
#include <limits>
#include <numeric>

#include <gtest/gtest.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/estimate/spanning_forest.h>

namespace surfel {
namespace {

/// A band of edges between points whose numbers are near, as along a space-filling curve, and a few
/// from anywhere to anywhere; lengths with many ties. Every third edge is there from both ends.
NeighborGraph random_graph(std::size_t points, std::size_t degree, std::size_t span) {
  NeighborGraph graph;
  NeighborRows& rows = graph.rows;
  rows.count = degree;
  rows.stride = degree + 5;
  rows.kept.resize(points * rows.stride);
  rows.index = rows.kept.data();
  for (std::size_t e = 0; e < rows.kept.size(); ++e) {
    rows.kept[e] = static_cast<std::uint32_t>(e / rows.stride);  // The point itself: no edge.
  }
  graph.length.assign(points * degree, NeighborGraph::kNoEdge);
  std::vector<std::size_t> used(points);
  const auto linked = [&](std::size_t i, std::size_t j) {
    const auto row = rows.of(i).first(used[i]);
    return std::find(row.begin(), row.end(), j) != row.end();
  };
  const auto add = [&](std::size_t i, std::size_t j, std::uint16_t length) {
    if (used[i] == degree || linked(i, j)) return;
    rows.kept[i * rows.stride + used[i]] = static_cast<std::uint32_t>(j);
    graph.length[i * degree + used[i]++] = length;
  };
  for (std::size_t e = 0; e < points * degree * 2 / 3; ++e) {
    const std::size_t i = random_bits(1, e, 0) % points;
    std::size_t j = random_bits(1, e, 1) % points;
    if (e % 50 != 0) j = (i + 1 + random_bits(1, e, 2) % span) % points;
    // The same length from both ends.
    const auto length =
        static_cast<std::uint16_t>(random_bits(2, std::min(i, j), std::max(i, j)) % 500);
    if (i == j) continue;
    add(i, j, length);
    if (e % 3 == 0) add(j, i, length);
  }
  return graph;
}

constexpr auto opposed = [](std::uint32_t i, std::uint32_t j) {
  return random_bits(3, std::min(i, j), std::max(i, j)) % 2 == 0;
};

/// Kruskal's algorithm, word for word.
void unite_plainly(const NeighborGraph& graph, SignedSets& sets) {
  std::vector<std::size_t> order(graph.length.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return graph.length[a] < graph.length[b]; });
  for (const std::size_t e : order) {
    if (graph.length[e] >= graph.limit) continue;
    const auto from = static_cast<std::uint32_t>(e / graph.degree());
    const std::uint32_t to = graph.to(e);
    sets.unite(from, to, [&] { return opposed(from, to); });
  }
}

/// Sets of the same points, with the same signs within each.
void expect_same(SignedSets& a, SignedSets& b) {
  const std::size_t count = a.size();
  constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
  std::vector<std::uint32_t> root_of(count, kNone);
  std::vector<bool> turned(count);
  std::size_t roots_a = 0;
  std::size_t roots_b = 0;
  for (std::uint32_t i = 0; i < count; ++i) {
    const SignedSets::Root in_a = a.find(i);
    const SignedSets::Root in_b = b.find(i);
    roots_a += in_a.index == i ? 1 : 0;
    roots_b += in_b.index == i ? 1 : 0;
    if (root_of[in_a.index] == kNone) {
      root_of[in_a.index] = in_b.index;
      turned[in_a.index] = in_a.opposed != in_b.opposed;
    }
    ASSERT_EQ(root_of[in_a.index], in_b.index) << i;
    ASSERT_EQ(turned[in_a.index], in_a.opposed != in_b.opposed) << i;
  }
  EXPECT_EQ(roots_a, roots_b);
}

TEST(SpanningForest, SameAsKruskalOverManyBlocks) {
  // Degrees of 64 and 8: blocks of 1024 and 8192 points; of 9 and 3: rows with a rest.
  struct Case {
    std::size_t points, degree, span;
    std::uint16_t limit = NeighborGraph::kNoEdge;
  };
  for (const Case& c : {Case{5000, 64, 40}, Case{20000, 8, 30}, Case{20000, 8, 30, 60},
                        Case{20000, 9, 20000}, Case{9000, 3, 2}, Case{1, 8, 1}}) {
    NeighborGraph graph = random_graph(c.points, c.degree, c.span);
    graph.limit = c.limit;
    SignedSets expected(c.points);
    unite_plainly(graph, expected);
    for (const int threads : {1, 3}) {
      set_thread_count(threads);
      SignedSets sets(c.points);
      unite_spanning_forest(graph, false, opposed, sets);
      expect_same(sets, expected);
    }
  }
  set_thread_count(0);
}

TEST(SpanningForest, KeepsWhatIsJoinedAlready) {
  const NeighborGraph graph = random_graph(20000, 8, 30);
  SignedSets expected(20000);
  SignedSets sets(20000);
  for (SignedSets* s : {&expected, &sets}) {
    for (std::uint32_t i = 0; i + 700 < 20000; i += 700) {
      s->unite(i, i + 700, [&] { return i % 3 == 0; });
    }
  }
  unite_plainly(graph, expected);
  unite_spanning_forest(graph, true, opposed, sets);
  expect_same(sets, expected);
}

}  // namespace
}  // namespace surfel
