#include <surfel/base/plugin.h>
#include <surfel/measure/manifold_parts.h>
#include <surfel/measure/mesh_topology.h>
#include <surfel/measure/openmesh_plugin.h>

namespace surfel {

MeshTopology mesh_topology(const TriangleMesh& mesh, double crease_angle) {
  const auto measure =
      reinterpret_cast<MeasureHalfEdges*>(plugin_symbol("openmesh", kMeasureHalfEdgesSymbol));
  const ManifoldParts parts = manifold_parts(mesh);
  Array<Vec3d> position(parts.vertex.size());
  for (std::size_t v = 0; v < position.size(); ++v) {
    position[v] = mesh.position[parts.vertex[v]].cast<double>();
  }
  HalfEdgeReport report;
  measure({reinterpret_cast<const double*>(position.data()), position.size(),
           reinterpret_cast<const std::uint32_t*>(parts.face.data()), parts.face.size(),
           parts.is_border.data(), crease_angle},
          report);
  MeshTopology out;
  out.non_manifold_vertices = parts.non_manifold_vertices;
  out.non_orientable_components = parts.non_orientable_parts;
  out.non_manifold_places = parts.non_manifold_places;
  out.left_out_faces = parts.left_out_faces;
  out.turned_faces = parts.turned_faces;
  out.split_vertices = parts.split_vertices;
  out.components = report.components;
  out.border_loops = report.border_loops;
  out.longest_border = report.longest_border;
  out.crease_edges = report.crease_edges;
  out.crease_length = report.crease_length;
  out.euler_characteristic = report.euler_characteristic;
  if (report.open_edges == 0 && report.components > 0) {
    out.genus = static_cast<std::int64_t>(report.components) - report.euler_characteristic / 2;
  }
  return out;
}

}  // namespace surfel
