#pragma once

// The renderer that Zhang, Pajarola, "Single-Pass Point Rendering and Transparent Shading", 2006
// (SP06), compare Algorithm 1 with: section 3.1, a tile at a time.

#include <surfel/render/a_buffer.h>
#include <surfel/render/tile_raster.h>

namespace surfel {

/// Passes of draw_two_pass() over the splats.
inline constexpr int kTwoPassGeometryPasses = 2;

/// Fills the A-buffer of a tile, which must be empty, with opaque splats, as renderers of 2+1
/// passes do. The visibility pass finds the nearest fragment of every pixel, without kernels,
/// attributes or blending. The attribute pass sums up the fragments that show the same side and lie
/// at most epsilon behind it, weighted by their kernels: the numerator and the denominator of SP06
/// (1), in the first layer. The third pass, which divides and shades, is resolve_pixel().
///
/// SP06 moves the depths of the first pass back by one epsilon for all. Here, as in the other
/// methods, a fragment brings its own epsilon, and is moved to the front by it.
///
/// Where the nearest surface does not cover its pixel, at its edge, the fragments behind it go to
/// the layers behind the first in the second pass, as splats do in the A-buffer; SP06 shows none
/// there, as a single layer does.
void draw_two_pass(const TileJob& job, TileABuffer& tile);

}  // namespace surfel
