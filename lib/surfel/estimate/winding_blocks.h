#pragma once

#include <memory>

#include <surfel/estimate/block_pass.h>
#include <surfel/estimate/stored_sides.h>

namespace surfel {

/// Finds the side of every point by the winding number, in a pass over all blocks of a cloud that
/// looks for normals alone. All processes find the normals of blocks; process 0 finds the sides,
/// and tells the other processes. Throws Error(kUsage) where there is too little memory for a tile.
std::unique_ptr<StoredSides> find_sides_by_winding(const BlockCloud& cloud);

}  // namespace surfel
