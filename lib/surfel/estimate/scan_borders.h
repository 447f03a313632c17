#pragma once

#include <cstddef>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/estimate/edge_lines.h>
#include <surfel/estimate/splat_size.h>
#include <surfel/surface/neighbor_search.h>

namespace surfel {

/// What find_borders() has found.
struct BorderReport {
  std::size_t points = 0;  ///< Points that lines at borders cut.
  std::size_t unsure = 0;  ///< Points at a border whose line cannot be told.
};

/// Finds the lines at which a surface that was sampled ends at its borders.
///
/// Points at a border are those whose cells are open (SplatSizes::kind): a gap among the angles of
/// their neighbours that no further neighbour fills. The border next to one of them is the line
/// through it and another one within four spacings along which most of them lie, fitted to these by
/// least squares and moved outward by 0.4 spacings, as samples end before their surface does. It is
/// a line if
/// - four points at borders are within 0.45 spacings of it, over a length of 2.5 spacings at least;
/// - no point of the surface within four spacings is beyond it.
/// A point near borders takes the mean of the lines around it, weighed by distance, and the mean of
/// other lines if their directions differ by more than 25 degrees, as at a corner. A line is
/// dropped where a point of the surface lies beyond it within reach of the splat: it would cut away
/// surface that is known to be there. Thus holes of less than a few spacings, reflex corners and
/// frayed borders keep whole splats.
///
/// \param position  Points of the surface, finite.
/// \param normal    A unit vector for each point, or zero = unknown.
/// \param oriented  Whether normals tell front from back, as estimate_splat_sizes() had it.
/// \param search    Searches `position`.
/// \param sizes     Sizes of `position`.
/// \param lines     A value per point; lines at borders are added to lines at creases.
///
/// The result does not depend on the number of threads.
SURFEL_API BorderReport find_borders(const Array<Vec3f>& position, const Array<Vec3f>& normal,
                                     bool oriented, const NeighborSearch& search,
                                     const SplatSizes& sizes, Array<EdgeLines>& lines);

}  // namespace surfel
