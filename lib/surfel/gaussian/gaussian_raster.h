#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include <surfel/base/types.h>
#include <surfel/gaussian/gaussian_projection.h>
#include <surfel/gaussian/gaussian_rays.h>
#include <surfel/gaussian/gaussian_splat.h>

namespace surfel {

inline constexpr std::size_t kGaussianTilePixels =
    std::size_t{kGaussianTile} * std::size_t{kGaussianTile};

/// The splats of one tile of a picture, in the order of their keys.
struct GaussianTileJob {
  const GaussianView* view;
  const GaussianSplat* splats;
  const GaussianPerspective* perspective;  ///< Null where kernels are affine.
  const std::uint32_t* order;              ///< Numbers of splats; whole vectors may be read.
  std::size_t count;
  int x0, y0;  ///< The tile's first pixel.
  bool depth;  ///< Depths are wanted.
};

/// Room that a worker keeps between tiles.
struct GaussianScratch {
  std::vector<std::uint32_t> listed;  ///< Splats that meet each patch of a tile.
  GaussianRayScratch rays;            ///< kExact's.
};

/// Sums of the splats of a tile at its pixels, colours as displays take them. The pixels of a patch
/// of 4 x 4 follow one another, row by row; so do the patches of the tile.
struct alignas(64) GaussianTile {
  float red[kGaussianTilePixels];
  float green[kGaussianTilePixels];
  float blue[kGaussianTilePixels];
  float transmittance[kGaussianTilePixels];
  float depth[kGaussianTilePixels];   ///< Sum of contributions times depths.
  float median[kGaussianTilePixels];  ///< Depth at which the transmittance passes 1/2, or 0.
};

/// Draws a tile. The same bits for every instruction set.
///
/// Splats are listed by the patches of 4 x 4 pixels that they meet, tested by the least exponent
/// within the patch, and each patch blends its list with its sums in registers. kExact blends the
/// contributions of every pixel in the order of their depths: they wait in a sorted list until
/// no splat to come can be nearer.
void draw_gaussian_tile(const GaussianTileJob& job, GaussianScratch& scratch, GaussianTile& tile);

/// How a tile becomes a part of a picture.
struct GaussianOutput {
  float* pixels;  ///< Of the picture.
  int width, height;
  int channels;         ///< 4, or 6 with depths.
  float background[4];  ///< Premultiplied, as displays take it.
  bool display;         ///< Colours stay as they are; otherwise they become linear.
};

/// Writes the pixels of a tile that are within the picture, premultiplied.
void write_gaussian_tile(const GaussianTile& tile, int x0, int y0, const GaussianOutput& out);

}  // namespace surfel
