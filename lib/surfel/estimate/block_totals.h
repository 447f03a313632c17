#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include <surfel/estimate/block_pass.h>
#include <surfel/estimate/estimate.h>
#include <surfel/estimate/surfel_blocks.h>

namespace surfel {

/// Sums over the points of blocks, which do not depend on the blocks' order.
struct BlockTotals {
  std::array<std::size_t, kPointFlags> flagged{};
  std::size_t neighbors = 0, extended = 0, flipped = 0, unknown = 0;
  std::size_t border = 0, capped = 0, elongated = 0, components = 0, unusable_colors = 0;
  std::uint64_t confidence = 0;
  Orientation method = Orientation::kNone;

  static BlockTotals of(const SurfelBlock& block, const BlockCloud& cloud);
  void add(const BlockTotals& more);
  /// Adds the totals of all processes.
  void add_up(Peers* peers);
  /// Writes the sums over all blocks to a report.
  void fill(const BlockCloud& cloud, EstimateReport& report) const;
};

}  // namespace surfel
