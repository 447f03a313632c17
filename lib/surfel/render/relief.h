#pragma once

// Relief from a picture's depths alone, which needs no normals: eye-dome lighting (Boucheny,
// "Interactive scientific visualization of large datasets: towards a perceptive-based approach",
// 2009) and ambient occlusion in screen space by the horizons around a pixel (Bavoil, Sainz,
// "Image-space horizon-based ambient occlusion", 2008; openness: Yokoyama, Shirasawa, Pike,
// "Visualizing topography by openness", 2002).

#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/render/a_buffer.h>
#include <surfel/render/render_options.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/image.h>

namespace surfel {

/// Nearness of the surfaces in rows of a picture, with a margin around them.
class SURFEL_API NearnessPicture {
 public:
  static constexpr float kNothing = -std::numeric_limits<float>::infinity();

  NearnessPicture() = default;
  /// No surfaces.
  /// \param margin  pixels on each side, >= 0.
  void reset(int width, const RowRange& rows, int margin);

  int width() const { return width_; }
  const RowRange& rows() const { return rows_; }
  int margin() const { return margin_; }
  std::ptrdiff_t stride() const { return stride_; }
  /// Nearness of the surface at a pixel, as in Splat::depth, or kNothing. Coordinates may lie in
  /// the margin.
  float* at(int x, int y) { return value_.data() + place(x, y); }
  const float* at(int x, int y) const { return value_.data() + place(x, y); }

 private:
  std::ptrdiff_t place(int x, int y) const {
    return (y - rows_.begin + margin_) * stride_ + x + margin_;
  }

  int width_ = 0, margin_ = 0;
  RowRange rows_{0, 0};
  std::ptrdiff_t stride_ = 0;
  Array<float> value_;
};

/// Pixels around a picture that its relief looks at: see NearnessPicture.
SURFEL_API int relief_margin(Relief relief, const Camera& camera);

/// Share of its light that every pixel of the rows keeps, 0..1, row by row; 1 where there is no
/// surface. How far the relief reaches is a share of the picture's shorter side, and it measures
/// slopes, so that the shares depend neither on the scene's unit nor on the resolution, except in
/// details that a pixel is too large to show. With kOcclusion a plane has none, however it is
/// tilted, nor has what the background surrounds; what lies behind something by far more than the
/// reach keeps its light. The same for any number of threads.
SURFEL_API Array<float> relief_shares(const NearnessPicture& nearness, const Camera& camera,
                                      Relief relief);

/// Takes from the camera's rows of premultiplied R G B A over nothing what the relief takes, and
/// puts the background (premultiplied) behind it. Opacity stays. Rows that lie relief_margin() or
/// more within what `nearness` holds are the same as if it held the whole picture.
SURFEL_API void add_relief(Image& image, const NearnessPicture& nearness, const Camera& camera,
                           Relief relief, const Rgba& background);

}  // namespace surfel
