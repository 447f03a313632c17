#include <algorithm>
#include <bit>
#include <limits>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/estimate/block_sizes.h>
#include <surfel/scene/cloud_rows.h>

namespace surfel {
namespace {

/// Points of a run: the most, and the least.
constexpr std::size_t kRunLength = 1024;
constexpr std::size_t kLeastRun = 64;
/// A larger block saves hardly any halo, and exceeds the processor's caches.
constexpr std::size_t kMostBlock = std::size_t{1} << 20;
/// Bytes that the estimate of a point takes with its place in the search, besides its columns.
constexpr std::size_t kPointBytes = 330;

std::uint64_t bytes_of_point(std::size_t column_bytes) { return kPointBytes + 2 * column_bytes; }

}  // namespace

std::size_t run_length(const SurfelRanges& cloud, const BlockOptions& blocks) {
  if (blocks.most_points > 0) return std::min(kRunLength, blocks.most_points);
  constexpr std::size_t kRunsOfBlock = 64;
  constexpr std::size_t kShareOfIndex = 8;
  const std::uint64_t point_bytes =
      bytes_of_point(cloud.size() > 0 ? row_bytes(cloud.read(0, 1)) : 0);
  const std::uint64_t of_block = blocks.memory / point_bytes / kRunsOfBlock;
  const std::uint64_t of_index = cloud.size() * RunIndex::kRunBytes * kShareOfIndex /
                                 std::max<std::uint64_t>(1, blocks.memory);
  return std::bit_floor(static_cast<std::size_t>(
      std::clamp<std::uint64_t>(std::max(of_block, of_index), kLeastRun, kRunLength)));
}

BlockSizes block_sizes(const RunIndex& index, std::size_t column_bytes,
                       const BlockOptions& blocks) {
  BlockSizes out;
  out.index_bytes = index.size() * RunIndex::kRunBytes;
  out.all_memory = blocks.memory;
  std::size_t points = blocks.most_points;
  if (points > 0) {
    out.bounded = false;
    out.most_loaded = std::numeric_limits<std::size_t>::max();
  } else {
    const std::uint64_t point_bytes = bytes_of_point(column_bytes);
    const std::uint64_t memory = blocks.memory - std::min(blocks.memory, out.index_bytes);
    out.most_loaded = static_cast<std::size_t>(memory / point_bytes);
    // The halo takes its part.
    points = std::min(out.most_loaded / 10 * 7, kMostBlock);
    if (points < kRunLength) {
      throw_usage(fmt::format(
          "{} bytes of memory are too few to estimate {} points: give at least {} bytes",
          blocks.memory, index.points(), out.index_bytes + 2 * kRunLength * point_bytes));
    }
  }
  out.block_runs = std::max<std::size_t>(1, points / index.length());
  return out;
}

}  // namespace surfel
