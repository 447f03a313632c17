#pragma once

#include <cstddef>

#include <surfel/base/export.h>
#include <surfel/sample/mesh_edges.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

/// Counts and measures of a mesh. Vertices at one position count as one but in `vertices`.
struct MeshStatistics {
  std::size_t vertices = 0;
  std::size_t faces = 0;
  std::size_t components = 0;  ///< Parts that no edge connects.
  EdgeCounts edges;
  double area = 0;  ///< Sum of the faces' areas, scene unit^2.
  Bounds bounds;    ///< Bounds of the vertices, world coordinates.
};

SURFEL_API MeshStatistics mesh_statistics(const TriangleMesh& mesh);

}  // namespace surfel
