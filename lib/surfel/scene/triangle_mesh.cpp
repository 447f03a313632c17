#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {
namespace {

/// Throws Error(kInput) unless `index`, a face's entry in `field`, is a row of `table`.
void check_index(const std::string& name, std::size_t face, const char* field, std::size_t index,
                 const char* table, std::size_t rows) {
  if (index < rows) return;
  throw_input(name, fmt::format("`{}` of face {} of the mesh is {}; `{}` has {} rows", field, face,
                                index, table, rows));
}

}  // namespace

Vec3f TriangleMesh::color_at(std::size_t face_index, const Vec3f& b) const {
  const MeshMaterial* const of =
      face_material.empty() || material.empty() ? nullptr : &material[face_material[face_index]];
  Vec3f result(1, 1, 1);
  if (!color.empty()) {
    const auto& [v0, v1, v2] = face[face_index];
    result = b[0] * color[v0] + b[1] * color[v1] + b[2] * color[v2];
  }
  if (of && of->texture.empty() && (color.empty() || of->vertex_factor)) {
    result = result.cwiseProduct(of->diffuse);
  }
  return result;
}

void TriangleMesh::check_columns(const std::string& name) const {
  const auto check = [&](std::size_t size, std::size_t expected, const char* field) {
    if (size == 0 || size == expected) return;
    throw_input(
        name, fmt::format("`{}` of the mesh has {} values; {} are needed", field, size, expected));
  };
  check(color.size(), position.size(), "color");
  check(wedge_uv.size(), face.size(), "wedge_uv");
  check(wedge_normal.size(), face.size(), "wedge_normal");
  check(face_material.size(), face.size(), "face_material");
  for (std::size_t f = 0; f < face.size(); ++f) {
    for (const std::uint32_t vertex : face[f]) {
      check_index(name, f, "face", vertex, "position", position.size());
    }
  }
}

void TriangleMesh::check_materials(const std::string& name) const {
  for (std::size_t f = 0; f < face_material.size(); ++f) {
    check_index(name, f, "face_material", face_material[f], "material", material.size());
  }
}

}  // namespace surfel
