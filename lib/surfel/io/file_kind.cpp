#include <algorithm>
#include <array>
#include <string_view>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/shell_quote.h>
#include <surfel/io/compressed_ply.h>
#include <surfel/io/e57_header.h>
#include <surfel/io/file_kind.h>
#include <surfel/io/gaussian_io.h>
#include <surfel/io/gaussian_ply.h>
#include <surfel/io/input_file.h>
#include <surfel/io/las_header.h>
#include <surfel/io/ply.h>
#include <surfel/io/ptx.h>
#include <surfel/io/spz.h>
#include <surfel/io/text_scanner.h>
#include <surfel/io/volume_io.h>
#include <surfel/io/xyz.h>

namespace surfel {
namespace {

constexpr std::array<std::string_view, 5> kMeshes = {".glb", ".gltf", ".obj", ".off", ".stl"};
constexpr std::array<std::string_view, 11> kImages = {
    ".bmp", ".exr", ".hdr", ".jpeg", ".jpg", ".pgm", ".png", ".ppm", ".tga", ".tif", ".tiff"};

/// A program that turns files of some formats into files that are read.
struct Converter {
  std::string_view extensions;  ///< Each between blanks.
  std::string_view command;     ///< The file's name goes between the two parts.
  std::string_view result;
  std::string_view program;
};
constexpr std::array<Converter, 2> kConverters = {{
    {" .3ds .3mf .dae .fbx .x3d ", "assimp export ", " mesh.obj", "Assimp, assimp-utils"},
    {" .lcc .sog ", "splat-transform ", " splats.ply", "PlayCanvas"},
}};

template <class Set>
bool contains(const Set& set, const std::string& value) {
  return std::find(set.begin(), set.end(), value) != set.end();
}

FileKind ply_kind(InputFile file) {
  const PlyFile ply(std::move(file));
  const auto count = [&](std::string_view element) {
    const PlyElement* found = ply.header().find(element);
    return found ? found->count : 0;
  };
  if (has_trained_gaussians(ply.header()) || has_packed_gaussians(ply.header())) {
    return FileKind::kGaussians;
  }
  if (count("face") > 0 || count("tristrips") > 0) return FileKind::kMesh;
  // Point clouds are often written with an empty list of faces; without points it is an empty mesh.
  const bool empty_mesh = ply.header().find("face") && count("vertex") == 0;
  return empty_mesh ? FileKind::kMesh : FileKind::kCloud;
}

}  // namespace

std::string converter_advice(const std::string& path) {
  const std::string extension = lower_extension(path);
  if (extension.empty()) return "";
  for (const Converter& c : kConverters) {
    if (c.extensions.find(" " + extension + " ") == std::string_view::npos) continue;
    return fmt::format("; `{}{}{}` converts it ({})", c.command, shell_file(path), c.result,
                       c.program);
  }
  return "";
}

void refuse_gaussians(const std::string& file) {
  throw_input(file,
              "holds Gaussians in space (trained splats), not surfels or points; surfel-render "
              "draws them, surfel-info describes them");
}

void refuse_volume(const std::string& file) {
  throw_input(file,
              "is a volume, not surfels or points; surfel-from-volume makes Gaussians of it, which "
              "surfel-render draws");
}

void refuse_copc_name(const std::string& path) {
  constexpr std::string_view kEnd = ".copc.laz";
  if (!lower_case(path).ends_with(kEnd)) return;
  throw_usage(
      fmt::format("{}: COPC is not written, and other programs take such a name for it; "
                  "write {}.laz",
                  path, path.substr(0, path.size() - kEnd.size())));
}

bool is_las_name(const std::string& path) {
  const std::string extension = lower_extension(path);
  return extension == ".las" || extension == ".laz";
}

bool is_e57_name(const std::string& path) { return lower_extension(path) == ".e57"; }

bool is_mesh_name(const std::string& path) { return contains(kMeshes, lower_extension(path)); }
bool is_image_name(const std::string& path) { return contains(kImages, lower_extension(path)); }

FileKind file_kind(const std::string& path) {
  if (path == "-") return FileKind::kCloud;
  InputFile file(path);
  if (file.size() == 0) throw_input(path, "is empty; make it anew");
  if (PlyFile::matches(file.head(4))) return ply_kind(std::move(file));
  const std::string extension = lower_extension(path);
  if (LasHeader::matches(file.head(4)) || is_las_name(path)) return FileKind::kCloud;
  if (E57Header::matches(file.head(8)) || is_e57_name(path)) return FileKind::kCloud;
  if (extension == ".pcd" || extension == ".ply" || is_xyz_name(path) || is_ptx_name(path)) {
    return FileKind::kCloud;
  }
  if (is_mesh_name(path)) return FileKind::kMesh;
  if (is_image_name(path)) return FileKind::kImage;
  if (is_splat_name(path) || is_spz(file)) return FileKind::kGaussians;
  if (is_volume_name(path)) return FileKind::kVolume;
  throw_input(path, std::string("format not supported; known are PLY, PCD, LAS, LAZ, E57, PTX and "
                                "text such as XYZ (surfels), "
                                "PLY, OBJ, OFF, STL and glTF (meshes), PLY, .splat, .spz "
                                "and .ksplat (Gaussians), NRRD and MetaImage (volumes) "
                                "and images") +
                        converter_advice(path));
}

}  // namespace surfel
