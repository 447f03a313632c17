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

/// Nearness of a picture's surfaces, with a margin around it.
class SURFEL_API NearnessPicture {
 public:
  static constexpr float kNothing = -std::numeric_limits<float>::infinity();

  NearnessPicture() = default;
  /// No surfaces. \param margin  pixels on each side, >= 0.
  void reset(int width, int height, int margin);

  int width() const { return width_; }
  int height() const { return height_; }
  int margin() const { return margin_; }
  std::ptrdiff_t stride() const { return stride_; }
  /// Nearness of the surface at a pixel, as in Splat::depth, or kNothing. Coordinates may lie in
  /// the margin.
  float* at(int x, int y) { return value_.data() + (y + margin_) * stride_ + x + margin_; }
  const float* at(int x, int y) const {
    return value_.data() + (y + margin_) * stride_ + x + margin_;
  }

 private:
  int width_ = 0, height_ = 0, margin_ = 0;
  std::ptrdiff_t stride_ = 0;
  Array<float> value_;
};

/// Pixels around a picture that its relief looks at: see NearnessPicture.
SURFEL_API int relief_margin(Relief relief, const Camera& camera);

/// Share of its light that every pixel keeps, 0..1, row by row; 1 where there is no surface. How
/// far the relief reaches is a share of the picture's shorter side, and it measures slopes, so that
/// the shares depend neither on the scene's unit nor on the resolution, except in details that a
/// pixel is too large to show.
/// With kOcclusion a plane has none, however it is tilted, nor has what the background surrounds;
/// what lies behind something by far more than the reach keeps its light. The same for any number
/// of threads.
SURFEL_API Array<float> relief_shares(const NearnessPicture& nearness, const Camera& camera,
                                      Relief relief);

/// Takes from premultiplied R G B A over nothing what the relief takes, and puts the background
/// (premultiplied) behind it. Opacity stays.
SURFEL_API void add_relief(Image& image, const Array<float>& shares, const Rgba& background);

}  // namespace surfel
