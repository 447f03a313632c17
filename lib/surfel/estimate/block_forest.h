#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/morton.h>
#include <surfel/base/peers.h>
#include <surfel/base/types.h>

namespace surfel {

/// Edges from the points of a block to their nearest points, a row a point, as the graph of
/// orient_normals() has them.
struct SURFEL_API BlockEdges {
  std::size_t degree = 0;       ///< Edges of a row, kOrientationNeighbors + 1 at most.
  Array<std::uint64_t> to;      ///< Among the finite points of the cloud.
  Array<std::uint16_t> length;  ///< As NeighborGraph has it.
  Array<std::uint16_t>
      opposed;  ///< By point: bit k is set where the signs of edge k's ends differ.

  /// Makes room for so many points without edges.
  void resize(std::size_t points, std::size_t edges);
  void set(std::size_t point, std::size_t k, std::uint64_t to_number, float weight, bool differ);
};

/// What may be in the forest of the whole cloud, of a block of consecutive points. An edge that
/// closes a cycle of shorter edges of the block's points is in no forest.
class SURFEL_API BlockForest {
 public:
  /// \param first  number of the block's first point among the finite points of the cloud.
  /// \param grid   of the cloud.
  static BlockForest of(const Array<Vec3f>& position, const Array<Vec3f>& normal,
                        const BlockEdges& edges, std::uint64_t first, const MortonGrid& grid);
  /// As bytes for another process, and back.
  Bytes bytes() const;
  static BlockForest of(const Bytes& bytes);

 private:
  friend class ForestSides;
  struct Point {
    Vec3f position, normal;
  };
  /// An edge within the block, whose points are counted from its first.
  struct InnerEdge {
    std::uint32_t from, to;
    std::uint16_t length;
    std::uint8_t place;  ///< Within the row.
    std::uint8_t differ;
  };
  /// An edge of the whole graph, with what its place in the order is told from.
  struct Edge {
    Vec3f position;  ///< Of the point that lists it.
    std::uint16_t length;
    std::uint8_t place;  ///< Within the row.
    std::uint8_t differ;
    std::uint64_t number;               ///< Of the point that lists it.
    std::array<std::uint32_t, 2> ends;  ///< The other point's number, its lower half first; borders
                                        ///< or sets in ForestSides::unite().
  };
  std::vector<Point> points_;
  std::vector<InnerEdge> inner_;  ///< Ascending.
  std::vector<Edge> leaving_;     ///< To other blocks.
};

}  // namespace surfel
