#include "tools/render/painters.h"

#include <algorithm>
#include <cmath>
#include <string>

#include <surfel/base/timing.h>
#include <surfel/io/mesh_io.h>
#include <surfel/io/scene_file.h>
#include <surfel/render/environment_map.h>
#include <surfel/truth/reference.h>
#include <surfel/truth/source_ewa.h>

#include "tools/support/normal_maps.h"

namespace surfel::render_tool {
namespace {

/// Makes pictures by a slow renderer, which tells its progress.
template <class Renderer>
Paint paint_slowly(std::shared_ptr<Renderer> renderer) {
  return [renderer](const Camera& camera, FrameStatistics& statistics,
                    const std::function<void(double)>& progress) {
    const Timer timer;
    Image image = renderer->render(camera, progress);
    statistics.milliseconds = timer.milliseconds();
    return image;
  };
}

/// The renderer of surfels that the settings choose, with these options.
Paint surfel_painter(const Settings& s, const RenderOptions& options, const LoadedCloud& loaded,
                     const Scene& scene) {
  const RenderCloud& surfels = loaded.surfels();
  if (s.reference) {
    return paint_slowly(std::make_shared<ReferenceRenderer>(surfels, scene, options, s.rays));
  }
  if (s.filter == Filter::kEwaSource) {
    return paint_slowly(std::make_shared<SourceEwaRenderer>(surfels, scene, options));
  }
  const auto renderer = std::make_shared<Renderer>(loaded.store(), scene, options);
  return [renderer](const Camera& camera, FrameStatistics& statistics,
                    const std::function<void(double)>&) {
    return renderer->render(camera, &statistics);
  };
}

}  // namespace

Scene load_scene(tool::Tool& tool, const Settings& s) {
  if (s.scene_file.empty()) return default_scene();
  Scene scene = read_scene(s.scene_file);
  if (s.refraction == Refractions::kSingle) scene.refraction = Refraction::kSingle;
  if (s.refraction == Refractions::kMulti) scene.refraction = Refraction::kMulti;
  if (scene.environment) {
    tool.files().read_also("the environment map", scene.environment->image);
  }
  if (s.render.lit) load_environment(scene);
  return scene;
}

std::vector<Paint> surfel_steps(const Settings& s, const LoadedCloud& surfels, const Scene& scene) {
  std::vector<Paint> steps;
  for (int step = s.progressive - 1; step > 0; --step) {
    RenderOptions coarse = s.render;
    coarse.lod_error = std::min(1000.0, std::ldexp(s.render.lod_pixels(), step));
    steps.push_back(surfel_painter(s, coarse, surfels, scene));
  }
  steps.push_back(surfel_painter(s, s.render, surfels, scene));
  return steps;
}

MeshPainter::MeshPainter(tool::Tool& tool, const Settings& s, const Scene& scene)
    : mesh_(read_mesh(s.mesh)) {
  const bool named = std::any_of(mesh_.material.begin(), mesh_.material.end(),
                                 [](const auto& m) { return !m.texture.empty(); });
  if (!s.texture.image.empty() || named) textures_ = load_textures(s.texture, &mesh_, s.mesh);
  if (s.render.lit) normals_ = tool::load_normal_maps(tool.app(), s.normals, &mesh_, s.mesh);
  for (const MeshMaterial& material : mesh_.material) {
    for (const std::string& map : {material.texture, material.normal_map, material.bump_map}) {
      tool.files().read_also("the mesh's image", map);
    }
  }
  renderer_ = std::make_shared<MeshRenderer>(
      mesh_, textures_ ? &*textures_ : nullptr, scene,
      MeshRenderOptions{.samples = s.rays.samples,
                        .lowpass = s.render.lowpass,
                        .cull_back = s.render.cull_back,
                        .lit = s.render.lit,
                        .bounces = s.bounces,
                        .background = s.render.background,
                        .normal_maps = normals_ ? &*normals_ : nullptr});
}

Paint MeshPainter::paint() const { return paint_slowly(renderer_); }

}  // namespace surfel::render_tool
