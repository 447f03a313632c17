#pragma once

#include <array>
#include <functional>

#include <surfel/base/export.h>
#include <surfel/base/function_ref.h>
#include <surfel/base/types.h>
#include <surfel/render/a_buffer.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/image.h>

namespace surfel {

/// Half line in world axes, relative to the camera's eye: points eye + origin + t direction with
/// t >= near. `direction` has unit length along the view, so t is the depth z.
struct ViewRay {
  Vec3d origin{0, 0, 0};
  Vec3d direction{0, 0, 1};
};

/// The ray through picture coordinates (x, y), pixels; pixel centres are at +1/2.
SURFEL_API ViewRay view_ray(const Camera& camera, double x, double y);

struct SupersampleOptions {
  int samples = 16;    ///< n: rays along each side of a pixel, 1..64.
  double lowpass = 1;  ///< Standard deviation of the Gaussian pixel filter, pixels, 0..16; 0: the
                       ///< mean over the pixel's own square.
};

/// Traces the centres of an n x n grid in every pixel of the picture (and of a margin around it as
/// wide as the filter reaches) and filters the premultiplied colours with a Gaussian of standard
/// deviation `lowpass`, cut off at four standard deviations and normalised: a picture as a pixel
/// filter sees it, accurate to the sampling. Parallel over rows; the same for any number of
/// threads.
///
/// \param trace     colour at picture coordinates (x, y), premultiplied, linear; called in parallel
///                  with the number of the calling worker, as parallel_for() counts workers.
/// \param progress  called with the share that is done, 0..1, from any thread; may be empty.
/// \return channels R G B A. Throws Error(kUsage) for options that are not usable.
SURFEL_API Image supersample(const Camera& camera, const SupersampleOptions& options,
                             FunctionRef<Rgba(double x, double y, int worker)> trace,
                             const std::function<void(double)>& progress = {});

/// Composites rows of a premultiplied picture over a background (linear R G B, straight alpha), in
/// place.
SURFEL_API void composite_over(Image& image, const RowRange& rows,
                               const std::array<float, 4>& background);

}  // namespace surfel
