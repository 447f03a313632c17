#include <surfel/measure/mesh_statistics.h>
#include <surfel/sample/mesh_edges.h>
#include <surfel/sample/mesh_face.h>

namespace surfel {

MeshStatistics mesh_statistics(const TriangleMesh& mesh) {
  MeshStatistics out;
  out.vertices = mesh.position.size();
  out.faces = mesh.face.size();
  const Array<std::uint32_t> rings = edge_rings(mesh);
  const Array<std::uint32_t> component = face_components(rings);
  for (std::size_t f = 0; f < mesh.face.size(); ++f) out.components += component[f] == f ? 1 : 0;
  out.edges = count_edges(mesh, rings);
  for (const Vec3f& p : mesh.position) out.bounds.add(mesh.origin + p.cast<double>());
  for (std::size_t f = 0; f < mesh.face.size(); ++f) {
    out.area += area_vector(face_corners(mesh, f)).norm() / 2;
  }
  return out;
}

}  // namespace surfel
