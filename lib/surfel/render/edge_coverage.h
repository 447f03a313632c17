#pragma once

// How much of its pixels an opaque surface covers where it ends: SS01 section 7, as a filter.

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/function_ref.h>
#include <surfel/base/parallel.h>
#include <surfel/base/types.h>
#include <surfel/render/a_buffer.h>
#include <surfel/render/edge_filter.h>
#include <surfel/render/edge_search.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/image.h>

namespace surfel {

/// The opacities of an opaque picture's pixels near silhouettes and borders, by an EdgeFilter of
/// the picture's sums of rho.
///
/// Each side of a body sums up to the body's coverage. Whatever the fragments are that a grazing
/// surface falls into, the larger one of the two sides' sums counts. Only pixels near places where
/// S falls below one half are changed: elsewhere uneven sums are no edges (tau). Surfels that lines
/// cut take part where they are smaller than the pixel filter: the filtered sums tell more there
/// than the lines do.
class SURFEL_API EdgeCoverage {
 public:
  /// Room for pictures of a pixel filter's standard deviation, pixels.
  /// \param full_weight  TileABuffer::full_weight, tau.
  EdgeCoverage(const EdgeFilter& filter, double lowpass, float full_weight);

  /// Begins a picture.
  void begin(int width, int height);
  /// Notes the sums of a tile that has been drawn. Different tiles may be stored at once.
  /// \param inside  with kNo pixels are empty until set_opacity() is called; other tiles have one
  ///                fragment in every pixel, whose sum tells the opacity.
  void store(const TileABuffer& tile, TileInside inside);
  /// The same for a tile inside a surface whose splats all are fine and end at no lines.
  /// \param least  the least sum of rho.
  void store_inside(const TileABuffer& tile, float least);
  /// Notes the opacity that a pixel of a stored tile was resolved to.
  void set_opacity(int x, int y, float opacity) { note_opacity(at(x, y), opacity); }
  /// The same for pixels that follow one another in a row of a tile's strip.
  void set_opacities(int x, int y, const float* opacity) {
    Pixel* const pixels = &at(x, y);
    for (int i = 0; i < kStripWidth; ++i) note_opacity(pixels[i], opacity[i]);
  }

  /// Tiles on either side of a row of tiles that must have been stored before apply() changes it.
  static constexpr int kTilesAround = 2;

  /// Gives the pixels near edges the opacities that follow from the surface's coverage; their
  /// colours stay. Pixels that no kernel reaches get the mean colour around them.
  /// \param image   channels R G B A, premultiplied, over what is behind; where there are more
  ///                channels, Z and Z.first follow.
  /// \param rows    of pixels that are to be right; those next to them may be changed, too.
  /// \param behind  what is behind the surfaces at a pixel, premultiplied.
  void apply(Image& image, const RowRange& rows, FunctionRef<Rgba(int x, int y)> behind);

 private:
  /// Surfaces end within so many pixels of filtered sums of less than one half.
  static constexpr int kMostReach = 8;
  static constexpr int kTaps = EdgeFilter::kTaps;

  /// Numbers in steps of 1 / kScale, and a flag each.
  struct Pixel {
    std::uint16_t sum;      ///< Sum over the mean sum, 1 at most.
    std::uint16_t opacity;  ///< As resolved.
  };
  static constexpr float kScale = 32767;
  static constexpr std::uint16_t kFlag = 0x8000;
  static constexpr std::uint16_t kKept = kFlag;    ///< Of Pixel::sum: the pixel is not changed.
  static constexpr std::uint16_t kMerged = kFlag;  ///< Of Pixel::opacity: the sum leaves some out.

  /// Bounds of a tile's sums.
  struct Range {
    float least = 0, most = 0;
    /// Instead of pixels there are the sums of rho, as floats in the order of the A-buffer.
    bool raw = false;
    bool merged = false;  ///< There are pixels with merged surfaces.
  };
  /// A pixel that no kernel reaches.
  struct Unreached {
    int x, y;
    float opacity;
  };
  struct Scratch {
    static constexpr int kMargin = kMostReach + kTaps;
    static constexpr int kSide = kTileSize + 2 * kMargin;
    using Plane = std::array<std::array<float, kSide>, kSide>;
    Plane sum, rows, smooth;
    std::vector<Unreached> unreached;
  };

  static std::uint16_t steps_of(float share) {
    return static_cast<std::uint16_t>(share * kScale + 0.5F);
  }
  static void note_opacity(Pixel& pixel, float opacity) {
    const std::uint16_t steps = steps_of(std::clamp(opacity, 0.0F, 1.0F));
    if ((pixel.sum & kKept) != 0) {
      pixel.sum = kKept | steps;
    } else if ((pixel.opacity & kMerged) != 0) {
      pixel.sum = std::max(pixel.sum, steps);
    }
    pixel.opacity = static_cast<std::uint16_t>((pixel.opacity & kMerged) | steps);
  }
  static float opacity_of(const Pixel& pixel) {
    return static_cast<float>(pixel.opacity & ~kMerged) / kScale;
  }
  Pixel& at(int x, int y) {
    return pixels_[tile_of(x, y) * kTilePixels +
                   static_cast<std::size_t>(y % kTileSize * kTileSize + x % kTileSize)];
  }
  const Pixel& at(int x, int y) const { return const_cast<EdgeCoverage*>(this)->at(x, y); }
  std::size_t tile_of(int x, int y) const {
    return static_cast<std::size_t>(y / kTileSize) * tiles_x_ + x / kTileSize;
  }
  template <class Visit>
  static void for_each_row(std::size_t first, Pixel* tile, const Visit& visit);
  template <class Holds>
  bool any_around(int tile_x, int tile_y, const Holds& holds) const;
  void unpack(std::size_t tile);
  bool may_have_edges(int tile_x, int tile_y) const;
  std::pair<float, float> gather(int x0, int y0, Scratch& scratch) const;
  void filter(Scratch& scratch) const;
  void change_tile(int x0, int y0, Scratch& scratch, Image& image,
                   FunctionRef<Rgba(int x, int y)> behind);
  void fill(const Unreached& pixel, Image& image, FunctionRef<Rgba(int x, int y)> behind) const;

  EdgeFilter filter_;
  float inv_full_;  ///< 1 / tau.
  int reach_;       ///< Pixels, up to kMostReach.

  int width_ = 0, height_ = 0;
  int tiles_x_ = 0, tiles_y_ = 0;
  Array<Pixel> pixels_;  ///< Tile by tile, row by row.
  std::vector<Range> ranges_;
  PerWorker<Scratch> scratch_;
};

}  // namespace surfel
