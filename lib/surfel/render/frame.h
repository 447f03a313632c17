#pragma once

// The parts that a picture is drawn in: bands of rows, blocks of tiles.

#include <algorithm>
#include <cstddef>
#include <vector>

#include <surfel/render/splat.h>
#include <surfel/scene/camera.h>
#include <surfel/store/cluster_store.h>

namespace surfel {

class Shader;

static_assert(kTileSize == kRowsTogether);

/// Tiles along the side of `pixels` pixels.
constexpr int tiles_along(int pixels) { return (pixels + kTileSize - 1) / kTileSize; }

/// One horizontal band of a picture.
struct Band {
  int y0, y1;  ///< Rows of pixels: the first, and one past the last.
  int tiles_x, tiles_y;

  Band(const Camera& camera, int first_row, int last_row)
      : y0(first_row),
        y1(last_row),
        tiles_x(tiles_along(camera.width)),
        tiles_y(tiles_along(last_row - first_row)) {}
  std::size_t tiles() const { return static_cast<std::size_t>(tiles_x) * tiles_y; }
  /// Place of the tile in column x and row y among all, row by row.
  std::size_t tile(int x, int y) const { return static_cast<std::size_t>(y) * tiles_x + x; }
};

/// Square groups of tiles that a band is drawn in. A block has so many tiles that one worker's
/// caches hold their splats, so that splats are drawn as soon as they are set up and never go to
/// memory.
struct BlockGrid {
  int shift = 1;  ///< A block has 2^shift tiles a side.
  int blocks_x = 0, blocks_y = 0;

  BlockGrid() = default;
  /// \param surfels  number of surfels seen in the band, about.
  /// \param share    share of the band that a cluster's splats reach over, in the mean.
  BlockGrid(const Band& band, std::size_t surfels, double share);
  std::size_t blocks() const { return static_cast<std::size_t>(blocks_x) * blocks_y; }
  /// Rows of blocks.
  int row_of(std::size_t block) const { return static_cast<int>(block / blocks_x); }
  int size() const { return kTileSize << shift; }  ///< Pixels.
  int first_tile_x(std::size_t block) const { return static_cast<int>(block % blocks_x) << shift; }
  int first_tile_y(std::size_t block) const { return static_cast<int>(block / blocks_x) << shift; }
};

/// A band of a picture being drawn: all workers share it, and nothing of it changes meanwhile.
struct Frame {
  const Camera& camera;
  const Shader& shader;
  Band band;
  /// For each of Compositor::lists(), the clusters that reach into the band, nearest first.
  std::vector<std::vector<VisibleCluster>> clusters;
  BlockGrid grid;
  /// Rows of pixels to be drawn. What else there is of the picture, its grid for one, is as if all
  /// rows were.
  RowRange rows;

  /// Whether a tile is to be drawn, by its first row of pixels.
  bool draws_tile(int y0) const { return y0 + kTileSize > rows.begin && y0 < rows.end; }
  /// The rows of blocks that have tiles to be drawn.
  RowRange block_rows() const {
    return {std::max(0, rows.begin - band.y0) / grid.size(),
            (std::min(rows.end, band.y1) - band.y0 + grid.size() - 1) / grid.size()};
  }
  bool draws_block(std::size_t block) const {
    const RowRange range = block_rows();
    return grid.row_of(block) >= range.begin && grid.row_of(block) < range.end;
  }

  /// The rows of pixels around which `reach` rows have been drawn when this band has: rows of bands
  /// before are among them.
  RowRange surrounded_rows(int reach) const {
    const int end = std::min(band.y1, rows.end);
    return {rows.begin == 0 ? 0 : rows.begin + reach, end == camera.height ? end : end - reach};
  }
};

}  // namespace surfel
