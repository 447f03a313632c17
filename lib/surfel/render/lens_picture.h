#pragma once

#include <array>
#include <functional>

#include <surfel/base/export.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/image.h>
#include <surfel/scene/lens.h>

namespace surfel {

/// Pixel filter of a picture through a lens, and what surrounds it.
struct LensPictureOptions {
  double lowpass = 1;  ///< Standard deviation of the pixel filter with which pinhole pictures are
                       ///< drawn, in their pixels, > 0, and with which the result is filtered.
  std::array<float, 4> background{};  ///< Premultiplied, where the lens shows nothing.
};

/// The picture of a camera with a lens, from pictures of pinholes in its place: of one with the
/// camera's axes where it sees all that the lens does, else of the faces of a cube that are seen.
///
/// Their pixels are finer than the result's everywhere, by a quarter at least. Towards a panorama's
/// poles its pixels get narrow: squares about the poles are drawn again, each twice as fine as the
/// one around it, by 12 percent finer than needed down to 3.6 degrees. Each pixel of the result is
/// a sum over them under the Gaussian that is left to do of the pixel filter: h^2 J J^T - h^2 I, J
/// the derivative of the pinhole's picture by the result's, so that both filters together are EWA
/// splatting's filter for lens and projection as one (no variance of it is below 1/4 pixel^2, lest
/// the pinhole's pixels show). Channels other than R G B A come from the nearest pixel. Z is the
/// depth along the camera's axis, with kEquirectangular the distance from the eye.
///
/// \param camera   Pose, size and focal lengths of the picture.
/// \param lens     Distortion or projection.
/// \param draw     Draws the picture of a pinhole camera; it is called once or up to twelve times.
/// \param options  The pixel filter, and the colour where the lens shows nothing.
///
/// Memory: 12 bytes a pixel, and a picture of a pinhole beside the result. The result does not
/// depend on the number of threads.
SURFEL_API Image draw_through_lens(const Camera& camera, const Lens& lens,
                                   const std::function<Image(const Camera&)>& draw,
                                   const LensPictureOptions& options);

/// Does draw_through_lens() draw several pictures, whose axes are not the camera's?
SURFEL_API bool needs_cube(const Camera& camera, const Lens& lens);

}  // namespace surfel
