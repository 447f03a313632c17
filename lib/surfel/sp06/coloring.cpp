// Zhang, Pajarola 2006, "Single-Pass Point Rendering and Transparent Shading", section 4.1.
// Matula, Beck 1983, "Smallest-last ordering and clustering and graph coloring algorithms".
// Batagelj, Zaversnik 2003, "An O(m) algorithm for cores decomposition of networks" (the buckets).
// Brelaz 1979, "New methods to color the vertices of a graph" (DSATUR).

#include <algorithm>
#include <bit>
#include <numeric>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/sp06/coloring.h>

namespace surfel {
namespace {

/// Vertices by ascending degree, vertices of equal degree ascending, and where each degree begins.
struct DegreeBuckets {
  Array<std::uint32_t> vertex;
  std::vector<std::uint32_t> begin;  ///< First vertex of each degree 0..max_degree + 1.

  explicit DegreeBuckets(const OverlapGraph& graph)
      : vertex(graph.size()), begin(graph.max_degree() + 2, 0) {
    for (std::size_t v = 0; v < graph.size(); ++v) ++begin[graph.degree(v) + 1];
    std::partial_sum(begin.begin(), begin.end(), begin.begin());
    std::vector<std::uint32_t> next = begin;
    for (std::size_t v = 0; v < graph.size(); ++v) {
      vertex[next[graph.degree(v)]++] = static_cast<std::uint32_t>(v);
    }
  }
};

Array<std::uint32_t> largest_first(const OverlapGraph& graph) {
  const DegreeBuckets buckets(graph);
  Array<std::uint32_t> order;
  order.reserve(graph.size());
  for (std::size_t degree = buckets.begin.size() - 1; degree-- > 0;) {
    order.insert(order.end(), buckets.vertex.begin() + buckets.begin[degree],
                 buckets.vertex.begin() + buckets.begin[degree + 1]);
  }
  return order;
}

Array<std::uint32_t> smallest_last(const OverlapGraph& graph) {
  const std::size_t n = graph.size();
  // The vertices before i are removed; the vertices from i on are sorted by their degree among
  // themselves, and begin[d] is where degree d starts.
  DegreeBuckets buckets(graph);
  Array<std::uint32_t>& vertex = buckets.vertex;
  std::vector<std::uint32_t>& begin = buckets.begin;
  Array<std::uint32_t> place(n);
  Array<std::uint32_t> degree(n);
  for (std::size_t i = 0; i < n; ++i) place[vertex[i]] = static_cast<std::uint32_t>(i);
  for (std::size_t v = 0; v < n; ++v) degree[v] = static_cast<std::uint32_t>(graph.degree(v));
  for (std::size_t i = 0; i < n; ++i) {
    const std::uint32_t v = vertex[i];
    for (const std::uint32_t w : graph.neighbors(v)) {
      if (place[w] < i) continue;  // Removed.
      // To the bucket below: change places with the first of its own, and move the border, which
      // may have stayed behind among the removed.
      std::uint32_t& border = begin[degree[w]--];
      border = std::max(border, static_cast<std::uint32_t>(i + 1));
      const std::uint32_t other = vertex[border];
      std::swap(vertex[border], vertex[place[w]]);
      std::swap(place[other], place[w]);
      ++border;
    }
  }
  std::reverse(vertex.begin(), vertex.end());
  return std::move(vertex);
}

/// Vertices with a key each, the largest on top: a heap of four branches that knows where each
/// vertex is, so that keys can grow.
class GrowingKeys {
 public:
  explicit GrowingKeys(Array<std::uint64_t> keys)
      : key_(std::move(keys)), heap_(key_.size()), place_(key_.size()) {
    std::iota(heap_.begin(), heap_.end(), 0U);
    std::sort(heap_.begin(), heap_.end(),
              [&](std::uint32_t a, std::uint32_t b) { return key_[a] > key_[b]; });
    for (std::size_t i = 0; i < heap_.size(); ++i) place_[heap_[i]] = static_cast<std::uint32_t>(i);
  }

  bool empty() const { return heap_.empty(); }

  std::uint32_t pop() {
    const std::uint32_t top = heap_.front();
    const std::uint32_t last = heap_.back();
    heap_.pop_back();
    if (!heap_.empty()) sink(0, last);
    return top;
  }

  /// Raises the key of a vertex that is still there.
  void grow(std::uint32_t v, std::uint64_t by) {
    key_[v] += by;
    std::size_t i = place_[v];
    while (i > 0) {
      const std::size_t parent = (i - 1) / kBranching;
      if (key_[heap_[parent]] > key_[v]) break;
      put(i, heap_[parent]);
      i = parent;
    }
    put(i, v);
  }

 private:
  /// A flatter heap than a binary one: fewer cache misses.
  static constexpr std::size_t kBranching = 4;

  void put(std::size_t i, std::uint32_t v) {
    heap_[i] = v;
    place_[v] = static_cast<std::uint32_t>(i);
  }
  void sink(std::size_t i, std::uint32_t v) {
    for (;;) {
      const std::size_t first = i * kBranching + 1;
      if (first >= heap_.size()) break;
      std::size_t largest = first;
      const std::size_t end = std::min(first + kBranching, heap_.size());
      for (std::size_t child = first + 1; child < end; ++child) {
        if (key_[heap_[child]] > key_[heap_[largest]]) largest = child;
      }
      if (key_[heap_[largest]] < key_[v]) break;
      put(i, heap_[largest]);
      i = largest;
    }
    put(i, v);
  }

