#pragma once

#include <optional>

#include <surfel/io/ply.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Where the scanner stood that made a PLY file with an element `range_grid`, as Stanford's raw
/// scans have: rows and columns (obj_info num_cols, num_rows) of lists of at most one vertex. Such
/// scanners move past the object and look along parallel lines, so that they have a direction
/// rather than a place: the viewpoint is 100 diagonals of the scan away in that direction, which
/// the rows (to the right) and columns (upwards) give. Its orientation is a camera's: z forward, y
/// down. Nullopt where the file has no grid, or one that tells no direction. Internal to the io
/// module.
std::optional<Viewpoint> range_grid_viewpoint(PlyFile& ply, const SurfelCloud& cloud);

}  // namespace surfel
