#pragma once

#include <memory>

#include <surfel/base/types.h>
#include <surfel/surface/neighbor_search.h>

namespace surfel {

/// Function of the plug-in libsurfel_flann.so: makes a search by FLANN's KDTreeSingleIndex over the
/// distinct positions: exact, or approximate with FLANN's eps = 1. Searches for all points go along
/// a Morton curve. Memory: 40 to 60 bytes a point. `points` are finite and outlive the search.
using MakeFlannSearch = void(const Array<Vec3f>& points, bool approximate,
                             std::unique_ptr<NeighborSearch>& search);

inline constexpr char kMakeFlannSearchSymbol[] = "surfel_make_flann_search";

}  // namespace surfel
