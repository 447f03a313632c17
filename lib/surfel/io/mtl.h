#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <surfel/io/input_file.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

/// Materials of a Wavefront MTL file: name, Kd, map_Kd; the textures' names are resolved against
/// the file's folder. Internal to the io module.
std::vector<MeshMaterial> read_mtl(const InputFile& file);

/// The regular file of that name as seen from `folder`: as it is written, with a Windows path's
/// backslashes turned, or by its last part alone, as files are often moved without their folders.
std::optional<std::string> find_beside(const std::filesystem::path& folder, std::string_view name);

/// find_beside(), or the name in the folder where there is no such file.
std::string resolve_texture(const std::filesystem::path& folder, std::string_view name);

/// What to call a texture in a file in `folder`: its name as seen from there where it lies in the
/// folder or below, so that both can be moved together; otherwise its whole path.
std::string texture_name_from(const std::filesystem::path& folder, const std::string& texture);

}  // namespace surfel
