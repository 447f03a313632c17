#include <algorithm>
#include <filesystem>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/io/input_file.h>
#include <surfel/io/mesh.h>
#include <surfel/io/mesh_ply.h>
#include <surfel/io/obj.h>
#include <surfel/io/off.h>
#include <surfel/io/ply.h>
#include <surfel/io/stl.h>

namespace surfel {
namespace {

std::string lower_extension(const std::string& path) {
  std::string extension = std::filesystem::path(path).extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return extension;
}

/// Standard input has no extension; of the formats only OBJ has no mark of its own.
std::string extension_of_content(const InputFile& file) {
  const std::string_view text(reinterpret_cast<const char*>(file.bytes().data()),
                              file.bytes().size());
  if (PlyFile::matches(file.bytes())) return ".ply";
  if (text.substr(0, 5) == "solid") return ".stl";
  return text.substr(0, 5).find("OFF") != std::string_view::npos ? ".off" : ".obj";
}

}  // namespace

TriangleMesh read_mesh(const std::string& path) {
  InputFile file(path);
  if (file.bytes().empty()) throw_input(file.name(), "the file is empty");
  const std::string extension = path == "-" ? extension_of_content(file) : lower_extension(path);
  if (extension == ".obj") return read_obj(file);
  if (extension == ".ply") return read_ply_mesh(std::move(file));
  if (extension == ".stl") return read_stl(file);
  if (extension == ".off") return read_off(file);
  throw_input(path, fmt::format("'{}' is not a mesh format that is supported: .obj, .ply, .stl, "
                                ".off",
                                extension));
}

}  // namespace surfel
