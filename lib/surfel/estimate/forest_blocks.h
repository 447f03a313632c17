#pragma once

#include <surfel/estimate/block_pass.h>
#include <surfel/estimate/forest_sides.h>

namespace surfel {

/// Finds the side of every point along the edges between points (kMst, kOutward), in a pass over
/// all blocks of a cloud, and one more over the points around which parts may be joined. All
/// processes find the edges of blocks; process 0 finds the sides, and tells the other processes.
TurnedPoints find_sides_along_surface(const BlockCloud& cloud);

}  // namespace surfel
