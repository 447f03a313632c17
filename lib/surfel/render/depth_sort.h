#pragma once

#include <cstddef>
#include <cstdint>

#include <surfel/base/export.h>
#include <surfel/base/types.h>

namespace surfel {

/// How finely depths are told apart; splats of equal keys stay in the order that they come in.
enum class DepthOrder {
  /// As many steps of the range as there are splats, but 2048 at most: enough for methods that tell
  /// surfaces apart by depth whatever the order of their splats.
  kCoarse,
  kFine,  ///< 2^22 steps.
};

/// Memory of sort_front_to_back(), kept from call to call.
struct DepthSortScratch {
  Array<std::uint32_t> keys, by_low_bits;
};

/// Orders the splats of a tile, nearest first. SIMD, chosen at run time.
/// \param depths   `count` depths, larger is nearer, and room up to the next multiple of kTileSize.
/// \param splats   Numbers of the splats, parallel to `depths`.
/// \param count    Number of splats.
/// \param how      The precision of the order.
/// \param scratch  Memory that grows as needed.
/// \param order    Filled with the `count` numbers of `splats`, nearest first.
SURFEL_API void sort_front_to_back(const float* depths, const std::uint32_t* splats,
                                   std::size_t count, DepthOrder how, DepthSortScratch& scratch,
                                   std::uint32_t* order);

}  // namespace surfel
