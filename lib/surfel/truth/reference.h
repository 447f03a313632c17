#pragma once

// The truth that the fast renderer is measured against. It has no kernel, no depth plane and no
// A-buffer in common with it.

#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/render/render_options.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/image.h>
#include <surfel/scene/scene.h>
#include <surfel/store/render_cloud.h>
#include <surfel/truth/disc_hierarchy.h>
#include <surfel/truth/overdraw.h>

namespace surfel {

/// Rays that a ReferenceRenderer casts.
struct ReferenceOptions {
  int samples = 16;  ///< n: n x n rays a pixel, 1..64.

  /// Empty if usable, else one sentence per violated rule.
  SURFEL_API std::vector<std::string> problems() const;
};

/// Ray-casts a cloud, slowly and in double: the surface that surfels describe, SS01 (1), seen
/// through the pixel filter (6), without the local affine approximation (4).
///
/// A ray meets the plane of every surfel exactly, at plane coordinates u and depth z > near. The
/// surfel contributes r(u) = area G_V(u) where beta = 1/2 u^T V^-1 u < cutoff; planes that the ray
/// is parallel to are not met. All contributions are sorted by depth and separated into surfaces: a
/// side of the surface each, hits nearer to its mean depth than epsilon_share() times their disc's
/// radius sqrt(2 cutoff max V). Surfaces are normalised by the sum of r (9), shaded with their mean
/// normal, weighed by their coverage min(1, sum of r / tau) (section 7) and composited (12). Then
/// supersample() filters the rays of a picture with a Gaussian of standard deviation `lowpass`.
///
/// Of the RenderOptions, cutoff, lowpass, depth_epsilon, coverage_threshold, cull_back, lit and
/// background apply: there are neither layers nor approximations to choose from.
class SURFEL_API ReferenceRenderer {
 public:
  /// Keeps references to the cloud and the scene, which must outlive the renderer. Throws
  /// Error(kUsage) for options or scenes that are not usable.
  ReferenceRenderer(const RenderCloud& cloud, const Scene& scene, const RenderOptions& options,
                    const ReferenceOptions& reference = {});
  ReferenceRenderer(RenderCloud&& cloud, const Scene& scene, const RenderOptions& options,
                    const ReferenceOptions& reference = {}) = delete;
  ReferenceRenderer(const RenderCloud& cloud, Scene&& scene, const RenderOptions& options,
                    const ReferenceOptions& reference = {}) = delete;

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
  ReferenceOptions reference_;
  DiscHierarchy hierarchy_;
};

}  // namespace surfel
