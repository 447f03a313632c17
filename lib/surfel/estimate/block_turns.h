#pragma once

#include <algorithm>
#include <cstddef>
#include <string>
#include <vector>

#include <surfel/base/peers.h>
#include <surfel/base/progress.h>
#include <surfel/estimate/block_pass.h>

namespace surfel {

/// Makes something of each block of a cloud, every process of one block at a time, and hands
/// process 0 all of it in the order of the blocks.
/// \tparam T    what is made of a block; T::of(made.bytes()) is what another process gets.
/// \param make  make(begin_run, end_run) returns a T.
/// \param take  take(const T&) takes what was made of the next block; called by process 0 alone.
template <class T, class Make, class Take>
void make_in_turns(const BlockCloud& cloud, const std::string& stage, const Make& make,
                   const Take& take) {
  const RunIndex& index = cloud.index();
  const std::size_t block_runs = cloud.sizes.block_runs;
  const int processes = cloud.peers ? cloud.peers->count() : 1;
  const int rank = cloud.peers ? cloud.peers->rank() : 0;
  ProgressStage progress(stage, index.points(), "points");
  const std::size_t together = block_runs * static_cast<std::size_t>(processes);
  for (std::size_t first = 0; first < index.size(); first += together) {
    const std::size_t begin =
        std::min(first + static_cast<std::size_t>(rank) * block_runs, index.size());
    T mine;
    if (begin < index.size()) mine = make(begin, std::min(begin + block_runs, index.size()));
    if (rank == 0) take(mine);
    // Process 0 has room for one at a time.
    for (int sender = 1; sender < processes; ++sender) {
      std::vector<Bytes> to(static_cast<std::size_t>(processes));
      if (rank == sender && begin < index.size()) to[0] = mine.bytes();
      const std::vector<Bytes> from = cloud.peers->exchange(std::move(to));
      const Bytes& sent = from[static_cast<std::size_t>(sender)];
      if (rank == 0 && !sent.empty()) take(T::of(sent));
    }
    progress.add(index.begin(std::min(first + together, index.size())) - index.begin(first));
  }
}

}  // namespace surfel
