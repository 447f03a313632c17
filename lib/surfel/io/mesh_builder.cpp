#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/io/mesh_builder.h>
#include <surfel/io/triangulate.h>
#include <surfel/io/unit_vector.h>

namespace surfel {
namespace {

/// Coordinates that are larger than this many extents would lose six of float's 24 bits.
constexpr double kFarAway = 64;

bool has_area(const Vec3f& a, const Vec3f& b, const Vec3f& c) {
  const Vec3d base = a.cast<double>();
  const Vec3d normal = (b.cast<double>() - base).cross(c.cast<double>() - base);
  return !normal.isZero(0);
}

}  // namespace

void MeshBuilder::add_polygon(std::span<const Corner> corners, std::uint16_t polygon_material) {
  corner_.insert(corner_.end(), corners.begin(), corners.end());
  size_.push_back(static_cast<std::uint32_t>(corners.size()));
  material_of_.push_back(polygon_material);
}

void MeshBuilder::center_positions(TriangleMesh& mesh) {
  Vec3d low = position[0];
  Vec3d high = position[0];
  for (const Vec3d& p : position) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const double extent = (high - low).maxCoeff();
  const double largest = std::max(-low.minCoeff(), high.maxCoeff());
  if (!(largest <= std::numeric_limits<float>::max())) {
    throw_input(file_, fmt::format("a coordinate of {} is beyond single precision; scale the mesh "
                                   "down",
                                   largest));
  }
  // A float is exact in double, and in text with few digits.
  if (double_positions || largest > kFarAway * extent) {
    mesh.origin = ((low + high) / 2).cast<float>().cast<double>();
  }
  mesh.position.resize(position.size());
  for (std::size_t i = 0; i < position.size(); ++i) {
    mesh.position[i] = (position[i] - mesh.origin).cast<float>();
  }
}

void MeshBuilder::add_triangle(TriangleMesh& mesh, const std::array<Corner, 3>& corners,
                               std::uint16_t face_material) {
  const auto& [a, b, c] = corners;
  if (!has_area(mesh.position[a.vertex], mesh.position[b.vertex], mesh.position[c.vertex])) {
    ++mesh.degenerate_faces;
    return;
  }
  mesh.face.push_back({a.vertex, b.vertex, c.vertex});
  if (!uv.empty()) {
    std::array<Vec2f, 3> wedge;
    for (std::size_t i = 0; i < 3; ++i) {
      const bool known = corners[i].uv != kNone;
      wedge[i] = known ? uv[corners[i].uv] : Vec2f::Zero();
      any_uv_ |= known;
    }
    mesh.wedge_uv.push_back(wedge);
  }
  if (!normal.empty() && all_normals_) {
    std::array<Vec3f, 3> wedge;
    for (std::size_t i = 0; i < 3; ++i) {
      wedge[i] =
          corners[i].normal != kNone ? unit_or_zero(normal[corners[i].normal]) : Vec3f::Zero();
      all_normals_ &= !wedge[i].isZero(0);
    }
    mesh.wedge_normal.push_back(wedge);
  }
  if (!material.empty()) mesh.face_material.push_back(face_material);
}

void MeshBuilder::triangulate(TriangleMesh& mesh) {
  mesh.face.reserve(size_.size());
  std::vector<Vec3d> polygon;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  const Corner* corner = corner_.data();
  for (std::size_t i = 0; i < size_.size(); corner += size_[i], ++i) {
    if (size_[i] == 3) {
      add_triangle(mesh, {corner[0], corner[1], corner[2]}, material_of_[i]);
      continue;
    }
    polygon.clear();
    for (std::uint32_t k = 0; k < size_[i]; ++k) polygon.push_back(position[corner[k].vertex]);
    triangles.clear();
    triangulate_polygon(polygon, triangles);
    for (const auto& [a, b, c] : triangles) {
      add_triangle(mesh, {corner[a], corner[b], corner[c]}, material_of_[i]);
    }
  }
}

TriangleMesh MeshBuilder::finish() {
  if (size_.empty()) {
    throw_input(file_, position.empty()
                           ? "the mesh is empty: it has neither vertices nor faces"
                           : fmt::format("the mesh has {} points and no face; a surface is needed "
                                         "here",
                                         position.size()));
  }
  if (position.size() >= kNone)
    throw_input(file_, "more than 4294967294 vertices are not supported");
  TriangleMesh mesh;
  center_positions(mesh);
  triangulate(mesh);
  if (mesh.face.empty()) {
    throw_input(file_, fmt::format("none of the {} faces has an area", mesh.degenerate_faces));
  }
  if (!any_uv_) mesh.wedge_uv = {};
  if (!all_normals_) mesh.wedge_normal = {};
  mesh.color = std::move(color);
  mesh.material = std::move(material);
  return mesh;
}

}  // namespace surfel
