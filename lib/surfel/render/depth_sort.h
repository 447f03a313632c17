#pragma once

#include <cstddef>
#include <cstdint>

#include <surfel/base/types.h>

namespace surfel {

/// Memory of sort_front_to_back(), kept from call to call.
struct DepthSortScratch {
  Array<std::uint32_t> keys;
  Array<std::uint64_t> by_low_byte;
};

/// Orders the splats of a tile, nearest first, those of equal depth as they come. The key is 16
/// bits of the depth's place in the tile's range, so that closer depths may count as equal.
/// SIMD, chosen at run time.
/// \param depths  `count` of them, larger is nearer, and room up to the next multiple of kTileSize
/// \param splats  parallel to them
/// \param order   `count` of `splats`
void sort_front_to_back(const float* depths, const std::uint32_t* splats, std::size_t count,
                        DepthSortScratch& scratch, std::uint32_t* order);

}  // namespace surfel
