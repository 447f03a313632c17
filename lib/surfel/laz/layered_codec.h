#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <surfel/laz/point_layout.h>

namespace surfel::laz {

// Chunks of points of formats 6 to 10: the first point as it is, the number of points, then each
// kind of values as a stream of bits of its own, or nothing where all points have the first
// one's values (LASzip's items of versions 3 and 4).

/// Appends the chunk of `count` > 0 points to `chunk`.
void encode_layered(const PointLayout& layout, const std::byte* points, std::size_t count,
                    std::vector<std::uint8_t>& chunk);
/// Decodes `count` > 0 points. Throws Damage.
void decode_layered(const PointLayout& layout, std::span<const std::byte> chunk, std::size_t count,
                    std::byte* points);

}  // namespace surfel::laz
