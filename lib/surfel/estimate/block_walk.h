#pragma once

#include <cstddef>
#include <optional>

#include <surfel/base/checkpoints.h>
#include <surfel/estimate/block_pass.h>
#include <surfel/estimate/block_totals.h>

namespace surfel {

/// A walk along the blocks of a cloud, which stops at those that are this process's and that no
/// earlier run has made.
class BlockWalk {
 public:
  /// A block by its runs, and the number of its first surfel in the result.
  struct Block {
    std::size_t begin_run = 0, end_run = 0;
    std::size_t surfel = 0;
  };

  /// Keeps references.
  /// \param checkpoints  null: no blocks are kept.
  BlockWalk(const BlockCloud& cloud, Checkpoints* checkpoints)
      : cloud_(cloud), checkpoints_(checkpoints) {}

  /// The next block to be made; none at the end. Blocks that an earlier run made count already.
  std::optional<Block> next();
  /// Counts, and keeps, the block that next() has told, which has so many surfels.
  void finish(const Block& block, std::size_t surfels, const BlockTotals& totals);
  const BlockTotals& totals() const { return totals_; }
  /// The point up to which all is done, or is another process's.
  std::size_t points_done() const { return cloud_.index().begin(run_); }

 private:
  bool restore();

  const BlockCloud& cloud_;
  Checkpoints* checkpoints_;
  std::size_t run_ = 0, surfel_ = 0;  ///< Where the walk has come.
  std::size_t made_ = 0;              ///< Blocks that no earlier run made, of all processes.
  BlockTotals totals_;
};

}  // namespace surfel
