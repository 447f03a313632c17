#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/laz/point_layout.h>

namespace surfel::laz {

/// Most points that a byte of a chunk can stand for: each point takes a symbol of 64 or more at
/// least, whose probability stays below 1 by 2^-15 for each of the other symbols.
inline constexpr std::uint64_t kMostPointsOfByte = 4096;

/// Compressed points that depend on no others: LASzip's format, pointwise for point formats up to
/// 5, in layers for 6 to 10. `points` are LAS records, one after the other; `count` > 0.
SURFEL_API std::vector<std::uint8_t> encode_chunk(const PointLayout& layout,
                                                  const std::byte* points, std::size_t count);
/// Throws Damage where the bytes do not hold so many points. Takes time and memory in
/// proportion to the points alone.
SURFEL_API void decode_chunk(const PointLayout& layout, std::span<const std::byte> chunk,
                             std::size_t count, std::byte* points);

}  // namespace surfel::laz
