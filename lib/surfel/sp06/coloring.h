#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/sp06/overlap_graph.h>

namespace surfel {

/// The order in which vertices take their colours.
enum class ColoringOrder : std::uint8_t {
  kLargestFirst,  ///< By descending degree (Welsh, Powell 1967; SP06 section 4.1).
  kSmallestLast,  ///< The vertex of least degree among the uncoloured vertices comes last (Matula,
                  ///< Beck 1983).
  kDsatur,        ///< The vertex whose neighbours have the most colours comes next (Brelaz 1979).
};

/// Groups that the column `group` (ushort) can number.
constexpr std::uint32_t kMaxGroups = 65535;

/// The colour of every vertex, 0..colors-1; each is in use.
struct Coloring {
  Array<std::uint16_t> color;
  std::uint32_t colors = 0;
};

/// All vertices in an order to colour them. Ties: largest-first and DSATUR take the higher degree,
/// then the lower vertex; smallest-last, the vertex that lies first in its bucket, which depends on
/// the graph alone. O(vertices + edges), DSATUR O(edges log vertices); 16 bytes a vertex, DSATUR
/// another 8 and a bit an edge. Sequential.
SURFEL_API Array<std::uint32_t> coloring_order(const OverlapGraph& graph, ColoringOrder order);

/// The colour of vertices that have none.
constexpr std::uint32_t kUncolored = 0xffffffff;

/// Greedy colouring of some vertices: each, in that order, takes the smallest colour that no
/// neighbour has. The colours of all other vertices, of which some may be kUncolored, stay as they
/// are. Returns one more than the largest colour that was taken. Throws as greedy_coloring() does.
SURFEL_API std::uint32_t color_greedily(const OverlapGraph& graph,
                                        const Array<std::uint32_t>& order, std::uint32_t max_colors,
                                        std::vector<std::uint32_t>& color,
                                        const std::string& name = {});

/// Greedy colouring: every vertex, in that order, takes the smallest colour that no neighbour has.
/// At most max_degree + 1 colours. O(vertices + edges). Throws Error(kInput) starting with `name`
/// where it takes more than `max_colors`.
SURFEL_API Coloring greedy_coloring(const OverlapGraph& graph, const Array<std::uint32_t>& order,
                                    std::uint32_t max_colors = kMaxGroups,
                                    const std::string& name = {});

}  // namespace surfel
