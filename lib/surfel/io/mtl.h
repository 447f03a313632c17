#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/io/input_file.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

// All functions are internal to the io module.

/// A material of an MTL file, and how it moves texture coordinates: uv * scale + offset.
struct MtlMaterial {
  MeshMaterial material;
  Vec2f uv_scale{1, 1};   ///< map_Kd's -s.
  Vec2f uv_offset{0, 0};  ///< map_Kd's -o.

  bool moves_uv() const { return uv_scale != Vec2f(1, 1) || !uv_offset.isZero(0); }
};

/// Reads the materials of a Wavefront MTL file: name, Kd, map_Kd with its options -s, -o and
/// -clamp, norm, and bump (also map_bump) with its option -bm. The images' names become paths
/// (named_path()). Exported for tests.
SURFEL_API std::vector<MtlMaterial> read_mtl(const InputFile& file);

/// The name of a texture for a file in `folder`: relative to the folder if the texture lies in it
/// or below, so that both can be moved together; otherwise the texture's whole path.
std::string texture_name_from(const std::filesystem::path& folder, const std::string& texture);

}  // namespace surfel
