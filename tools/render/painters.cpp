#include "tools/render/painters.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include <surfel/base/timing.h>
#include <surfel/io/mesh_io.h>
#include <surfel/io/scene_file.h>
#include <surfel/render/environment_map.h>
#include <surfel/render/lens_picture.h>
#include <surfel/sample/mesh_sampler.h>
#include <surfel/truth/reference.h>
#include <surfel/truth/source_ewa.h>

#include "tools/render/light.h"
#include "tools/support/normal_maps.h"
#include "tools/support/surfels.h"

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

/// As paint_slowly(), of surfels that are not too many over each other. `name` is their file's.
template <class Renderer>
Paint paint_bounded(std::shared_ptr<Renderer> renderer, const std::string& name) {
  const Paint paint = paint_slowly(renderer);
  return [renderer, paint, name](const Camera& camera, FrameStatistics& statistics,
                                 const std::function<void(double)>& progress) {
    renderer->require_bounded(camera, name);
    return paint(camera, statistics, progress);
  };
}

/// The renderer of surfels that the settings choose, with these options.
Paint surfel_painter(const Settings& s, const RenderOptions& options, const LoadedCloud& loaded,
                     const Scene& scene) {
  const RenderCloud& surfels = loaded.surfels();
  if (s.reference) {
    return paint_bounded(std::make_shared<ReferenceRenderer>(surfels, scene, options, s.rays),
                         tool::shown_name(s.inputs.front()));
  }
  if (s.filter == Filter::kEwaSource) {
    return paint_bounded(std::make_shared<SourceEwaRenderer>(surfels, scene, options),
                         tool::shown_name(s.inputs.front()));
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
  if (s.render.lit) load_environment(scene);
  if (scene.environment && scene.environment->map) {
    tool.files().read_also("the environment map", scene.environment->image);
  }
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

Image paint_view(const Settings& s, const Paint& paint, const View& view, Scene& scene,
                 FrameStatistics& statistics, const std::function<void(double)>& progress) {
  if (!view.lens) return paint(view.camera, statistics, progress);
  const std::vector<Light> lights = scene.lights;
  if (needs_cube(view.camera, *view.lens)) {
    for (Light& light : scene.lights) {
      if (light.type != Light::Type::kHeadlight) continue;
      light.type = Light::Type::kPoint;
      light.vector = view.camera.eye;
    }
  }
  const auto draw = [&](const Camera& camera) {
    FrameStatistics one;
    Image image = paint(camera, one, progress);
    statistics.add(one);
    return image;
  };
  const std::array<float, 4>& color = s.render.background;
  LensPictureOptions options{.lowpass = s.render.lowpass};
  for (std::size_t c = 0; c < 4; ++c) {
    options.background[c] = c < 3 ? color[c] * color[3] : color[3];
  }
  Image image = draw_through_lens(view.camera, *view.lens, draw, options);
  scene.lights = lights;
  return image;
}

MeshPainter::MeshPainter(tool::Tool& tool, Settings& s, const Scene& scene)
    : mesh_(read_mesh(s.mesh)) {
  require_sampleable(mesh_, s.mesh);
  for (const std::string& note : mesh_.notes) tool.note(s.mesh + ": " + note);
  const bool named = std::any_of(mesh_.material.begin(), mesh_.material.end(),
                                 [](const auto& m) { return !m.texture.empty(); });
  if (!s.texture.image.empty() || named) textures_ = load_textures(s.texture, &mesh_, s.mesh);
  const bool untextured = !mesh_.face_material.empty() &&
                          std::any_of(mesh_.material.begin(), mesh_.material.end(),
                                      [](const MeshMaterial& m) { return m.texture.empty(); });
  const bool colored = textures_ || !mesh_.color.empty() || untextured;
  const bool transparent = std::any_of(mesh_.material.begin(), mesh_.material.end(),
                                       [](const auto& m) { return m.opacity < 1; });
  choose_light(tool, s, s.mesh, colored ? color_light(mesh_) : ColorLight::kUnsaid, transparent);
  if (s.render.lit) normals_ = tool::load_normal_maps(tool.app(), s.normals, &mesh_, s.mesh);
  for (const std::string& image : image_files(mesh_)) {
    tool.files().read_also("the mesh's image", image);
  }
  renderer_ = std::make_shared<MeshRenderer>(
      mesh_, textures_ ? &*textures_ : nullptr, scene,
      MeshRenderOptions{.samples = s.rays.samples,
                        .lowpass = s.render.lowpass,
                        .cull_back = s.render.cull_back,
                        .lit = s.render.lit,
                        .bounces = s.bounces,
                        .relief = s.render.relief,
                        .background = s.render.background,
                        .normal_maps = normals_ ? &*normals_ : nullptr});
}

Paint MeshPainter::paint() const { return paint_slowly(renderer_); }

}  // namespace surfel::render_tool
