#pragma once

#include <optional>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>

namespace surfel {

/// Corners, counter-clockwise, of the Voronoi cell of the origin among `neighbors`; nullopt where
/// the cell is open or reaches further than half of `reach`, the distance up to which all
/// neighbours are known: one further away could still cut it. Neighbours at the origin are ignored.
SURFEL_API std::optional<std::vector<Vec2d>> voronoi_cell(const std::vector<Vec2d>& neighbors,
                                                          double reach);

/// Area of a convex polygon given counter-clockwise.
SURFEL_API double polygon_area(const std::vector<Vec2d>& corners);

/// The point of a convex polygon for (s, t) in [0, 1)^2, uniform in area.
SURFEL_API Vec2d polygon_point(const std::vector<Vec2d>& corners, double s, double t);

}  // namespace surfel
