#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

/// Value of edge_rings() for edges of a single face.
inline constexpr std::uint32_t kBorderEdge = std::numeric_limits<std::uint32_t>::max();

/// For every vertex the lowest one at the same position.
SURFEL_API Array<std::uint32_t> welded_vertices(const Array<Vec3f>& position);

/// Which faces meet at an edge, vertices at the same position counting as one: element 3 f + k is
/// 3 * face + edge of the next face around edge k of face f (from corner k to corner k + 1), or
/// kBorderEdge. Two faces at an edge point at each other; more form a ring in ascending order.
SURFEL_API Array<std::uint32_t> edge_rings(const TriangleMesh& mesh);

/// Parts of the mesh that edges connect: for every face the lowest face of its part.
SURFEL_API Array<std::uint32_t> face_components(const Array<std::uint32_t>& rings);

}  // namespace surfel
