#pragma once

// Edges of surfaces, found by the sums of rho in the pixels around. A picture does not depend on
// where its tiles lie: sums beyond a tile's border are read from the tiles next to it.

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <surfel/base/types.h>
#include <surfel/render/a_buffer.h>
#include <surfel/render/edge_filter.h>
#include <surfel/render/frame.h>

namespace surfel {

/// How far edges are looked for, along columns and rows, pixels.
inline constexpr int kEdgeReach = EdgeFilter::kReach;

/// The fragments that continue a fragment in the pixels around it.
struct EdgeNeighbors {
  /// The largest sum of a fragment that continues it, or of itself, where nothing is nearer; 0 if
  /// something always is.
  float leading;
  /// Depth of the nearest front-facing fragment of all these pixels; -infinity if there is none.
  float nearest_front;
};

/// A fragment with more than this share of the mean sum is a surface of its own.
inline constexpr float kWholeSurface = 0.85F;

/// A depth, as Splat::depth, in a pixel, and how it changes from pixel to pixel.
struct SlantedDepth {
  float depth;
  DepthSlope slope;

  /// In a pixel that lies beside it.
  float at(int dx, int dy) const {
    return depth + slope.x * static_cast<float>(dx) + slope.y * static_cast<float>(dy);
  }
};

/// What parts two surfaces of a side, in the pixels around one.
struct DepthBorder {
  SlantedDepth middle;  ///< Fragments belong to the surface on their side of it.
  SlantedDepth gap;     ///< By which one surface is nearer; where it is negative they have crossed.
};

/// The fragments of one side of a surface in the pixels around one: of all depths between two.
struct SurfaceRange {
  bool front;
  DepthBorder nearest, farthest;
  float sum;  ///< In the pixel itself.
  int step;   ///< The spacing_step() of the splats.
};

/// Whether pixels around a pixel of a tile belong to other tiles.
bool sees_other_tiles(const TileABuffer& tile, int pixel);

/// What continues a fragment around a pixel that sees no other tile.
EdgeNeighbors look_around(const TileABuffer& tile, const Fragment& fragment, int pixel);

/// How a surface covers a pixel that sees no other tile. Beyond the picture its sums go on as they
/// are at the border.
EdgeFilter::Edge edge_around(const TileABuffer& tile, const SurfaceRange& range, int pixel);

/// Tiles that show one side of one surface in all their pixels, whose sums of rho are all those of
/// its inside (EdgeFilter::least_inside()): no edge is seen where the tiles around show the same
/// side in the same way.
enum class TileInside : std::uint8_t { kNo, kFront, kBack };

/// The only fragment of a pixel near a tile's border, which may be at an edge.
struct LoneFragment {
  int x, y;           ///< The pixel in the picture.
  float weight, tag;  ///< Channels of the A-buffer.
};

/// The fragments of a band's tiles, and of the last row of tiles of the band before. Tiles may be
/// stored at once; nothing is stored while others read.
class TileRims {
 public:
  /// Begins a band of a picture, of which no later one has more rows than the first.
  void begin(const Camera& camera, const Band& band, int layers);
  void store(const TileABuffer& tile, TileInside inside);

  /// What continues a fragment around a picture's pixel within kEdgeReach of a tile's border.
  EdgeNeighbors look_around(const Fragment& fragment, int x, int y) const;
  /// How a surface covers such a pixel.
  EdgeFilter::Edge edge_around(const EdgeFilter& filter, const SurfaceRange& range, int x,
                               int y) const;
  /// Ratio of a lone fragment's coverage to the coverage that it would have away from edges.
  /// \param weights tau and the weight at edges of the picture.
  float coverage_change(const TileABuffer& weights, const LoneFragment& lone) const;

 private:
  /// A layer's fragments in the pixels of a patch.
  using Patch = std::array<float, kPatchPixels>;
  /// Where a pixel's values are stored.
  struct Place {
    std::size_t patch;
    std::size_t pixel;  ///< Place of the pixel in the patch.
  };
  static constexpr int kPatches = kTilePixels / kPatchPixels;

  std::size_t tile_of(int tile_x, int tile_y) const {
    return static_cast<std::size_t>(tile_y - first_row_) * tiles_x_ + tile_x;
  }
  Place place_of(int x, int y) const;
  template <class Taker>
  void offer_fragments(int x, int y, Taker& taker) const;
  bool inside_goes_on(int x, int y) const;

  int width_ = 0, height_ = 0;  ///< Size of the picture, pixels.
  int tiles_x_ = 0;
  int first_row_ = 0;  ///< Row of tiles in the picture that is stored first.
  /// Sums of rho, negative where the back is seen, infinite where fragments are merged; their last
  /// bits are the spacing_step(). All of a layer together: layers but the first two are hardly
  /// touched.
  Array<Patch> weights_;
  Array<Patch> depths_;  ///< Parallel to weights_.
  std::size_t layer_stride_ = 0;
  Array<std::uint8_t> used_;  ///< Layers in use, by patch.
  Array<TileInside> inside_;  ///< Sides that the tiles show.
};

/// Pixels whose edges depend on other tiles, until all tiles are drawn.
struct OpenPixels {
  struct Pixel {
    int x, y;
    std::size_t first;  ///< Place in `fragments` of the nearest fragment.
    int count;          ///< Number of fragments, which are stored nearest first.
    bool rest;          ///< A merged fragment follows that lies behind all of them, or weighs 0.
  };
  std::vector<Pixel> pixels;
  std::vector<Fragment> fragments;
  /// Pixels that are resolved as if they were at no edge.
  std::vector<LoneFragment> lone;

  /// A pixel's fragments, the merged one last.
  std::span<Fragment> fragments_of(const Pixel& pixel) {
    return std::span(fragments).subspan(pixel.first,
                                        static_cast<std::size_t>(pixel.count) + pixel.rest);
  }
  /// Adds the lone fragments of some pixels of a tile, by patch, as bits.
  void add_lone(const TileABuffer& tile,
                const std::array<std::uint16_t, kTilePixels / kPatchPixels>& which);
  /// Drops the pixels of the rows before one of the picture's.
  void keep_from_row(int row);
  void clear();
};

/// The result that resolve_pixel() left open, when all tiles around the pixel are stored.
/// \param tile  the picture's weights and shader.
PixelResult resolve_open_pixel(const TileABuffer& tile, const OpenPixels& open,
                               const OpenPixels::Pixel& pixel, const TileRims& rims);

}  // namespace surfel
