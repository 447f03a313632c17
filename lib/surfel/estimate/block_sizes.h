#pragma once

#include <cstddef>
#include <cstdint>

#include <surfel/estimate/estimate_blocks.h>
#include <surfel/estimate/run_index.h>
#include <surfel/scene/surfel_ranges.h>

namespace surfel {

/// How the memory for an estimate by blocks is divided.
struct BlockSizes {
  std::size_t block_runs = 0;       ///< Runs of a block.
  std::size_t most_loaded = 0;      ///< Points that are in memory at once, halos included.
  std::uint64_t forest_memory = 0;  ///< Bytes for ForestSides.
  std::uint64_t index_bytes = 0;    ///< Bytes of the index of runs.
  std::uint64_t all_memory = 0;     ///< Bytes for everything.
  bool bounded = true;              ///< False where the size of blocks was asked for: none counts.
};

/// Points of a run. Halos are whole runs, which have to be small beside a block; their index has to
/// be small beside the memory.
std::size_t run_length(const SurfelRanges& cloud, const BlockOptions& blocks);

/// \param column_bytes   bytes of a point's columns
/// \param along_surface  sides spread from edge to edge, and need memory beside the blocks.
///
/// Throws Error(kUsage) where there is too little memory for a block.
BlockSizes block_sizes(const RunIndex& index, std::size_t column_bytes, bool along_surface,
                       const BlockOptions& blocks);

}  // namespace surfel
