#pragma once

#include <cstddef>
#include <memory>

#include <surfel/base/export.h>
#include <surfel/base/timing.h>
#include <surfel/gaussian/gaussian_options.h>
#include <surfel/render/pixel_explanation.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/gaussian_cloud.h>
#include <surfel/scene/image.h>

namespace surfel {

/// What was done for a picture.
struct GaussianFrameStatistics {
  std::size_t splats = 0;  ///< Gaussians that may be seen.
  std::size_t pairs = 0;   ///< Splats by tiles that they meet.
  double milliseconds = 0;
  StageTimes stages;  ///< project, sort, list, raster.
};

/// Pictures of Gaussians in space, on all threads. They do not depend on the number of threads or
/// on the instruction set.
///
/// Memory: 68 bytes a Gaussian, of discs and exact kernels 100, and about 25 for each that is seen,
/// kept for the next picture; several samples a pixel take a band of their rows besides.
class SURFEL_API GaussianRenderer {
 public:
  /// Refers to the cloud, whose Gaussians may be others from picture to picture. Throws
  /// Error(kUsage) if an option is not usable, if the cloud has levels of detail, or if the profile
  /// does not draw the cloud's amplitude rule: densities are kExact's, samples of a surface
  /// kSurfel's.
  GaussianRenderer(const GaussianCloud& cloud, const GaussianOptions& options);
  ~GaussianRenderer();
  GaussianRenderer(const GaussianRenderer&) = delete;
  GaussianRenderer& operator=(const GaussianRenderer&) = delete;

  /// The picture, with the channels R G B A, premultiplied, and the channels of
  /// GaussianOptions::depth.
  Image render(const Camera& camera, GaussianFrameStatistics* statistics = nullptr);

  /// How a pixel of the picture that render() makes came about, in colours as displays take them
  /// (PixelExplanation::display); Gaussians are told by their places in the cloud. Throws
  /// Error(kUsage) for a pixel outside of the picture, and where a pixel has several samples.
  PixelExplanation explain(const Camera& camera, int x, int y);

 private:
  struct Frame;

  const GaussianCloud& cloud_;
  GaussianOptions options_;
  std::unique_ptr<Frame> frame_;  ///< What one picture leaves for the next.
};

}  // namespace surfel
