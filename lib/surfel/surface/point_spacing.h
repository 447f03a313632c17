#pragma once

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/surface/neighbor_search.h>

namespace surfel {

/// Median spacing of points on a surface: the side of the square that each has to itself. It is
/// told from the distance r_k to the k-th nearest other point, whose median is
/// sqrt((k - 1/3) / (pi density)) for points scattered at random; grids are up to a fifth off. Up
/// to 4096 points, spread evenly along the array, are looked at. 0 where there are fewer than two
/// points or half of them lie on others.
///
/// \param search  searches `points`.
SURFEL_API double point_spacing(const Array<Vec3f>& points, const NeighborSearch& search);

}  // namespace surfel
