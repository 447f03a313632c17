#include <algorithm>
#include <cstdint>
#include <cstring>
#include <string>
#include <type_traits>

#include <surfel/estimate/block_walk.h>

namespace surfel {
namespace {

/// What is kept of a block. Later runs may have blocks of other sizes, though not of other runs.
struct KeptBlock {
  std::uint64_t run_length;
  std::uint64_t end_run;
  std::uint64_t end_surfel;
  BlockTotals totals;
};
static_assert(std::is_trivially_copyable_v<KeptBlock>);

}  // namespace

/// Goes on behind a block that an earlier run made.
bool BlockWalk::restore() {
  if (!checkpoints_) return false;
  const std::optional<std::string> state = checkpoints_->finished(run_);
  KeptBlock kept;
  if (!state || state->size() != sizeof(kept)) return false;
  std::memcpy(&kept, state->data(), sizeof(kept));
  if (kept.run_length != cloud_.index().length()) return false;
  run_ = kept.end_run;
  surfel_ = kept.end_surfel;
  // All processes know of the block, and one counts it.
  if (!cloud_.peers || cloud_.peers->rank() == 0) totals_.add(kept.totals);
  return true;
}

std::optional<BlockWalk::Block> BlockWalk::next() {
  const RunIndex& index = cloud_.index();
  while (run_ < index.size()) {
    if (restore()) continue;
    const Block block{run_, std::min(run_ + cloud_.sizes.block_runs, index.size()), surfel_};
    for (; run_ < block.end_run; ++run_) surfel_ += index[run_].finite;
    // What is left to be made goes to the processes in turns.
    const std::size_t number = made_++;
    if (!cloud_.peers || number % static_cast<std::size_t>(cloud_.peers->count()) ==
                             static_cast<std::size_t>(cloud_.peers->rank())) {
      return block;
    }
  }
  return std::nullopt;
}

void BlockWalk::finish(const Block& block, std::size_t surfels, const BlockTotals& totals) {
  totals_.add(totals);
  if (!checkpoints_) return;
  const KeptBlock kept{cloud_.index().length(), block.end_run, block.surfel + surfels, totals};
  const RowSpan rows{block.surfel, block.surfel + surfels};
  checkpoints_->finish(block.begin_run, {&rows, 1},
                       std::string(reinterpret_cast<const char*>(&kept), sizeof(kept)));
}

}  // namespace surfel
