#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <surfel/laz/point_layout.h>

namespace surfel::laz {

// Chunks of points of formats 0 to 5: point after point in one stream of bits, after the first
// point as it is (LASzip's items of version 2).

/// Appends the chunk of `count` > 0 points to `chunk`.
void encode_pointwise(const PointLayout& layout, const std::byte* points, std::size_t count,
                      std::vector<std::uint8_t>& chunk);
/// Decodes `count` > 0 points. Throws Damage.
void decode_pointwise(const PointLayout& layout, std::span<const std::byte> chunk,
                      std::size_t count, std::byte* points);

}  // namespace surfel::laz
