#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>

namespace surfel {

/// Splits a simple polygon in space into corners.size() - 2 triangles of the same winding, given by
/// corner numbers and appended to `triangles`: a fan where it is convex, otherwise ears are clipped
/// (Meisters 1975, "Polygons have ears") in the coordinate plane that its normal (Newell's) is
/// nearest to. Corners on a straight line and bridges to holes are allowed; of polygons that cross
/// themselves only the number of triangles is right. Cost: corners times reflex corners.
SURFEL_API void triangulate_polygon(std::span<const Vec3d> corners,
                                    std::vector<std::array<std::uint32_t, 3>>& triangles);

}  // namespace surfel
