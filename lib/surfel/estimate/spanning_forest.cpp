// Kruskal, "On the shortest spanning subtree of a graph", 1956.

#include <algorithm>
#include <array>
#include <atomic>
#include <limits>
#include <numeric>
#include <vector>

#include <surfel/base/disjoint_sets.h>
#include <surfel/base/parallel.h>
#include <surfel/estimate/spanning_forest.h>

namespace surfel {
namespace {

/// Edges of a block, so that its data stay in a core's second cache.
constexpr std::size_t kBlockEdges = std::size_t{1} << 16;
constexpr std::size_t kPointGrain = std::size_t{1} << 16;
constexpr std::uint64_t kBeyondAll = std::numeric_limits<std::uint64_t>::max();

/// Edges in ascending order: by length, then number.
std::uint64_t order_key(const NeighborGraph& graph, std::size_t e) {
  return std::uint64_t{graph.length[e]} << 48 | e;
}
std::size_t edge_of(std::uint64_t key) { return key & ((std::uint64_t{1} << 48) - 1); }

/// A block of points, [begin, end), and its part of the work.
class Block {
 public:
  Block(const NeighborGraph& graph, std::size_t begin, std::size_t end)
      : graph_(graph), begin_(begin), end_(end) {}

  /// Appends the edges that lead out of the block to `out`.
  void collect_leaving(std::vector<std::uint64_t>& out) const {
    for (std::size_t point = begin_; point < end_; ++point) {
      std::size_t e = point * graph_.degree();
      for (const std::uint32_t to : graph_.rows.of(point)) {
        if (!inside(to) && graph_.length[e] < graph_.limit && !repeated(point, to)) {
          out.push_back(order_key(graph_, e));
        }
        ++e;
      }
    }
  }

  /// Unites along edges within the block that are surely in the forest, and appends the others that
  /// may be to `left`. `shortest_out` is the shortest edge to another block: of each point, and
  /// then of each set's root. Sets are within one block.
  void contract(FunctionRef<bool(std::uint32_t, std::uint32_t)> opposed, SignedSets& sets,
                Array<std::uint64_t>& shortest_out, std::vector<std::uint64_t>& left) {
    run(left, [&](std::uint32_t from, std::uint32_t to, std::uint64_t key) {
      // Edges come in ascending order. A shorter one within the block that leaves either set has
      // been passed over because one to another block was shorter still.
      const SignedSets::Root a = sets.find(from);
      const SignedSets::Root b = sets.find(to);
      const std::uint64_t out_a = shortest_out[a.index];
      const std::uint64_t out_b = shortest_out[b.index];
      if (key >= std::max(out_a, out_b)) return false;
      shortest_out[sets.join(a, b, opposed(from, to))] = std::min(out_a, out_b);
      return true;
    });
  }

  /// Appends the edges within the block that may be in the forest to `left`.
  void filter(std::vector<std::uint64_t>& left) {
    run(left, [](std::uint32_t, std::uint32_t, std::uint64_t) { return false; });
  }

 private:
  bool inside(std::uint32_t point) const { return point >= begin_ && point < end_; }

  /// Is the edge there from its other end, too, with a lower number? The answer takes no branch
  /// that depends on the points' order, which no processor guesses.
  bool repeated(std::size_t from, std::uint32_t to) const {
    const std::uint32_t* other = graph_.rows.index + to * graph_.rows.stride;
    constexpr std::size_t kTogether = 8;  // Known here, so that it is a few vectors.
    unsigned listed = 0;
    std::size_t k = 0;
    for (; k + kTogether <= graph_.degree(); k += kTogether) {
      for (std::size_t j = 0; j < kTogether; ++j) listed |= other[k + j] == from ? 1U : 0U;
    }
    for (; k < graph_.degree(); ++k) listed |= other[k] == from ? 1U : 0U;
    return (static_cast<unsigned>(to < from) & listed) != 0;
  }

  /// Kruskal's algorithm within the block; edges of its forest that sure(from, to, key) does not
  /// take go to `left`.
  template <class Sure>
  void run(std::vector<std::uint64_t>& left, Sure&& sure) {
    sort_inner();
    std::size_t trees = end_ - begin_;
    DisjointSets united(trees);
    for (auto next = inner_.begin(); next != inner_.end() && trees > 1; ++next) {
      if (!united.unite(next->from, next->to)) continue;
      --trees;
      const std::size_t from = begin_ + next->from;
      const std::uint64_t key = order_key(graph_, from * graph_.degree() + next->place);
      if (!sure(static_cast<std::uint32_t>(from), static_cast<std::uint32_t>(begin_ + next->to),
                key)) {
        left.push_back(key);
      }
    }
  }

