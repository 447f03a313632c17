#pragma once

#include <optional>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/io/image.h>
#include <surfel/texture/gaussian_pyramid.h>
#include <surfel/texture/texel_kernel.h>
#include <surfel/texture/uv_charts.h>

namespace surfel {

/// Filtered colour of a texture: linear, straight alpha.
struct TextureSample {
  Vec3f color{0, 0, 0};
  float alpha = 1;
};

/// An image as a function on texture space that can be averaged under any Gaussian kernel:
/// sum_i c_i g_i / sum_i g_i over the texels i, with alpha as a further weight of the colours.
class SURFEL_API TextureMap {
 public:
  /// \param image  R G B, or R G B A with straight alpha, linear; further channels are ignored.
  ///               Values that are not finite become 0. Its memory is taken over if it has four
  ///               channels. Throws Error(kInput) where it has no pixel or fewer channels.
  /// \param wrap   must not be kNothing.
  TextureMap(Image image, WrapMode wrap);
  /// One colour everywhere.
  static TextureMap constant(const Vec3f& color);

  int width() const { return pyramid_.image().x.count; }
  int height() const { return pyramid_.image().y.count; }
  /// Some texel's alpha is less than 1.
  bool has_alpha() const { return has_alpha_; }

  Vec2d texel(const Vec2f& uv) const { return texel_position(uv, width(), height()); }
  /// Makes kernels up to this level (GaussianPyramid::level_for) cheap; not needed for the result.
  void build(int level) { pyramid_.build(level); }
  /// \param max_level  0: the sum over the image's own texels, even where coarser levels are built.
  TextureSample sample(const TexelKernel& kernel, int max_level = GaussianPyramid::kMaxLevel) const;
  /// Colour of the whole image.
  TextureSample mean() const;

  const GaussianPyramid& pyramid() const { return pyramid_; }

 private:
  bool has_alpha_ = false;  // Before the pyramid, whose making sets it.
  GaussianPyramid pyramid_;
};

/// A texture seen through one chart: texels outside of it have no weight, at any level.
class SURFEL_API ChartTexture {
 public:
  /// `raster` is the chart's coverage on the texture's texel grid, which may reach beyond the image
  /// (wrapped).
  ChartTexture(const TextureMap& map, const CoverageRaster& raster);

  void build(int level);
  /// nullopt where the kernel does not reach the chart.
  std::optional<TextureSample> sample(const TexelKernel& kernel,
                                      int max_level = GaussianPyramid::kMaxLevel) const;

 private:
  GaussianPyramid pyramid_;
  std::optional<GaussianPyramid> coverage_;  ///< Where alpha is a weight besides the coverage.
};

}  // namespace surfel