  Array<std::uint64_t> key_;
  Array<std::uint32_t> heap_;
  Array<std::uint32_t> place_;
};

/// The smallest colour that no neighbour of a vertex has.
class FirstFree {
 public:
  explicit FirstFree(std::size_t max_degree) : taken_by_(max_degree + 1, kNobody) {}

  std::uint32_t operator()(const OverlapGraph& graph, std::uint32_t v,
                           const std::vector<std::uint32_t>& color) {
    const std::span<const std::uint32_t> neighbors = graph.neighbors(v);
    // One colour of 0..degree is free, whatever the neighbours have.
    if (neighbors.size() < 64) {
      std::uint64_t taken = 0;
      for (const std::uint32_t w : neighbors) {
        if (color[w] < 64) taken |= std::uint64_t{1} << color[w];
      }
      return static_cast<std::uint32_t>(std::countr_one(taken));
    }
    for (const std::uint32_t w : neighbors) {
      if (color[w] < taken_by_.size()) taken_by_[color[w]] = v;
    }
    std::uint32_t free = 0;
    while (taken_by_[free] == v) ++free;
    return free;
  }

 private:
  static constexpr std::uint32_t kNobody = 0xffffffff;  ///< No vertex has this number.
  /// For each colour, the last vertex that could not take it.
  std::vector<std::uint32_t> taken_by_;
};

/// Which colours a vertex' neighbours have: a bit for each of 0..degree; the few above, which a
/// neighbour of higher degree may have, are looked for among the neighbours.
class NeighborColors {
 public:
  explicit NeighborColors(const OverlapGraph& graph) : graph_(graph), begin_(graph.size() + 1) {
    begin_[0] = 0;
    for (std::size_t v = 0; v < graph.size(); ++v) begin_[v + 1] = begin_[v] + graph.degree(v) + 1;
    bits_.resize((begin_.back() + 63) / 64, 0);
  }

  /// Notes that the neighbour w of v took its colour; false if v had a neighbour of that colour.
  bool add(std::uint32_t v, std::uint32_t w, const std::vector<std::uint32_t>& color) {
    const std::uint64_t bit = begin_[v] + color[w];
    if (bit < begin_[v + 1]) {
      const std::uint64_t mask = std::uint64_t{1} << (bit % 64);
      const bool is_new = (bits_[bit / 64] & mask) == 0;
      bits_[bit / 64] |= mask;
      return is_new;
    }
    const auto neighbors = graph_.neighbors(v);
    return std::none_of(neighbors.begin(), neighbors.end(), [&](std::uint32_t other) {
      return other != w && color[other] == color[w];
    });
  }

 private:
  const OverlapGraph& graph_;
  Array<std::uint64_t> begin_;
  std::vector<std::uint64_t> bits_;
};

Array<std::uint32_t> dsatur(const OverlapGraph& graph) {
  // Key: number of the neighbours' colours, then the place in largest-first order.
  constexpr std::uint64_t kOneColor = std::uint64_t{1} << 32;
  const Array<std::uint32_t> by_degree = largest_first(graph);
  Array<std::uint64_t> keys(graph.size());
  for (std::size_t i = 0; i < by_degree.size(); ++i) keys[by_degree[i]] = graph.size() - 1 - i;
  GrowingKeys queue(std::move(keys));
  NeighborColors neighbor_colors(graph);
  FirstFree first_free(graph.max_degree());
  std::vector<std::uint32_t> color(graph.size(), kUncolored);
  Array<std::uint32_t> order;
  order.reserve(graph.size());
  while (!queue.empty()) {
    const std::uint32_t v = queue.pop();
    order.push_back(v);
    color[v] = first_free(graph, v, color);
    for (const std::uint32_t w : graph.neighbors(v)) {
      if (color[w] == kUncolored && neighbor_colors.add(w, v, color)) queue.grow(w, kOneColor);
    }
  }
  return order;
}

}  // namespace

Array<std::uint32_t> coloring_order(const OverlapGraph& graph, ColoringOrder order) {
  switch (order) {
    case ColoringOrder::kSmallestLast:
      return smallest_last(graph);
    case ColoringOrder::kDsatur:
      return dsatur(graph);
    case ColoringOrder::kLargestFirst:
      break;
  }
  return largest_first(graph);
}

std::uint32_t color_greedily(const OverlapGraph& graph, const Array<std::uint32_t>& order,
                             std::uint32_t max_colors, std::vector<std::uint32_t>& color,
                             const std::string& name) {
  FirstFree first_free(graph.max_degree());
  std::uint32_t colors = 0;
  for (const std::uint32_t v : order) {
    color[v] = first_free(graph, v, color);
    colors = std::max(colors, color[v] + 1);
    if (colors > max_colors) {
      throw_input(name, fmt::format("more than {} groups are needed, which the column 'group' "
                                    "cannot number; lower `overlap` or `cutoff`, or fix `groups`",
                                    max_colors));
    }
  }
  return colors;
}

Coloring greedy_coloring(const OverlapGraph& graph, const Array<std::uint32_t>& order,
                         std::uint32_t max_colors, const std::string& name) {
  std::vector<std::uint32_t> color(graph.size(), kUncolored);
  Coloring coloring;
  coloring.colors = color_greedily(graph, order, max_colors, color, name);
  coloring.color.resize(graph.size());
  std::copy(color.begin(), color.end(), coloring.color.begin());
  return coloring;
}

}  // namespace surfel
