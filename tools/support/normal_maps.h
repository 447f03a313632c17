#pragma once

#include <optional>
#include <string>
#include <vector>

#include <surfel/scene/triangle_mesh.h>
#include <surfel/texture/normal_maps.h>

#include "tools/support/command_line.h"

namespace surfel::tool {

/// Options of normal and bump maps, and how add_normal_maps() declares them.
struct NormalMapSettings {
  NormalMapOptions maps;
  bool left_out = false;  ///< --no-normal-maps: those of the mesh's materials are not used.
};

/// Declares the options of normal and bump maps.
void add_normal_maps(CommandLine& app, NormalMapSettings& settings);

/// The names of these options.
std::vector<std::string> normal_map_options();

/// The maps that the options ask for, or the mesh's materials name; none where there are none.
/// Throws Error(kUsage) for options that have no effect on these maps, else as load_normal_maps().
std::optional<NormalMaps> load_normal_maps(const CommandLine& app,
                                           const NormalMapSettings& settings,
                                           const TriangleMesh* mesh, const std::string& mesh_name);

}  // namespace surfel::tool
