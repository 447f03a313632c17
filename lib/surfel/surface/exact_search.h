#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <surfel/base/function_ref.h>
#include <surfel/base/types.h>
#include <surfel/surface/neighbor_search.h>
#include <surfel/surface/point_tree.h>

namespace surfel {

/// The exact search of all points' neighbourhoods at once. The points of a leaf are near one
/// another and so are their neighbours: for each leaf the leaves within reach are gathered once,
/// and each of its points looks at all points of the gathered leaves, 4 to 16 at a time. The reach
/// is guessed from the leaf before; a point whose k-th neighbour lies beyond it is looked at again
/// with a wider reach, so that the guess decides on the time and never on the result. Queries for
/// single points bound the reach by the k-th distance within the node around them.
///
/// Rounding leaves nothing out: distances to boxes and to points are computed by the same monotone
/// operations in the same order, so that no box is further away than a point in it.
class ExactSearch final : public NeighborSearch {
 public:
  /// `points` are finite.
  explicit ExactSearch(const Array<Vec3f>& points) : tree_(points) {}

  std::size_t size() const override { return tree_.size(); }
  void search(const Vec3f& query, std::size_t most, float limit2,
              std::vector<Neighbor>& out) const override;
  void for_each(std::size_t most, float limit2, Body body) const override;

  /// A neighbouring place: the upper half holds its squared distance, as the bits of a float, the
  /// lower half the index of its first point. Ascending keys are ascending distances, ties by
  /// index.
  using Key = std::uint64_t;

 private:
  void expand(std::span<const Key> places, std::size_t most, std::vector<Neighbor>& out) const;

  PointTree tree_;
};

}  // namespace surfel
