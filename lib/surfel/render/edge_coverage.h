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

/// The opacities of an opaque picture's pixels near silhouettes, borders and gaps, by an EdgeFilter
/// and the sums of rho in all pixels.
///
/// Surfaces end where the sums of all fragments of a side together do: at a fold, at a step, or
/// where two surfaces meet, these add up to the mean. Near such an end the sum of one surface tells
/// the coverage. Each side of a body has it: the mean of the two sides counts, or the larger one
/// where the other side is hidden. Surfaces of a side that lie close together are of one body,
/// whose outlines run side by side, and the largest counts; others cover independent parts (12).
/// Where several scans of one surface are joined its sums are multiples of the mean, and are
/// divided by the mean sum of the pixels around instead. Surfels that lines cut take part where
/// they are smaller than the pixel filter: the filtered sums tell more there than the lines do.
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
  /// The same for a tile inside a surface of which no splats are coarse (kCoarseStep) or end at
  /// lines.
  void store_inside(const TileABuffer& tile);
  /// Notes the opacity that a pixel of a stored tile was resolved to, unless store_inside() did.
  void set_opacity(int x, int y, float opacity) {
    if (!ranges_[tile_of(x, y)].raw) note_opacity(at(x, y), opacity);
  }
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
  /// Surfaces end within so many pixels of filtered sums that are too small for their inside.
  static constexpr int kMostReach = 8;
  static constexpr int kTaps = EdgeFilter::kTaps;
  static constexpr std::size_t kPatches = kTilePixels / kPatchPixels;

  /// What is known of a pixel. Sums and opacities are in steps of 1 / kScale.
  struct Pixel {
    std::uint16_t sum;      ///< Over the mean sum, kMostSum at most.
    std::uint16_t all;      ///< The same, if all surfaces of a side are one.
    std::uint16_t opacity;  ///< As resolved.
    std::uint8_t step;      ///< spacing_step(); pixels of kCoarseStep are not changed.
    bool merged;            ///< The sums leave some out.
  };
  static constexpr float kMostSum = 4;
  static constexpr float kScale = 65535 / kMostSum;

  /// What is known of a tile.
  struct Range {
    float most = 0;     ///< The largest sum over the mean sum.
    bool ends = false;  ///< Somewhere a sum is less than a surface's inside has, or not known.
    /// Instead of pixels there are the sums of rho, as floats in the order of the A-buffer, whose
    /// last bits are the spacing_step().
    bool raw = false;
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
    Plane sum, slack, rows, smooth;
    std::vector<Unreached> unreached;
  };

  static std::uint16_t steps_of(float share) {
    return static_cast<std::uint16_t>(std::min(share, kMostSum) * kScale + 0.5F);
  }
  static float share_of(std::uint16_t steps) { return static_cast<float>(steps) * (1 / kScale); }
  static void note_opacity(Pixel& pixel, float opacity) {
    pixel.opacity = steps_of(std::clamp(opacity, 0.0F, 1.0F));
    if (pixel.step == kCoarseStep) {
      pixel.sum = pixel.all = pixel.opacity;
    } else if (pixel.merged) {
      pixel.sum = std::max(pixel.sum, pixel.opacity);
      pixel.all = std::max(pixel.all, pixel.opacity);
    }
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
  float gather(int x0, int y0, Scratch& scratch) const;
  float mean_at(int x, int y) const;
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
  /// Of the tiles' patches: their mean sums over the mean sum within a surface; 0 where splats are
  /// large.
  std::vector<std::array<float, kPatches>> means_;
  PerWorker<Scratch> scratch_;
};

}  // namespace surfel
