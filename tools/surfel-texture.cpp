// surfel-texture: the coefficients of a texture for surfels.

#include <optional>
#include <string>

#include <fmt/format.h>
#include <surfel/base/memory.h>
#include <surfel/base/progress.h>
#include <surfel/base/timing.h>
#include <surfel/texture/fit_blocks.h>
#include <surfel/texture/normal_fit.h>
#include <surfel/texture/surface_lookup.h>

#include "tools/support/surfels.h"
#include "tools/support/tool.h"
#include "tools/texture/blocks.h"
#include "tools/texture/messages.h"
#include "tools/texture/settings.h"
#include "tools/texture/sources.h"

namespace {

using surfel::texture_tool::From;
using surfel::texture_tool::Settings;

surfel::TextureFitReport make_fit(surfel::SurfelCloud& cloud, const surfel::TriangleMesh* mesh,
                                  Settings& s, surfel::tool::Tool& tool) {
  surfel::ProgressStage stage("fitting", cloud.size(), "surfels");
  s.fit.progress = [&stage](double share) { stage.set_share(share); };
  if (s.from == From::kColors) return surfel::fit_coefficients(cloud, {}, s.fit, s.input);
  if (!s.solid_name.empty()) {
    const surfel::SolidTexture solid = surfel::texture_tool::make_solid(s, cloud.bounds(), tool);
    return surfel::fit_coefficients(cloud, {.solid = &solid}, s.fit, s.input);
  }
  surfel::TextureSet textures = surfel::texture_tool::load_textures(s, mesh);
  return surfel::fit_coefficients(cloud, {.textures = &textures}, s.fit, s.input);
}

void texture_in_memory(surfel::tool::Tool& tool, Settings& s) {
  const surfel::Timer timer;
  surfel::SurfelCloud cloud = surfel::tool::read_finest(tool, s.input);
  const std::optional<surfel::TriangleMesh> mesh = surfel::texture_tool::load_mesh(s, tool);
  if (mesh) surfel::texture_tool::check_mesh(cloud, *mesh, s, tool);
  if (mesh && cloud.uv.empty()) {
    surfel::texture_tool::tell_located(surfel::locate_on_mesh(cloud, *mesh, s.mesh), cloud.size(),
                                       s, tool);
  }
  tool.report()["load_ms"] = timer.milliseconds();

  const surfel::TriangleMesh* const surface = mesh ? &*mesh : nullptr;
  std::optional<surfel::NormalMaps> normals =
      surfel::texture_tool::load_normals(tool.app(), s, surface);
  if (surfel::texture_tool::fits_colors(s, surface)) {
    surfel::texture_tool::tell_fit(make_fit(cloud, surface, s, tool), !cloud.area.empty(), s, tool);
    if (s.from != From::kColors) surfel::show_coefficients(cloud);
  } else {
    surfel::texture_tool::refuse_fits(tool.app());
  }
  if (normals) {
    surfel::texture_tool::tell_normals(surfel::fit_normals(cloud, *normals, s.fit, s.input),
                                       cloud.size(), s, tool);
  }
  surfel::tool::write_result(tool, cloud, s.output);
  tool.wrote(s.output, fmt::format("{} surfels", cloud.size()));
}

}  // namespace

int main(int argc, char** argv) {
  surfel::tool::Tool tool("surfel-texture",
                          "Gives surfels the coefficients w_k of a texture, filtered for each.");
  Settings settings;
  surfel::texture_tool::declare_options(tool.app(), settings);
  tool.everyday(
      {"--output", "--image", "--mesh", "--fit", "--from", "--cutoff", "--solid", "--normal-map",
       "--bump", "--bump-scale", "--memory"},
      {"surfel-texture lion.ply --image lion.png -o textured.ply",
       "surfel-texture lion.ply --mesh lion.obj --fit render -o textured.ply",
       "surfel-texture lion.ply --solid marble:9 --light white --dark gray -o marble.ply"});
  tool.reads_images();
  tool.reads_named_files();
  tool.files().reads({"surfels", "--image", "--mesh", "--normal-map", "--bump"});
  tool.files().writes("--output", surfel::tool::Writes::kSurfels);
  tool.name_fields({{"robust_scale", "--robust"}, {"y_down", "--normal-y"}});
  return tool.run(argc, argv, [&] {
    surfel::texture_tool::settle(tool.app(), settings);
    const std::uint64_t memory = surfel::memory_to_use(settings.memory);
    const std::optional<bool> done =
        surfel::texture_tool::texture_in_blocks(tool, settings, memory);
    if (done == true) return;
    if (!done) {
      surfel::tool::require_room(
          settings.input, {}, memory, [&](std::size_t surfels, const surfel::SurfelCloud& first) {
            return surfel::texture_tool::least_bytes(surfels, first, settings);
          });
    }
    texture_in_memory(tool, settings);
  });
}
