#include <bit>
#include <filesystem>

#include <fmt/format.h>
#include <surfel/base/color.h>
#include <surfel/io/mesh_io.h>
#include <surfel/io/mesh_writers.h>
#include <surfel/io/mtl.h>
#include <surfel/io/record_writer.h>

namespace surfel {
namespace {

static_assert(std::endian::native == std::endian::little, "values are written as they are");

/// Is every coordinate, the origin added, exact as float?
bool exact_in_float(const TriangleMesh& mesh) {
  if (mesh.origin == Vec3d::Zero()) return true;
  for (const Vec3f& p : mesh.position) {
    const Vec3d world = mesh.origin + p.cast<double>();
    if (world != world.cast<float>().cast<double>()) return false;
  }
  return true;
}

/// The normal of each vertex where its wedges agree; empty if any do not.
Array<Vec3f> vertex_normals(const TriangleMesh& mesh) {
  if (mesh.wedge_normal.empty()) return {};
  Array<Vec3f> normal(mesh.position.size(), Vec3f::Zero());
  for (std::size_t i = 0; i < mesh.face.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      Vec3f& shared = normal[mesh.face[i][k]];
      if (shared.isZero(0)) shared = mesh.wedge_normal[i][k];
      if (shared != mesh.wedge_normal[i][k]) return {};
    }
  }
  return normal;
}

/// Number of each material's texture among the file's, -1 for none; and the comments that name
/// them.
struct Textures {
  Textures(const std::vector<MeshMaterial>& materials, const std::filesystem::path& folder) {
    for (const MeshMaterial& material : materials) {
      number.push_back(material.texture.empty() ? -1 : count++);
      if (material.texture.empty()) continue;
      comments += "comment TextureFile " + texture_name_from(folder, material.texture) + "\n";
    }
  }
  std::int32_t count = 0;
  std::vector<std::int32_t> number;
  std::string comments;
};

void write_vertices(const TriangleMesh& mesh, const Array<Vec3f>& normal, bool wide,
                    RecordWriter& out) {
  for (std::size_t i = 0; i < mesh.position.size(); ++i) {
    const Vec3d world = mesh.origin + mesh.position[i].cast<double>();
    for (const double x : world) wide ? out.add_bytes(x) : out.add_bytes(static_cast<float>(x));
    if (!normal.empty()) {
      for (const float x : normal[i]) out.add_bytes(x);
    }
    if (!mesh.color.empty()) {
      for (const float c : mesh.color[i]) out.add_bytes(linear_to_srgb8(c));
    }
    out.end_record();
  }
}

void write_faces(const TriangleMesh& mesh, const Textures& textures, RecordWriter& out) {
  for (std::size_t i = 0; i < mesh.face.size(); ++i) {
    out.add_bytes(std::uint8_t{3});
    for (const std::uint32_t vertex : mesh.face[i]) out.add_bytes(vertex);
    if (!mesh.wedge_uv.empty()) {
      out.add_bytes(std::uint8_t{6});
      for (const Vec2f& uv : mesh.wedge_uv[i]) {
        out.add_bytes(uv.x());
        out.add_bytes(uv.y());
      }
    }
    if (textures.count > 0) out.add_bytes(textures.number[mesh.face_material[i]]);
    out.end_record();
  }
  out.flush();
}

}  // namespace

void write_ply_mesh(const TriangleMesh& mesh, const std::string& path,
                    const MeshWriteOptions& options) {
  // A name without a folder has an empty parent, which no path is relative to.
  const Textures textures(mesh.material, std::filesystem::absolute(path).parent_path());
  const Array<Vec3f> normal = vertex_normals(mesh);
  const bool wide = !exact_in_float(mesh);
  std::string header = "ply\nformat binary_little_endian 1.0\n" + textures.comments;
  header += fmt::format("element vertex {}\n", mesh.position.size());
  for (const char* axis : {"x", "y", "z"}) {
    header += fmt::format("property {} {}\n", wide ? "double" : "float", axis);
  }
  if (!normal.empty()) header += "property float nx\nproperty float ny\nproperty float nz\n";
  if (!mesh.color.empty()) {
    header += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
  }
  header +=
      fmt::format("element face {}\nproperty list uchar uint vertex_indices\n", mesh.face.size());
  if (!mesh.wedge_uv.empty()) header += "property list uchar float texcoord\n";
  if (textures.count > 0) header += "property int texnumber\n";
  header += "end_header\n";

  OutputFile file(path, options.no_clobber);
  file.write(header);
  RecordWriter out(file);
  write_vertices(mesh, normal, wide, out);
  write_faces(mesh, textures, out);
  file.commit();
}

}  // namespace surfel
