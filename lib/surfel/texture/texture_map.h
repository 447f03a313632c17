#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/io/image_io.h>
#include <surfel/scene/image.h>
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
///
/// The image is in memory, or in a file of which no more is kept than kernels need: request() them
/// all, load(), and then sample(). One pass over the file makes the levels that were requested, and
/// keeps those tiles of the image that kernels reach on level 0. Mip levels in the file are not
/// used: their filter is the writer's choice, mostly a box, and not that of GaussianPyramid.
class SURFEL_API TextureMap {
 public:
  /// \param image  R G B, or R G B A with straight alpha, linear; further channels are ignored.
  ///               Values that are not finite become 0. Its memory is taken over if it has four
  ///               channels. Throws Error(kInput) where it has no pixel or fewer channels.
  /// \param wrap   must not be kNothing.
  TextureMap(Image image, WrapMode wrap);
  /// A file's image, as ImageReader gives it out. Copies of the map share the rows kept of it.
  TextureMap(std::shared_ptr<ImageReader> reader, WrapMode wrap);
  /// One colour and opacity everywhere.
  static TextureMap constant(const Vec3f& color, float alpha = 1);

  int width() const { return pyramid_.image().x.count; }
  int height() const { return pyramid_.image().y.count; }
  /// Some texel's alpha is less than 1. Of a file known once it is loaded.
  bool has_alpha() const { return has_alpha_; }

  Vec2d texel(const Vec2f& uv) const { return texel_position(uv, width(), height()); }
  /// Announces a kernel that sample() will be called with. May be called from several threads.
  void request(const TexelKernel& kernel, int max_level = GaussianPyramid::kMaxLevel);
  /// Announces texels, which may lie beyond the borders, for a ChartTexture.
  void request(const GaussianPyramid::Box& texels);
  /// Prepares for the requested kernels; of an image in memory it makes large kernels cheap, but is
  /// not needed. Throws Error(kInput) where the file is damaged, or the texels needed do not fit
  /// into memory.
  void load();
  /// \param kernel     Centre and variance in texels of the image.
  /// \param max_level  0: the sum over the image's own texels, even where coarser levels are built.
  TextureSample sample(const TexelKernel& kernel, int max_level = GaussianPyramid::kMaxLevel) const;
  /// Colour of the whole image. Reads a file once more.
  TextureSample mean() const;

  const GaussianPyramid& pyramid() const { return pyramid_; }

 private:
  void check_memory(const PyramidStream& stream) const;
  void read_file(PyramidStream& stream, bool levels);

  bool has_alpha_ = false;               // Before the pyramid, whose making sets it.
  std::shared_ptr<ImageReader> reader_;  ///< None where the image is in memory.
  std::shared_ptr<TexelTiles> tiles_;    ///< Tiles of the reader's image.
  std::uint32_t requested_levels_ = 0;   ///< A bit each.
  GaussianPyramid pyramid_;
};

/// A texture seen through one chart: texels outside of it have no weight, at any level, unless they
/// repeat texels of the chart on level 0.
class SURFEL_API ChartTexture {
 public:
  /// \param map        The texture, which must outlive this object.
  /// \param triangles  Triangles of the chart.
  /// \param box        Their coverage_box() on the texture's texel grid, which may reach beyond the
  ///                   image (wrapped); the map must have it loaded.
  /// \param levels     Levels that kernels belong on.
  ChartTexture(const TextureMap& map, const std::vector<UvCharts::Triangle>& triangles,
               const CoverageRaster& box, const LevelRange& levels);

  /// nullopt where the kernel does not reach the chart.
  std::optional<TextureSample> sample(const TexelKernel& kernel,
                                      int max_level = GaussianPyramid::kMaxLevel) const;

 private:
  std::optional<GaussianPyramid> pyramid_;
  std::optional<GaussianPyramid> coverage_;  ///< Where alpha is a weight besides the coverage.
};

}  // namespace surfel
