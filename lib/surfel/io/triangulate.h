#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>

namespace surfel {

/// Splits a simple polygon in space into corners.size() - 2 triangles with the polygon's winding,
/// given by corner numbers and appended to `triangles`. A convex polygon becomes a fan; from
/// another one ears are clipped (Meisters 1975, "Polygons have ears") in the coordinate plane that
/// the polygon's normal (Newell's) is most perpendicular to. Corners on a straight line and bridges
/// to holes are allowed; for a polygon that crosses itself only the number of triangles is right.
/// Cost: corners times reflex corners.
SURFEL_API void triangulate_polygon(std::span<const Vec3d> corners,
                                    std::vector<std::array<std::uint32_t, 3>>& triangles);

}  // namespace surfel
