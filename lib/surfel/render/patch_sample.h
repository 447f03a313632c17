#pragma once

#include <cstddef>
#include <cstdint>

#include <surfel/render/tile_raster.h>

namespace surfel {

/// The values of a splat's kernel and plane in the pixels of a patch.
struct PatchSample {
  alignas(64) float beta[kPatchPixels];  ///< Less than the cutoff inside, infinite behind a line.
  float depth[kPatchPixels];    ///< Depth of the surfel's plane, within the kernel's reach.
  float epsilon[kPatchPixels];  ///< Fragments whose depths differ by less are of one surface.
  float rho[kPatchPixels];      ///< The kernel where beta is less than the cutoff.
};

/// Where a patch is sampled.
struct PatchPlace {
  int x0, y0;                 ///< First pixel of the tile in the picture.
  std::size_t pixel;          ///< First pixel of the patch in the tile.
  float right = 0, down = 0;  ///< From the pixels' centres, pixels.
};

/// Evaluates one of a job's splats as rasterize_tile() does: for rasters that are not worth vector
/// code of their own.
void sample_patch(const TileJob& job, std::uint32_t splat, const PatchPlace& place,
                  PatchSample& out);

}  // namespace surfel
