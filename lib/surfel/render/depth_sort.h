#pragma once

#include <cstddef>
#include <cstdint>

#include <surfel/base/types.h>

namespace surfel {

/// Orders the splats of a tile, nearest first, those whose depths are about equal as they come: the
/// key is the depth's place in the tile's range, in as many steps as there are splats but 2048 at
/// most. Finer order changes nothing that is seen, as surfaces are told apart by depth whatever
/// comes first. SIMD, chosen at run time.
/// \param depths  `count` of them, larger is nearer, and room up to the next multiple of kTileSize
/// \param splats  parallel to them
/// \param keys    scratch memory, kept from call to call
/// \param order   `count` of `splats`
void sort_front_to_back(const float* depths, const std::uint32_t* splats, std::size_t count,
                        Array<std::uint32_t>& keys, std::uint32_t* order);

}  // namespace surfel
