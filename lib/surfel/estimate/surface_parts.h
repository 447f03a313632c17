#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/estimate/orientation.h>
#include <surfel/surface/neighbor_search.h>

namespace surfel {

/// An edge between two parts of a surface.
struct PartJoin {
  float weight = 0;                ///< As orient_normals() has it.
  std::uint32_t point = 0;         ///< The one that found the edge.
  std::uint32_t from = 0, to = 0;  ///< The parts.
  std::uint8_t rank = 0;           ///< Of the other point among the nearest ones.
  bool opposed = false;            ///< The signs of the parts differ.
};

/// Edges between parts, of which those are kept that may be in the minimum spanning forest: an edge
/// that closes a cycle of edges before it (by weight, then point, then rank) is in no forest of
/// these and more edges. Whatever the order in which edges are added, the forest is the same.
class SURFEL_API PartJoins {
 public:
  void add(const PartJoin& join);
  void add(const PartJoins& more);
  /// The edges along which Kruskal's algorithm unites parts, in their order.
  std::span<const PartJoin> forest();

 private:
  /// Edges that are kept before the first cycles are looked for.
  static constexpr std::size_t kFew = 1024;

  std::vector<PartJoin> joins_;
  std::size_t most_ = kFew;  ///< Edges with which cycles are looked for next.
};

/// Points of a surface, a value per point in each list.
struct PartPoints {
  /// The part of points that belong to none.
  static constexpr std::uint32_t kNoPart = std::numeric_limits<std::uint32_t>::max();

  const Array<Vec3f>& position;
  const Array<Vec3f>& normal;  ///< Zero = unknown.
  const Array<std::uint32_t>& part;
};

/// Finds the edges of weight below 0.1 from all parts but the largest to other parts, among the 64
/// nearest points of each point.
/// \param search   searches the positions.
/// \param opposed  by point: 1 where the normal is on the other side than its part's.
PartJoins find_joins(const PartPoints& points, const NeighborSearch& search,
                     const Array<std::uint8_t>& opposed, std::uint32_t largest);

/// Which parts of a surface have to be turned, so that the furthest point of each in a probed
/// direction (of several, the first) looks there: by kOutward by the sum over 26 directions, else
/// up. Where the sum is zero, as of an upright plane, the furthest point in the last direction
/// keeps the side that its normal had before.
/// \param points  with normals on the side of their part; parts are numbered from 0 on.
/// \param turned  by point: 1 where the normal is on another side than before.
std::vector<bool> parts_to_turn(const PartPoints& points, std::size_t parts,
                                const Array<std::uint8_t>& turned, Orientation method);

}  // namespace surfel
