#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include <surfel/render/renderer.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/image.h>
#include <surfel/scene/scene.h>
#include <surfel/scene/triangle_mesh.h>
#include <surfel/scene/view.h>
#include <surfel/store/cloud_loader.h>
#include <surfel/texture/normal_maps.h>
#include <surfel/texture/texture_source.h>
#include <surfel/truth/mesh_renderer.h>

#include "tools/render/settings.h"
#include "tools/support/tool.h"

namespace surfel::render_tool {

/// Makes a picture. `progress` is called with the share of it that is done, where it takes long.
using Paint = std::function<Image(const Camera& camera, FrameStatistics& statistics,
                                  const std::function<void(double)>& progress)>;

/// The scene with its environment, which pictures without shading do without.
Scene load_scene(tool::Tool& tool, const Settings& s);

/// The renderers of a picture's steps, coarsest first. They refer to the surfels and the scene.
std::vector<Paint> surfel_steps(const Settings& s, const LoadedCloud& surfels, const Scene& scene);

/// Makes the picture of a view. One through a lens is made of one or more pictures of pinholes,
/// whose numbers are added up; where these look in several directions, lights that move with the
/// camera stand in its eye meanwhile, for `scene` is the one that `paint` draws.
Image paint_view(const Settings& s, const Paint& paint, const View& view, Scene& scene,
                 FrameStatistics& statistics, const std::function<void(double)>& progress);

/// A mesh with its textures, and its renderer.
class MeshPainter {
 public:
  /// Reads the mesh that the settings name and the images of its materials, and chooses its light
  /// where the settings leave it open. Refers to the scene.
  MeshPainter(tool::Tool& tool, Settings& s, const Scene& scene);
  MeshPainter(const MeshPainter&) = delete;
  MeshPainter& operator=(const MeshPainter&) = delete;

  const TriangleMesh& mesh() const { return mesh_; }
  SceneExtent extent() const { return renderer_->extent(); }
  /// Makes the mesh's pictures, as long as this object lives.
  Paint paint() const;

 private:
  TriangleMesh mesh_;
  std::optional<TextureSet> textures_;
  std::optional<NormalMaps> normals_;
  std::shared_ptr<MeshRenderer> renderer_;  ///< Refers to the mesh, its textures and normals.
};

}  // namespace surfel::render_tool
