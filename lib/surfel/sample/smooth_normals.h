#pragma once

#include <array>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

/// Unit normals per wedge: the mean of the normals of the faces that meet at the wedge's vertex
/// (vertices at the same position count as one), weighted by their angles there (Thuermer and
/// Wuethrich 1998, "Computing vertex normals from polygonal facets"). Only faces within
/// `crease_angle` (radians) of the wedge's own face take part, so that sharp edges stay sharp; at
/// vertices of more than 256 faces all faces take part. A face without area takes no part, and its
/// wedges have the mean of the other faces; the normal is zero where no face defines it.
SURFEL_API Array<std::array<Vec3f, 3>> smooth_normals(const TriangleMesh& mesh,
                                                      double crease_angle);

}  // namespace surfel
