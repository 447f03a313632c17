#pragma once

// Edges of surfaces, found by the sums of rho in the pixels around. A picture does not depend on
// where its tiles lie: sums beyond a tile's border are those of the tiles next to it.

#include <array>
#include <cstddef>
#include <vector>

#include <surfel/base/types.h>
#include <surfel/render/a_buffer.h>

namespace surfel {

/// How far edges are looked for, along columns and rows, pixels.
inline constexpr int kEdgeReach = 2;

/// The sums of rho of the fragments that continue a fragment in the pixels around it.
struct EdgeNeighbors {
  static constexpr float kOutside = -1;  ///< The pixel is outside of the picture.
  static constexpr float kUnknown = -2;  ///< The pixel is another tile's.

  /// By distance + kEdgeReach, along the row and along the column.
  std::array<std::array<float, 2 * kEdgeReach + 1>, 2> weight;

  bool known() const;
};

/// Whether a fragment's surface may end at its pixel, so that the pixels around have to be looked
/// at: its sum is less than a surface has, and its splats are no larger than the pixel filter.
bool may_be_at_edge(const TileABuffer& tile, const Fragment& fragment);

/// The sums around a fragment, as far as they are in its tile.
EdgeNeighbors look_around(TileABuffer& tile, const Fragment& fragment, int pixel);

/// To what degree an unmerged fragment's pixel is at the edge of its surface, 0 to 1. All
/// neighbours are known; outside of the picture the sums are taken to go on as they came.
float edge_of(const TileABuffer& tile, const Fragment& fragment, const EdgeNeighbors& around);

/// The fragments of pixels within kEdgeReach of the borders of a band's tiles, and of the last row
/// of tiles of the band before. Tiles may be stored at once; nothing is stored while others read.
class TileRims {
 public:
  /// \param first_row  row of tiles in the picture that the band begins with.
  void begin(int tiles_x, int tiles_y, int first_row, int layers);
  void store(const TileABuffer& tile);
  /// Fills in the unknown sums around a fragment of the picture's pixel (x, y).
  void complete(const Fragment& fragment, int x, int y, EdgeNeighbors& around) const;

 private:
  /// An unmerged fragment of a pixel.
  struct RimFragment {
    float weight;  ///< Sum of rho, negative if the back is seen; 0: no more fragments follow.
    float depth;
  };
  /// Two rows at the top and bottom, and two columns at either side between them.
  static constexpr int kRimPixels =
      2 * kEdgeReach * kTileSize + 2 * kEdgeReach * (kTileSize - 2 * kEdgeReach);

  static int rim_pixel(int x, int y);
  RimFragment* tile_rim(int tile_x, int tile_y);
  const RimFragment* tile_rim(int tile_x, int tile_y) const;

  int tiles_x_ = 0, tiles_y_ = 0;
  int first_row_ = 0;  ///< Row of tiles in the picture that is stored first.
  int layers_ = 0;
  /// Tiles x layers x kRimPixels: of most pixels the first two are all that there is.
  Array<RimFragment> fragments_;
};

/// Pixels whose edges depend on other tiles, until all tiles are drawn.
struct OpenPixels {
  struct Surface {
    Fragment fragment;
    bool looked;  ///< Whether `around` has been looked at.
    EdgeNeighbors around;
  };
  struct Pixel {
    int x, y;
    std::size_t begin, end;  ///< Of its surfaces, nearest first.
    Fragment rest;           ///< A merged fragment behind all of them; of weight 0: none.
  };
  std::vector<Pixel> pixels;
  std::vector<Surface> surfaces;
};

/// What resolve_pixel() makes of a pixel, when all tiles around are stored.
/// \param tile  the picture's weights and shader.
PixelResult resolve_open_pixel(const TileABuffer& tile, const OpenPixels& open,
                               const OpenPixels::Pixel& pixel, const TileRims& rims);

}  // namespace surfel
