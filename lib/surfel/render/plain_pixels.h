#pragma once

#include <array>

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
  TileInside inside;
};

/// Resolves the plain pixels of a tile, a vector at a time, where there is no environment: those of
/// whose fragments, up to the first opaque one, none may lie at the edge of its surface. Their
/// colours are resolve_pixel()'s over a background (premultiplied), but for rounding. In a tile
/// that lies inside a surface all pixels are plain: the ones near open sides are coloured as if
/// they were at no edge, and change by TileRims::coverage_change(). \param lighting  null: unlit.
PlainPixels resolve_plain_pixels(TileABuffer& tile, const Lighting* lighting,
                                 const Rgba& background);

}  // namespace surfel
