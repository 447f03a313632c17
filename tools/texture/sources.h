#pragma once

#include <optional>

#include <surfel/base/bounds.h>
#include <surfel/scene/triangle_mesh.h>
#include <surfel/texture/normal_maps.h>
#include <surfel/texture/solid_texture.h>
#include <surfel/texture/texture_fit.h>

#include "tools/support/tool.h"
#include "tools/texture/settings.h"

namespace surfel::texture_tool {

/// None where the options name no mesh.
std::optional<TriangleMesh> load_mesh(const Settings& s, const tool::Tool& tool);
TextureSet load_textures(Settings& s, const TriangleMesh* mesh);
/// \param bounds  of the surfels
SolidTexture make_solid(const Settings& s, const Bounds& bounds, tool::Tool& tool);
/// None where colours come from the surfels.
std::optional<NormalMaps> load_normals(const tool::CommandLine& app, Settings& s,
                                       const TriangleMesh* mesh);

/// A mesh without materials has no colours; its surfels may be given normals alone.
bool fits_colors(const Settings& s, const TriangleMesh* mesh);

}  // namespace surfel::texture_tool
