#include "tools/texture/sources.h"

#include <surfel/io/mesh_io.h>
#include <surfel/texture/texture_source.h>

#include "tools/support/normal_maps.h"

namespace surfel::texture_tool {

TextureSet load_textures(Settings& s, const TriangleMesh* mesh) {
  s.source.charts = !s.no_charts;
  s.source.whole = false;
  return surfel::load_textures(s.source, mesh, s.mesh);
}

SolidTexture make_solid(const Settings& s, const Bounds& bounds, tool::Tool& tool) {
  SolidTexture texture(s.solid, bounds);
  tool.report()["feature_size"] = texture.feature_size();
  return texture;
}

std::optional<NormalMaps> load_normals(const tool::CommandLine& app, Settings& s,
                                       const TriangleMesh* mesh) {
  if (s.from == From::kColors) return std::nullopt;
  s.normals.maps.wrap = s.source.wrap;
  s.normals.maps.charts = !s.no_charts;
  return tool::load_normal_maps(app, s.normals, mesh, s.mesh);
}

bool fits_colors(const Settings& s, const TriangleMesh* mesh) {
  if (s.from == From::kColors || !s.source.image.empty() || !s.solid_name.empty()) return true;
  if (s.normals.maps.empty()) return true;
  return mesh && !mesh->material.empty();
}

std::optional<TriangleMesh> load_mesh(const Settings& s, const tool::Tool& tool) {
  if (s.mesh.empty()) return std::nullopt;
  std::optional<TriangleMesh> mesh = read_mesh(s.mesh);
  for (const std::string& note : mesh->notes) tool.note(s.mesh + ": " + note);
  return mesh;
}

}  // namespace surfel::texture_tool
