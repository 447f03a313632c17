#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include <surfel/base/types.h>

namespace surfel {

struct GaussianTile;
struct GaussianTileJob;

/// Room that a worker keeps between tiles whose kernels are integrated along rays.
struct GaussianRayScratch {
  /// A splat and what it is ordered by.
  struct Ordered {
    std::uint32_t key, splat;
  };
  std::vector<float> depth;  ///< Of the tile's splats, about the middle of the tile.
  std::vector<Ordered> order, spare;
  Array<std::uint32_t> splat;  ///< The tile's splats in their order, and fields of theirs.
  Array<float> red, green, blue, epsilon;
  /// Splats of the tile that meet each patch, as places in `splat`.
  Array<std::uint32_t> listed;
  Array<float> nearest;  ///< Of the listed splats: no contribution within the patch is nearer.
  Array<float> excess;   ///< Least exponent within the patch above the cut, base 2.
  Array<float> bound;    ///< Of blocks of listed splats: neither they nor later ones are nearer.
  Array<float> fragments;
};

/// Draws a tile by GaussianProfile::kExact, or by kSurfel, onto an empty tile. The same bits for
/// every instruction set.
void draw_gaussian_rays(const GaussianTileJob& job, GaussianRayScratch& scratch,
                        GaussianTile& tile);

}  // namespace surfel
