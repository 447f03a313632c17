#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>

#include <surfel/base/export.h>
#include <surfel/base/function_ref.h>
#include <surfel/base/types.h>
#include <surfel/surface/neighbor_search.h>

namespace surfel {

/// Disjoint sets of points [Tarjan 1975], each point with a sign relative to its set's root.
class SURFEL_API SignedSets {
 public:
  explicit SignedSets(std::size_t count);

  struct Root {
    std::uint32_t index;
    bool opposed;  ///< The point's sign is the other than its root's.
  };

  std::size_t size() const { return parent_.size(); }

  /// Halves the path as it goes.
  Root find(std::uint32_t i) {
    bool opposed = false;
    while (parent_[i] != i) {
      const std::uint32_t parent = parent_[i];
      if (parent_[parent] != parent) {
        opposed_[i] ^= opposed_[parent];
        parent_[i] = parent_[parent];
      }
      opposed ^= opposed_[i] != 0;
      i = parent_[i];
    }
    return {i, opposed};
  }

  /// find() without shortening paths: several threads may call it at once.
  Root root(std::uint32_t i) const {
    bool opposed = false;
    for (; parent_[i] != i; i = parent_[i]) opposed ^= opposed_[i] != 0;
    return {i, opposed};
  }

  /// Joins the sets of two different roots, of points whose signs differ or not; returns the root.
  std::uint32_t join(Root a, Root b, bool differ) {
    if (rank_[a.index] < rank_[b.index]) std::swap(a, b);
    if (rank_[a.index] == rank_[b.index]) ++rank_[a.index];
    parent_[b.index] = a.index;
    opposed_[b.index] = static_cast<std::uint8_t>(a.opposed ^ b.opposed ^ differ);
    return a.index;
  }

  /// Calls opposed() for whether i and j have different signs, unless they are in one set already.
  template <class Opposed>
  void unite(std::uint32_t i, std::uint32_t j, Opposed&& opposed) {
    const Root a = find(i);
    const Root b = find(j);
    if (a.index != b.index) join(a, b, opposed());
  }

 private:
  Array<std::uint32_t> parent_;
  Array<std::uint8_t> opposed_;
  Array<std::uint8_t> rank_;
};

/// Graph of points and the neighbours that their rows list, at most 65 a row: edge e leads from
/// point e / degree() to entry e % degree() of the point's row. An edge between two points that
/// list each other is there from both ends with the same length, or from neither end.
struct NeighborGraph {
  static constexpr std::uint16_t kNoEdge = std::numeric_limits<std::uint16_t>::max();
  static constexpr float kLongestWeight = 65534;  ///< The largest length below kNoEdge.
  NeighborRows rows;
  Array<std::uint16_t> length;
  std::uint16_t limit = kNoEdge;  ///< Edges of this length, and longer ones, are not there.

  /// The length that stands for a weight in 0..1; larger weights are no edge.
  static std::uint16_t length_of(float weight) {
    return weight > 1 ? kNoEdge : static_cast<std::uint16_t>(weight * kLongestWeight + 0.5F);
  }
  std::size_t degree() const { return rows.count; }
  std::uint32_t to(std::size_t e) const {
    return rows.index[e / degree() * rows.stride + e % degree()];
  }
};

/// Unites the points along the minimum spanning forest of the graph; equal lengths count as
/// ascending with the edges' numbers, so that there is just one forest. `opposed` tells whether the
/// signs of neighbours differ; it is called in parallel. Points that `sets` holds together already
/// stay together, as if by edges of length below zero, if `joined` says that there are any.
///
/// Blocks of successive points are looked at first, in parallel and each for itself: an edge that
/// closes a cycle of shorter edges within its block is in no forest; an edge that is the shortest
/// of all edges that leave one of the two sets it joins [Boruvka 1926] is in the forest, whatever
/// the other blocks hold. Kruskal's algorithm does the rest, which is little where points are in
/// the order of a space-filling curve. The forest does not depend on the number of threads.
SURFEL_API void unite_spanning_forest(const NeighborGraph& graph, bool joined,
                                      FunctionRef<bool(std::uint32_t, std::uint32_t)> opposed,
                                      SignedSets& sets);

}  // namespace surfel