  /// The edges within the block, by length: two stable passes over its bytes.
  void sort_inner() {
    inner_.resize((end_ - begin_) * graph_.degree());
    std::size_t count = 0;
    std::array<std::array<std::uint32_t, 256>, 2> place{};
    for (std::size_t point = begin_; point < end_; ++point) {
      const std::uint16_t* lengths = graph_.length.data() + point * graph_.degree();
      const auto row = graph_.rows.of(point);
      for (std::size_t k = 0; k < row.size(); ++k) {
        const std::uint32_t to = row[k];
        if (!inside(to)) continue;
        const std::uint16_t length = lengths[k];
        inner_[count] = {length, static_cast<std::uint16_t>(k),
                         static_cast<std::uint16_t>(point - begin_),
                         static_cast<std::uint16_t>(to - begin_)};
        const std::uint32_t once = length >= graph_.limit || repeated(point, to) ? 0 : 1;
        place[0][length & 0xff] += once;
        place[1][length >> 8] += once;
        count += once;
      }
    }
    inner_.resize(count);
    other_.resize(count);
    for (const unsigned pass : {0U, 1U}) {
      std::exclusive_scan(place[pass].begin(), place[pass].end(), place[pass].begin(), 0U);
      for (const Edge& edge : inner_) {
        other_[place[pass][edge.length >> (8 * pass) & 0xff]++] = edge;
      }
      inner_.swap(other_);
    }
  }

  const NeighborGraph& graph_;
  std::size_t begin_, end_;
  /// Points are counted from the block's first.
  struct Edge {
    std::uint16_t length, place;  ///< `place` counts within the row.
    std::uint16_t from, to;
  };
  static_assert(kBlockEdges <= std::size_t{1} << 16);
  Array<Edge> inner_, other_;
};

/// Keys of edges, a list for each block.
using BlockKeys = std::vector<std::vector<std::uint64_t>>;

/// The shortest of all edges that lead from or to each point; beyond all: none.
Array<std::uint64_t> shortest_of_points(const NeighborGraph& graph, const BlockKeys& keys,
                                        std::size_t points) {
  Array<std::uint64_t> shortest(points);
  parallel_for(points, kPointGrain, [&](std::size_t begin, std::size_t end, int) {
    std::fill(shortest.begin() + static_cast<std::ptrdiff_t>(begin),
              shortest.begin() + static_cast<std::ptrdiff_t>(end), kBeyondAll);
  });
  parallel_for(keys.size(), 1, [&](std::size_t block, std::size_t, int) {
    for (const std::uint64_t key : keys[block]) {
      const std::size_t e = edge_of(key);
      for (const std::size_t point : {e / graph.degree(), std::size_t{graph.to(e)}}) {
        const std::atomic_ref<std::uint64_t> least(shortest[point]);
        std::uint64_t before = least.load(std::memory_order_relaxed);
        while (key < before &&
               !least.compare_exchange_weak(before, key, std::memory_order_relaxed)) {
        }
      }
    }
  });
  return shortest;
}

/// The keys of blocks, each in order, as a whole in order: a stable sort by length, as the numbers
/// of a block's edges lie before those of the next.
Array<std::uint64_t> in_order(const BlockKeys& keys) {
  std::vector<std::size_t> place(std::size_t{1} << 16);
  for (const auto& some : keys) {
    for (const std::uint64_t key : some) ++place[key >> 48];
  }
  const std::size_t last = place.back();
  std::exclusive_scan(place.begin(), place.end(), place.begin(), std::size_t{0});
  Array<std::uint64_t> out(place.back() + last);
  for (const auto& some : keys) {
    for (const std::uint64_t key : some) out[place[key >> 48]++] = key;
  }
  return out;
}

}  // namespace

SignedSets::SignedSets(std::size_t count) : parent_(count), opposed_(count), rank_(count) {
  parallel_each(count, kPointGrain, [&](std::size_t i) {
    parent_[i] = static_cast<std::uint32_t>(i);
    opposed_[i] = 0;
    rank_[i] = 0;
  });
}

void unite_spanning_forest(const NeighborGraph& graph, bool joined,
                           FunctionRef<bool(std::uint32_t, std::uint32_t)> opposed,
                           SignedSets& sets) {
  const std::size_t points = sets.size();
  if (points == 0) return;
  const std::size_t grain = kBlockEdges / graph.degree();
  BlockKeys left((points + grain - 1) / grain);
  parallel_for(points, grain, [&](std::size_t begin, std::size_t end, int) {
    Block(graph, begin, end).collect_leaving(left[begin / grain]);
  });
  Array<std::uint64_t> shortest_out;
  if (!joined) shortest_out = shortest_of_points(graph, left, points);
  parallel_for(points, grain, [&](std::size_t begin, std::size_t end, int) {
    Block block(graph, begin, end);
    std::vector<std::uint64_t>& keys = left[begin / grain];
    if (joined) {
      block.filter(keys);
    } else {
      block.contract(opposed, sets, shortest_out, keys);
    }
    std::sort(keys.begin(), keys.end());
  });
  shortest_out = {};

  const Array<std::uint64_t> keys = in_order(left);
  left = {};
  // All threads look up the roots; few sets are left, which stay in the cache of the one thread
  // that unites them.
  struct Link {
    std::uint32_t a, b;
    bool differ;
  };
  Array<Link> links(keys.size());
  constexpr std::size_t kGrain = 1 << 12;
  parallel_each(keys.size(), kGrain, [&](std::size_t i) {
    const std::size_t e = edge_of(keys[i]);
    const auto from = static_cast<std::uint32_t>(e / graph.degree());
    const std::uint32_t to = graph.to(e);
    const SignedSets::Root a = sets.root(from);
    const SignedSets::Root b = sets.root(to);
    links[i] = {a.index, b.index, (opposed(from, to) != a.opposed) != b.opposed};
  });
  for (const Link& link : links) {
    sets.unite(link.a, link.b, [&] { return link.differ; });
  }
}

}  // namespace surfel
