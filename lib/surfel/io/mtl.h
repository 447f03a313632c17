#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/io/input_file.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

// All functions are internal to the io module.

/// Reads the materials of a Wavefront MTL file: name, Kd, map_Kd, norm, and bump
/// (also map_bump) with its option -bm. The images' names are resolved
/// against the file's folder. Exported for tests.
SURFEL_API std::vector<MeshMaterial> read_mtl(const InputFile& file);

/// The path of a regular file that `name` means as seen from `folder`: the name as it is written,
/// with a Windows path's backslashes turned, or its last part alone, because files are often moved
/// without their folders. Nullopt if none of the three exists.
std::optional<std::string> find_beside(const std::filesystem::path& folder, std::string_view name);

/// find_beside(), or the path of `name` in the folder if there is no file.
std::string resolve_texture(const std::filesystem::path& folder, std::string_view name);

/// The name of a texture for a file in `folder`: relative to the folder if the texture lies in it
/// or below, so that both can be moved together; otherwise the texture's whole path.
std::string texture_name_from(const std::filesystem::path& folder, const std::string& texture);

}  // namespace surfel
