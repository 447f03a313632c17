#pragma once

// Zwicker, Pfister, van Baar, Gross, "Surface Splatting", SIGGRAPH 2001 (SS01), and Zhang,
// Pajarola, "Single-Pass Point Rendering and Transparent Shading", 2006 (SP06).

#include <array>
#include <memory>
#include <span>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/render/compositor.h>
#include <surfel/render/pixel_explanation.h>
#include <surfel/render/render_options.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/image.h>
#include <surfel/scene/scene.h>
#include <surfel/store/cluster_store.h>

namespace surfel {

/// Renders surfels by screen space EWA splatting: clusters are culled, sorted front to back and
/// listed by block of pixels; one thread sets up the splats of a block, sorts them into its tiles,
/// rasterises and resolves these. The picture does not depend on the number of threads, nor on the
/// order of the surfels.
///
/// From a store that is not resident, each picture reads the clusters that it sees, nearest first,
/// a batch at a time, and keeps the A-buffers of all tiles meanwhile. The bytes are the same as in
/// memory where all that is seen fits into one batch; else fragments may merge in another order.
///
/// Memory: for each thread 128 bytes for every splat of its block, 20 bytes for every tile that the
/// splat touches, and the A-buffer of a tile, or of a block where the splats are more than
/// RenderOptions::batch. Methods that need whole tiles hold all splats of a block at once, and the
/// images of a tile: 6 KB for each group and layer of SP06's Algorithm 1, 24 KB for each group of
/// Algorithm 2.
///
/// Threads: a Renderer draws one picture at a time, on all threads. Several Renderers may draw at
/// once, also from one resident store; each store that is not resident serves one Renderer.
class SURFEL_API Renderer {
 public:
  /// Keeps references to the store and the scene, which must outlive the Renderer. Throws
  /// Error(kUsage) for options, scenes or clouds that the method cannot draw, among them a store
  /// that is not resident for a method that needs whole tiles; Error(kInput) if the cloud lacks the
  /// method's columns.
  Renderer(ClusterStore& store, const Scene& scene, const RenderOptions& options);
  Renderer(ClusterStore&& store, const Scene& scene, const RenderOptions& options) = delete;
  Renderer(ClusterStore& store, Scene&& scene, const RenderOptions& options) = delete;
  ~Renderer();
  Renderer(const Renderer&) = delete;
  Renderer& operator=(const Renderer&) = delete;

  /// Premultiplied linear R G B A over the background, then, with RenderOptions::aovs, Z (depth
  /// along the view where opacity passes one half, infinity where it never does), Z.first (depth of
  /// the nearest surface), N.X N.Y N.Z (normal in world axes) and weight (sum of rho of the nearest
  /// surface). Throws Error(kUsage) for a camera that is not usable.
  Image render(const Camera& camera, FrameStatistics* statistics = nullptr);

  /// How pixels of the picture that render() makes came about: the rows around each are drawn once
  /// more. Surfels are told by their places in the file where the store has the column `row`, else
  /// by their places in the store. Throws Error(kUsage) for a pixel outside of the picture.
  /// \param camera  The camera of the picture.
  /// \param pixels  Columns and rows, 0 at the top left.
  std::vector<PixelExplanation> explain(const Camera& camera,
                                        std::span<const std::array<int, 2>> pixels);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace surfel
