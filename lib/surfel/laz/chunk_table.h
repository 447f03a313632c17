#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <surfel/base/export.h>

namespace surfel::laz {

/// A chunk of a file: how many points it has, and how many bytes.
struct ChunkSize {
  std::uint32_t points = 0;
  std::uint32_t bytes = 0;
  bool operator==(const ChunkSize&) const = default;
};

/// The table of a file's chunks as it is stored behind them.
/// \param variable  Chunks have numbers of points of their own; else the table leaves these out.
SURFEL_API std::vector<std::uint8_t> encode_chunk_table(std::span<const ChunkSize> chunks,
                                                        bool variable);
/// The reverse, from the table's first byte on to the end of the file at most. Throws Damage, also
/// for more chunks than `most`, before it takes memory for them.
/// \param chunk_points  points of every chunk where they are not `variable`
SURFEL_API std::vector<ChunkSize> decode_chunk_table(std::span<const std::byte> table,
                                                     bool variable, std::uint32_t chunk_points,
                                                     std::uint64_t most);

}  // namespace surfel::laz
