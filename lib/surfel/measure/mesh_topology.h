#pragma once

#include <cstddef>
#include <cstdint>
#include <numbers>
#include <optional>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

/// What keeps a mesh from being a manifold, how it was made one, and the figures of the manifold.
/// Vertices at one position count as one; lengths are in scene units.
struct MeshTopology {
  std::size_t non_manifold_vertices = 0;      ///< Vertices where sheets touch that no edge there
                                              ///< connects.
  std::size_t non_orientable_components = 0;  ///< Parts whose faces cannot all face one way, as of
                                              ///< a Moebius strip.
  std::vector<Vec3d> non_manifold_places;     ///< Middles of edges of three faces or more, then
                                              ///< vertices: the first 5, world coordinates.

  // The repair, which loses no face with area.
  std::size_t left_out_faces = 0;  ///< Faces with two corners at one place, or a corner that is not
                                   ///< finite.
  std::size_t turned_faces = 0;    ///< Faces turned over, so that each part faces one way.
  std::size_t split_vertices = 0;  ///< Vertices added, which part sheets that touch.

  // The manifold.
  std::size_t components = 0;
  std::size_t border_loops = 0;  ///< Closed loops of edges that end the surface: holes and
                                 ///< rims.
  double longest_border = 0;     ///< Length of the longest loop.
  std::size_t crease_edges = 0;  ///< Edges at which two faces meet at a larger angle than
                                 ///< asked for.
  double crease_length = 0;
  std::int64_t euler_characteristic = 0;  ///< Vertices - edges + faces.
  std::optional<std::int64_t> genus;      ///< Number of handles of all components together, where
                                          ///< the manifold is closed.
};

/// Cuts the mesh into a manifold (manifold_parts.h) and looks at it by the half-edges of OpenMesh,
/// a plug-in.
/// \param mesh          Any triangles.
/// \param crease_angle  Radians, 0 to pi.
///
/// Throws Error(kIo) where the plug-in is missing. A face takes about 2 microseconds and 300 bytes.
SURFEL_API MeshTopology mesh_topology(const TriangleMesh& mesh,
                                      double crease_angle = std::numbers::pi / 4);

}  // namespace surfel
