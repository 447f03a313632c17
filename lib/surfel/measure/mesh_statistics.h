#pragma once

#include <cstddef>

#include <surfel/base/export.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

/// Counts and measures of a mesh. Lengths are in scene units.
struct MeshStatistics {
  std::size_t vertices = 0;
  std::size_t faces = 0;
  std::size_t components = 0;          ///< Sets of faces that share vertices.
  std::size_t border_edges = 0;        ///< Edges of a single face.
  std::size_t non_manifold_edges = 0;  ///< Edges that three faces or more share.
  double area = 0;                     ///< Sum of the faces' areas, unit^2.
  Bounds bounds;                       ///< Bounds of the vertices, world coordinates.
};

SURFEL_API MeshStatistics mesh_statistics(const TriangleMesh& mesh);

}  // namespace surfel
