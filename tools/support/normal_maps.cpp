#include "tools/support/normal_maps.h"

#include <algorithm>

#include "tools/support/options.h"
#include "tools/support/tool.h"

namespace surfel::tool {

void add_normal_maps(CommandLine& app, NormalMapSettings& settings) {
  NormalMapOptions& maps = settings.maps;
  Option* normal_map =
      app.add_option("--normal-map", maps.normal_map,
                     "Image of normals in tangent space, which bend the surface's; default: "
                     "`norm` of the mesh's materials");
  Option* bump =
      app.add_option("--bump", maps.bump,
                     "Image of heights instead, or checker, siemens, noise, each also as "
                     "NAME:FREQUENCY; default: `bump` of the mesh's materials")
          ->excludes(normal_map);
  app.add_option("--bump-scale", maps.bump_scale,
                 "Height of white above black, scene units, < 0: dents; default: `-bm` "
                 "of the mesh's materials, else 1")
      ->excludes(normal_map);
  add_choice(app, "--normal-y", maps.y_down, {{"up", false}, {"down", true}},
             "Where green of normal maps points to in the image: up in OpenGL's, down "
             "in Direct3D's")
      ->excludes(bump);
  app.add_flag("--no-normal-maps", settings.left_out,
               "Leave out the maps that its materials name as norm and bump")
      ->excludes(normal_map)
      ->excludes(bump);
}

std::vector<std::string> normal_map_options() {
  return {"--normal-map", "--bump", "--bump-scale", "--normal-y", "--no-normal-maps"};
}

std::optional<NormalMaps> load_normal_maps(const CommandLine& app,
                                           const NormalMapSettings& settings,
                                           const TriangleMesh* mesh, const std::string& mesh_name) {
  std::optional<NormalMaps> maps;
  if (!settings.maps.empty() || (mesh && !settings.left_out)) {
    maps = load_normal_maps(settings.maps, mesh, mesh_name);
    if (maps->empty()) maps.reset();
  }
  const auto needs = [&](const std::string& option, ReliefKind kind, const std::string& what) {
    const bool has =
        maps && std::find(maps->kind.begin(), maps->kind.end(), kind) != maps->kind.end();
    if (!has) require_valid(without_effect(app, {option}, "where there is no " + what));
  };
  needs("--bump-scale", ReliefKind::kHeights, "bump map");
  needs("--normal-y", ReliefKind::kNormals, "normal map");
  if (!mesh) require_valid(without_effect(app, {"--no-normal-maps"}, "without --mesh"));
  return maps;
}

}  // namespace surfel::tool
