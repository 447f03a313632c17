#pragma once

// Depth peeling of splats, with which Zhang, Pajarola, "Single-Pass Point Rendering and Transparent
// Shading", 2006 (SP06), compare their transparency (section 2; Everitt 2001).

#include <cstdint>

#include <surfel/render/a_buffer.h>
#include <surfel/render/tile_raster.h>

namespace surfel {

/// Figures of peeling, summed over a frame.
struct PeelStatistics {
  int layers = 0;                     ///< Most layers that a pixel has, as far as peeled.
  int passes = 0;                     ///< Most passes over the splats of a tile.
  std::uint64_t unpeeled_pixels = 0;  ///< Pixels with layers left unpeeled.

  void add(const PeelStatistics& other) {
    layers = other.layers > layers ? other.layers : layers;
    passes = other.passes > passes ? other.passes : passes;
    unpeeled_pixels += other.unpeeled_pixels;
  }
};

/// Fills a tile's A-buffer, which must be empty, with the nearest, the second, ... surface of every
/// pixel. A layer takes three passes over the splats: one finds the nearest fragment that no layer
/// has, one sums up the fragments within epsilon behind it that show the same side, and one the
/// fragments that are as near to the mean depth of these. A last pass finds no fragment left. (A
/// fragment has been peeled if the last layer of its side reaches it; epsilon is the fragment's
/// own.) A layer is complete before the next begins, so that nothing depends on the order of the
/// splats but rounding. Ends when no fragment is left, or behind opaque surfaces that cover their
/// pixel.
PeelStatistics peel_tile(const TileJob& job, TileABuffer& tile);

}  // namespace surfel
