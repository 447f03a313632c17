#pragma once

#include <array>
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

/// The faces' vertices as welded_vertices() numbers them.
SURFEL_API Array<std::array<std::uint32_t, 3>> welded_faces(const TriangleMesh& mesh);

/// Faces, in ascending order, that have the three corners of a lower face in the same direction
/// around. Faces that name a corner twice are no repeats.
SURFEL_API Array<std::uint32_t> repeated_faces(const Array<std::array<std::uint32_t, 3>>& welded);

/// Which faces meet at an edge, vertices at the same position counting as one: element 3 f + k is
/// 3 * face + edge of the next face around edge k of face f (from corner k to corner k + 1), or
/// kBorderEdge. Two faces at an edge point at each other; more form a ring in ascending order.
SURFEL_API Array<std::uint32_t> edge_rings(const TriangleMesh& mesh);
/// The same of faces whose vertices are welded: vertices of different numbers lie at different
/// positions.
SURFEL_API Array<std::uint32_t> edge_rings(const Array<std::array<std::uint32_t, 3>>& face);

/// Makes edges borders at which more faces than `most` meet, so that a walk over a surface meets a
/// bounded number of faces beyond each edge.
SURFEL_API void cut_crowded_edges(Array<std::uint32_t>& rings, std::size_t most);

/// Edges of a mesh by the faces that meet there. Edges between vertices at one position are left
/// out.
struct EdgeCounts {
  std::size_t border = 0;        ///< Edges of a single face.
  std::size_t non_manifold = 0;  ///< Edges of three faces or more.
  std::size_t inconsistent = 0;  ///< Edges of two faces, of which one is seen from outside, the
                                 ///< other from inside.
  double border_length = 0;      ///< Scene units.
};

/// Counts the edges of a mesh by the faces that meet there.
/// \param mesh   Any triangles.
/// \param rings  edge_rings() of the mesh.
SURFEL_API EdgeCounts count_edges(const TriangleMesh& mesh, const Array<std::uint32_t>& rings);

/// Parts of the mesh that edges connect: for every face the lowest face of its part.
SURFEL_API Array<std::uint32_t> face_components(const Array<std::uint32_t>& rings);

}  // namespace surfel
