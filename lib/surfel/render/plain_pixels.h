#pragma once

#include <array>
#include <cstdint>

#include <surfel/render/a_buffer.h>
#include <surfel/render/edge_search.h>
#include <surfel/render/lighting.h>
#include <surfel/render/splat.h>

namespace surfel {

/// Colours of pixels of a tile, in the order of tile_pixel().
struct PlainPixels {
  alignas(64) std::array<Rgba, kTilePixels> color;
  alignas(
      64) std::array<float, kTilePixels> left;  ///< 0: the pixel has its colour; 1: it has none.
  alignas(64) std::array<float, kTilePixels> opacity;  ///< Without the background's.
  /// Nearness (Splat::depth) where opacity passes one half, else of the nearest fragment; -infinity
  /// where there is none.
  alignas(64) std::array<float, kTilePixels> nearness;
  /// By patch, as bits: pixels near the tile's border that have a lone fragment, which may be at an
  /// edge, and are coloured as if it were at none.
  std::array<std::uint16_t, kTilePixels / kPatchPixels> lone;
  TileInside inside;
  /// Of a tile inside a surface: whether no first contribution is coarse (kCoarseStep).
  bool inside_fine = false;
};

/// Resolves the plain pixels of a tile, a vector at a time, where there is no environment. A pixel
/// is plain if none of its fragments, up to the first opaque one, may lie at the edge of its
/// surface; near the tile's border, or with TileABuffer::edges_later, a pixel with a single
/// fragment is plain, too. The colours are resolve_pixel()'s over a background (premultiplied)
/// within rounding.
/// \param lighting  null: unlit.
PlainPixels resolve_plain_pixels(TileABuffer& tile, const Lighting* lighting,
                                 const Rgba& background);

}  // namespace surfel
