// Plug-in libsurfel_openmesh.so: the one place that sees OpenMesh.

#include <algorithm>
#include <cmath>
#include <vector>

// OpenMesh's headers are not clean under our warnings.
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wall"
#pragma GCC diagnostic ignored "-Wextra"
#pragma GCC diagnostic ignored "-Wdeprecated-declarations"
#include <OpenMesh/Core/Mesh/TriMesh_ArrayKernelT.hh>
#pragma GCC diagnostic pop
#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/export.h>
#include <surfel/measure/openmesh_plugin.h>

namespace surfel {
namespace {

using Mesh = OpenMesh::TriMesh_ArrayKernelT<OpenMesh::DefaultTraitsDouble>;

/// Faces and vertices have the numbers that they have in `in`.
void fill(const HalfEdgeMesh& in, Mesh& mesh) {
  mesh.reserve(in.vertices, in.vertices + in.faces, in.faces);
  for (std::size_t v = 0; v < in.vertices; ++v) {
    const double* p = in.position + 3 * v;
    mesh.add_vertex({p[0], p[1], p[2]});
  }
  for (std::size_t f = 0; f < in.faces; ++f) {
    Mesh::VertexHandle corner[3];
    for (std::size_t k = 0; k < 3; ++k) {
      corner[k] = Mesh::VertexHandle(static_cast<int>(in.face[3 * f + k]));
    }
    if (mesh.add_face(corner[0], corner[1], corner[2]).is_valid()) continue;
    throw Error(ErrorKind::kNumeric,
                fmt::format("OpenMesh takes no face {} of a mesh cut into manifold parts", f));
  }
}

/// Whether the edge of a half-edge without a face is a border of the file.
bool is_file_border(const HalfEdgeMesh& in, const Mesh& mesh, Mesh::HalfedgeHandle open) {
  const Mesh::HalfedgeHandle inner = mesh.opposite_halfedge_handle(open);
  const auto f = static_cast<std::size_t>(mesh.face_handle(inner).idx());
  const auto from = static_cast<std::uint32_t>(mesh.from_vertex_handle(inner).idx());
  const std::uint32_t* corner = std::find(in.face + 3 * f, in.face + 3 * f + 2, from);
  return in.is_border[corner - in.face] != 0;
}

void measure_borders(const HalfEdgeMesh& in, const Mesh& mesh, HalfEdgeReport& report) {
  std::vector<bool> seen(mesh.n_halfedges(), false);
  for (const Mesh::HalfedgeHandle start : mesh.halfedges()) {
    if (!mesh.is_boundary(start) || seen[start.idx()]) continue;
    double length = 0;
    bool of_file = false;
    for (Mesh::HalfedgeHandle h = start; !seen[h.idx()]; h = mesh.next_halfedge_handle(h)) {
      seen[h.idx()] = true;
      ++report.open_edges;
      if (!is_file_border(in, mesh, h)) continue;
      of_file = true;
      length += mesh.calc_edge_length(h);
    }
    report.border_loops += of_file ? 1 : 0;
    report.longest_border = std::max(report.longest_border, length);
  }
}

void measure_creases(double angle, Mesh& mesh, HalfEdgeReport& report) {
  mesh.request_face_normals();
  mesh.update_face_normals();
  // The normal of a face without area is zero.
  const auto has_normal = [&](Mesh::HalfedgeHandle h) {
    return mesh.normal(mesh.face_handle(h)).sqrnorm() > 0;
  };
  for (const Mesh::EdgeHandle e : mesh.edges()) {
    if (mesh.is_boundary(e)) continue;
    if (!has_normal(mesh.halfedge_handle(e, 0)) || !has_normal(mesh.halfedge_handle(e, 1)))
      continue;
    if (!(std::abs(mesh.calc_dihedral_angle_fast(e)) > angle)) continue;
    ++report.crease_edges;
    report.crease_length += mesh.calc_edge_length(e);
  }
}

std::size_t count_components(const Mesh& mesh) {
  std::size_t components = 0;
  std::vector<bool> seen(mesh.n_faces(), false);
  std::vector<Mesh::FaceHandle> waiting;
  for (const Mesh::FaceHandle start : mesh.faces()) {
    if (seen[start.idx()]) continue;
    ++components;
    seen[start.idx()] = true;
    waiting.push_back(start);
    while (!waiting.empty()) {
      const Mesh::FaceHandle f = waiting.back();
      waiting.pop_back();
      for (const Mesh::FaceHandle next : mesh.ff_range(f)) {
        if (seen[next.idx()]) continue;
        seen[next.idx()] = true;
        waiting.push_back(next);
      }
    }
  }
  return components;
}

}  // namespace
}  // namespace surfel

extern "C" SURFEL_API void surfel_measure_half_edges(const surfel::HalfEdgeMesh& mesh,
                                                     surfel::HalfEdgeReport& report);

extern "C" void surfel_measure_half_edges(const surfel::HalfEdgeMesh& mesh,
                                          surfel::HalfEdgeReport& report) {
  surfel::Mesh edges;
  surfel::fill(mesh, edges);
  report = {};
  report.components = surfel::count_components(edges);
  surfel::measure_borders(mesh, edges, report);
  surfel::measure_creases(mesh.crease_angle, edges, report);
  report.euler_characteristic = static_cast<std::int64_t>(edges.n_vertices()) -
                                static_cast<std::int64_t>(edges.n_edges()) +
                                static_cast<std::int64_t>(edges.n_faces());
}
