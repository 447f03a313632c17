#pragma once

#include <span>

#include <surfel/base/export.h>
#include <surfel/sp06/group_cells.h>

namespace surfel {

/// One factor for all radii of a group.
struct Enlargement {
  double factor = 1;       ///< >= 1.
  int iterations = 0;      ///< Evaluations of the covered area.
  bool converged = false;  ///< The area was reached.
};

/// Solves SP06 (8), covered_area(radius, factor) = area, for a factor >= 1; 1 where more is covered
/// already. The covered area grows with the factor, continuously, so the root is bracketed by 1 and
/// the factor with which every disc covers its cell, and found by false position (Illinois) over
/// the logarithm of the factor, halved where that is slow. An area larger than that of the cells
/// cannot be reached: the factor is then the bracket's upper end, and `converged` false. `radius` >
/// 0, one a cell.
SURFEL_API Enlargement enlarge_by_bracketing(const GroupCells& cells, std::span<const float> radius,
                                             double area);

/// The paper's own iteration SP06 (9), n pi r_{s+1}^2 = A + sum of Clipped(r_s), until two factors
/// differ by less than 1e-4 of themselves, for comparison. It approaches a root slowly from below,
/// the slower the more the discs overlap; where A exceeds the area of the cells it has no fixed
/// point and the factor grows without limit, which is what `converged` = false after
/// `most_iterations` says.
SURFEL_API Enlargement enlarge_by_fixed_point(const GroupCells& cells,
                                              std::span<const float> radius, double area,
                                              int most_iterations);

}  // namespace surfel
