#pragma once

// Source space EWA, SS01 equation (8), by ray casting: an independent path to compare with.

#include <cmath>
#include <functional>
#include <string>

#include <surfel/base/export.h>
#include <surfel/render/render_options.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/image.h>
#include <surfel/scene/scene.h>
#include <surfel/store/render_cloud.h>
#include <surfel/truth/disc_hierarchy.h>
#include <surfel/truth/overdraw.h>

namespace surfel {

/// Renders a cloud by source space EWA: the ray through each pixel's centre x meets the tangent
/// plane of every surfel exactly, at plane coordinates u = m^-1(x) from the surfel's centre, and
/// the pixel's filter is warped to the plane by J_x, the derivative of the screen by the plane at
/// that place (screen space EWA takes it at the surfel's centre). The resampling kernel is
///
///   rho = area G_M(u),  M = V + h^2 J_x^-1 J_x^-T,  where beta = 1/2 u^T M^-1 u < cutoff   [SS01
///   (8)]
///
/// At the horizon J_x^-1 and u grow without bound. As M^-1 = J_x^T Sigma^-1 J_x and |M| = |Sigma| /
/// |J_x|^2 with Sigma = J_x V J_x^T + h^2 I, the same kernel is
///
///   rho = area |J_x| G_Sigma(J_x u),
///
/// in which all is finite: J_x u is the offset from the surfel's projection to x, times the
/// surfel's depth by the hit's depth. A plane seen edge-on has rho = 0.
///
/// For the same ratio a pixel near the horizon would find surfels of the plane that are many pixels
/// away, where the warp of its filter is no longer what J_x says. A surfel therefore contributes
/// only to pixels whose filter, cut off at twice the kernels' sqrt(2 cutoff) standard deviations,
/// reaches the ball around its disc: the hits are at most about twice as deep as the disc.
///
/// Surfaces are separated by depth, normalised, shaded and composited as by ReferenceRenderer, but
/// with the depth clamped to the surfel's centre +- reach, and epsilon = epsilon_share() reach,
/// where reach is the radius of disc and pixel filter together on the plane: grazing planes run to
/// infinity. Of the RenderOptions the same ones apply.
class SURFEL_API SourceEwaRenderer {
 public:
  /// Keeps references to the cloud and the scene, which must outlive the renderer. Throws
  /// Error(kUsage) for options or scenes that are not usable.
  SourceEwaRenderer(const RenderCloud& cloud, const Scene& scene, const RenderOptions& options);
  SourceEwaRenderer(RenderCloud&& cloud, const Scene& scene, const RenderOptions& options) = delete;
  SourceEwaRenderer(const RenderCloud& cloud, Scene&& scene, const RenderOptions& options) = delete;

  /// Premultiplied linear R G B A over the background. The same for any number of threads. Draws
  /// on all threads; several calls may run at once. Throws Error(kUsage) for a camera that is not
  /// usable.
  /// \param camera    The camera of the picture.
  /// \param progress  Called with the share that is done, 0..1, from any thread; may be empty.
  Image render(const Camera& camera, const std::function<void(double)>& progress = {}) const;

  /// Throws Error(kInput) where a picture would take a time that is not in proportion to the
  /// cloud: see require_bounded_overdraw(). `name` starts the message.
  void require_bounded(const Camera& camera, const std::string& name) const {
    require_bounded_overdraw(cloud_, hierarchy_, std::sqrt(2 * options_.cutoff), camera, name);
  }

 private:
  const RenderCloud& cloud_;
  const Scene& scene_;
  RenderOptions options_;
  DiscHierarchy hierarchy_;
};

}  // namespace surfel
