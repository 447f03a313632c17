#pragma once

#include <memory>

#include <surfel/base/types.h>
#include <surfel/surface/neighbor_search.h>

namespace surfel {

/// FLANN's KDTreeSingleIndex over the distinct positions; exact, or with eps = 1. All points'
/// neighbourhoods are searched for along a Morton curve. Between 40 and 60 bytes a point. `points`
/// are finite and outlive the search.
std::unique_ptr<NeighborSearch> make_flann_search(const Array<Vec3f>& points, bool approximate);

}  // namespace surfel
