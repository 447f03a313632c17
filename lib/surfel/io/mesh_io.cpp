#include <algorithm>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/io/gltf.h>
#include <surfel/io/input_file.h>
#include <surfel/io/mesh_io.h>
#include <surfel/io/mesh_writers.h>
#include <surfel/io/obj.h>
#include <surfel/io/off.h>
#include <surfel/io/ply.h>
#include <surfel/io/ply_mesh.h>
#include <surfel/io/stl.h>
#include <surfel/io/text_scanner.h>

namespace surfel {
namespace {

/// Standard input has no extension; OBJ has no mark of its own.
std::string extension_of_content(const InputFile& file) {
  const std::string_view text = as_text(file.head(5));
  if (text.starts_with("glTF") || text.starts_with("{")) return ".gltf";
  if (PlyFile::matches(file.head(4))) return ".ply";
  if (text == "solid") return ".stl";
  return text.find("OFF") != std::string_view::npos ? ".off" : ".obj";
}

/// Writers rely on what readers guarantee; meshes may also come from a program.
void check(const TriangleMesh& mesh, const std::string& path) {
  mesh.check_columns(path);
  mesh.check_materials(path);
  if (!mesh.material.empty() && !mesh.face.empty() && mesh.face_material.empty()) {
    throw_input(path, "the mesh has materials, but no `face_material`");
  }
  for (const EmbeddedImage& image : mesh.embedded) {
    throw_input(path, fmt::format("the mesh holds {} itself, and files of this format name images; "
                                  "write the image to a file of its own and name that",
                                  image.name));
  }
}

TriangleMesh read_format(InputFile file, const std::string& extension) {
  if (file.size() == 0) throw_input(file.name(), "is empty; make it anew");
  if (extension == ".obj") return read_obj(file);
  if (extension == ".ply") return read_ply_mesh(std::move(file));
  if (extension == ".stl") return read_stl(file);
  if (extension == ".off") return read_off(file);
  if (extension == ".gltf" || extension == ".glb") return read_gltf(std::move(file));
  throw_input(file.name(),
              fmt::format("'{}' is not a mesh format that is supported; use .obj, .ply, .stl, "
                          ".off, .gltf or .glb",
                          extension));
}

}  // namespace

TriangleMesh read_mesh(const std::string& path) {
  InputFile file(path);
  const std::string extension = path == "-" ? extension_of_content(file) : lower_extension(path);
  return read_format(std::move(file), extension);
}

TriangleMesh read_mesh(InputFile file) {
  const std::string extension = lower_extension(file.name());
  return read_format(std::move(file), extension);
}

void write_mesh(const TriangleMesh& mesh, const std::string& path,
                const MeshWriteOptions& options) {
  check(mesh, path);
  const std::string extension = lower_extension(path);
  if (extension == ".obj") {
    write_obj(mesh, path, options);
  } else if (extension == ".ply" || path == "-") {
    write_ply_mesh(mesh, path, options);
  } else {
    throw_usage(fmt::format(
        "{}: '{}' is not a mesh format that can be written; choose .obj or .ply", path, extension));
  }
}

}  // namespace surfel
