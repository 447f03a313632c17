#include <algorithm>
#include <vector>

#include <surfel/base/disjoint_sets.h>
#include <surfel/base/radix_sort.h>
#include <surfel/measure/mesh_statistics.h>
#include <surfel/sample/mesh_face.h>

namespace surfel {
namespace {

std::size_t count_components(const TriangleMesh& mesh) {
  DisjointSets sets(mesh.position.size());
  std::vector<bool> used(mesh.position.size(), false);
  for (const auto& [a, b, c] : mesh.face) {
    sets.unite(a, b);
    sets.unite(b, c);
    used[a] = used[b] = used[c] = true;
  }
  std::size_t count = 0;
  for (std::uint32_t i = 0; i < used.size(); ++i) count += used[i] && sets.root(i) == i ? 1 : 0;
  return count;
}

void count_edges(const TriangleMesh& mesh, MeshStatistics& out) {
  Array<std::uint64_t> edges;
  edges.reserve(3 * mesh.face.size());
  for (const auto& face : mesh.face) {
    for (int corner = 0; corner < 3; ++corner) {
      const auto [low, high] = std::minmax(face[corner], face[(corner + 1) % 3]);
      edges.push_back(std::uint64_t{high} << 32 | low);
    }
  }
  sort_keys(edges);
  for (std::size_t begin = 0; begin < edges.size();) {
    std::size_t end = begin + 1;
    while (end < edges.size() && edges[end] == edges[begin]) ++end;
    if (end - begin == 1) ++out.border_edges;
    if (end - begin > 2) ++out.non_manifold_edges;
    begin = end;
  }
}

}  // namespace

MeshStatistics mesh_statistics(const TriangleMesh& mesh) {
  MeshStatistics out;
  out.vertices = mesh.position.size();
  out.faces = mesh.face.size();
  out.components = count_components(mesh);
  count_edges(mesh, out);
  for (const Vec3f& p : mesh.position) out.bounds.add(mesh.origin + p.cast<double>());
  for (std::size_t f = 0; f < mesh.face.size(); ++f) {
    out.area += area_vector(face_corners(mesh, f)).norm() / 2;
  }
  return out;
}

}  // namespace surfel
