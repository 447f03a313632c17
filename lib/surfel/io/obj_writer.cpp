#include <filesystem>
#include <optional>
#include <set>

#include <fmt/format.h>
#include <surfel/base/color.h>
#include <surfel/io/mesh_io.h>
#include <surfel/io/mesh_writers.h>
#include <surfel/io/mtl.h>
#include <surfel/io/record_writer.h>
#include <surfel/io/unique_vectors.h>

namespace surfel {
namespace {

namespace fs = std::filesystem;

/// Names of the materials. OBJ tells materials apart by name, so a material without a name, or with
/// the name of an earlier one, gets a new name.
std::vector<std::string> material_names(const TriangleMesh& mesh) {
  std::vector<std::string> names;
  std::set<std::string> used;
  for (const MeshMaterial& material : mesh.material) {
    std::string name = material.name;
    for (std::size_t i = names.size(); name.empty() || used.contains(name); ++i) {
      name = fmt::format("{}material_{}", material.name.empty() ? "" : material.name + "_", i);
    }
    used.insert(name);
    names.push_back(std::move(name));
  }
  return names;
}

void write_materials(const TriangleMesh& mesh, const std::vector<std::string>& names,
                     const fs::path& folder, RecordWriter& out) {
  for (std::size_t i = 0; i < mesh.material.size(); ++i) {
    out.add_text("newmtl ");
    out.add_text(names[i]);
    out.end_line();
    out.add_vector("Kd", mesh.material[i].diffuse);
    out.end_line();
    const MeshMaterial& material = mesh.material[i];
    const auto add_image = [&](const std::string& statement, const std::string& image) {
      if (image.empty()) return;
      out.add_text(statement);
      out.add_text(texture_name_from(folder, image));
      out.end_line();
    };
    add_image("map_Kd ", material.texture);
    add_image("norm ", material.normal_map);
    add_image(fmt::format("bump -bm {} ", material.bump_scale), material.bump_map);
  }
  out.flush();
}

/// Writes a centred coordinate as the double that origin and offset add up to, another one as
/// float.
void write_vertices(const TriangleMesh& mesh, RecordWriter& out) {
  const bool centred = mesh.origin != Vec3d::Zero();
  for (std::size_t i = 0; i < mesh.position.size(); ++i) {
    if (centred) {
      out.add_vector("v", (mesh.origin + mesh.position[i].cast<double>()).eval());
    } else {
      out.add_vector("v", mesh.position[i]);
    }
    if (!mesh.color.empty()) {
      out.add_vector("", mesh.color[i].unaryExpr([](float c) { return linear_to_srgb(c); }).eval());
    }
    out.end_line();
  }
}

template <int kSize>
Array<std::array<std::uint32_t, 3>> write_wedges(
    const Array<std::array<Eigen::Matrix<float, kSize, 1>, 3>>& wedges, const char* keyword,
    RecordWriter& out) {
  UniqueVectors<kSize> unique;
  Array<std::array<std::uint32_t, 3>> index(wedges.size());
  for (std::size_t i = 0; i < wedges.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) index[i][k] = unique.index_of(wedges[i][k]);
  }
  for (const auto& value : unique.values()) {
    out.add_vector(keyword, value);
    out.end_line();
  }
  return index;
}

void write_faces(const TriangleMesh& mesh, const std::vector<std::string>& names,
                 RecordWriter& out) {
  const auto uv = write_wedges(mesh.wedge_uv, "vt", out);
  const auto normal = write_wedges(mesh.wedge_normal, "vn", out);
  for (std::size_t i = 0; i < mesh.face.size(); ++i) {
    const bool new_material = !mesh.face_material.empty() &&
                              (i == 0 || mesh.face_material[i] != mesh.face_material[i - 1]);
    if (new_material) {
      out.add_text("usemtl ");
      out.add_text(names[mesh.face_material[i]]);
      out.end_line();
    }
    out.add_text('f');
    for (std::size_t k = 0; k < 3; ++k) {
      out.add_text(' ');
      out.add_number(mesh.face[i][k] + std::uint64_t{1});
      if (uv.empty() && normal.empty()) continue;
      out.add_text('/');
      if (!uv.empty()) out.add_number(uv[i][k] + std::uint64_t{1});
      if (normal.empty()) continue;
      out.add_text('/');
      out.add_number(normal[i][k] + std::uint64_t{1});
    }
    out.end_line();
  }
  out.flush();
}

}  // namespace

void write_obj(const TriangleMesh& mesh, const std::string& path, const MeshWriteOptions& options) {
  const std::vector<std::string> names = material_names(mesh);
  OutputFile file(path, options.no_clobber);
  RecordWriter out(file);
  std::optional<OutputFile> material_file;
  if (!mesh.material.empty()) {
    const fs::path beside = fs::path(path).replace_extension(".mtl");
    RecordWriter materials(material_file.emplace(beside.string(), options.no_clobber));
    write_materials(mesh, names, fs::absolute(beside).parent_path(), materials);
    out.add_text("mtllib " + beside.filename().string());
    out.end_line();
  }
  write_vertices(mesh, out);
  write_faces(mesh, names, out);
  if (material_file) material_file->commit();
  file.commit();
}

}  // namespace surfel
