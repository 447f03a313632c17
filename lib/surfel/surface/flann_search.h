#pragma once

#include <memory>

#include <surfel/base/types.h>
#include <surfel/surface/neighbor_search.h>

namespace surfel {

/// Search by FLANN's KDTreeSingleIndex over the distinct positions: exact, or approximate with
/// FLANN's eps = 1. Searches for all points go along a Morton curve. Memory: 40 to 60 bytes a
/// point. `points` are finite and outlive the search.
std::unique_ptr<NeighborSearch> make_flann_search(const Array<Vec3f>& points, bool approximate);

}  // namespace surfel
