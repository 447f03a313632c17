#pragma once

#include <string>
#include <vector>

#include <surfel/base/export.h>

namespace surfel {

// Which points lie on one sheet of a surface. Points know their normals, and nothing of what
// connects them; three questions are asked, each with a rule of its own:
// - Does a neighbour bound a point's cell? same_side() and along_sheet(). A neighbour that is left
//   out by mistake makes cells too large, and one too many makes holes, so that both rules are as
//   wide as they can be: half of all directions.
// - May surfels be merged? SheetRules: the user chooses how much of the shape is given up.
// - Does a disc show the place that is looked at (measure/cloud_statistics.cpp)? Within 60 degrees:
//   a disc turned further covers less than half of what its area promises.
// Samples of a mesh ask its edges instead (sample/poisson_disk.h).

/// Do surfaces with this product of their unit normals face the same side? Normals at right angles
/// do: across a sharp edge a surface goes on.
template <class Real>
bool same_side(Real product_of_normals) {
  return product_of_normals >= 0;
}

/// Does an offset lead along a sheet? Not if it is steeper than 45 degrees to the tangent plane: it
/// leads to another sheet then, or behind an edge.
/// \param height2  squared height of the offset above the tangent plane.
/// \param flat2    squared length of the offset within the tangent plane.
template <class Real>
bool along_sheet(Real height2, Real flat2) {
  return height2 <= flat2;
}

/// Which surfels merging takes for different sheets of a surface.
struct SheetRules {
  /// Surfels are of another sheet whose normals are further than this from the normal that they
  /// would be merged to (a group's mean normal, or the normal of a cluster's seed), degrees, in
  /// (0, 90].
  double normal_angle = 40;
  /// How many times as much an offset along the normal counts as one along the surface, 1..1000:
  /// sheets that lie upon one another are told apart before one sheet is cut finer.
  double sheet_weight = 3;

  /// Cosine of normal_angle.
  SURFEL_API float least_cosine() const;
  SURFEL_API std::vector<std::string> problems() const;  ///< Empty if usable.
};

}  // namespace surfel
