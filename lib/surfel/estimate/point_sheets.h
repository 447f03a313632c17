#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/surface/neighbor_search.h>

namespace surfel {

/// Pieces of surfaces whose sides are certain within each.
struct PointSheets {
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
  Array<std::uint32_t> of;  ///< Sheet of each point; kNone: the point has no normal.
  std::uint32_t count = 0;  ///< Sheets, numbered by their first points.
};

/// Cuts points into sheets, and turns the normals of each to one side, whichever that is. Points
/// are of one sheet where edges of the graph of the nearest neighbours connect them that hardly
/// leave either tangent plane and between normals that hardly differ: weights below 0.01, see
/// orient_normals(). A thin wall's two sides are two sheets then, as are the faces beside a sharp
/// edge, and noise leaves many. Sheets of fewer than `least` points are joined to others by their
/// best edges of any weight, as far as there are some: first within blocks of successive points, so
/// that the order of a space-filling curve is fastest.
///
/// \param search  searches `position`.
/// \param normal  unit, or zero where unknown.
///
/// Sheets do not depend on the number of threads.
SURFEL_API PointSheets cut_sheets(const Array<Vec3f>& position, const NeighborSearch& search,
                                  std::size_t least, Array<Vec3f>& normal);

}  // namespace surfel
