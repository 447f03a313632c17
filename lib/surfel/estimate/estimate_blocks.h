#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <surfel/base/checkpoints.h>
#include <surfel/base/export.h>
#include <surfel/base/peers.h>
#include <surfel/estimate/estimate.h>
#include <surfel/scene/surfel_ranges.h>
#include <surfel/scene/surfel_sink.h>

namespace surfel {

struct BlockOptions {
  /// Bytes that the work may take, what the process has already and what the sink takes excluded;
  /// of several processes the least counts.
  std::uint64_t memory = std::uint64_t{1} << 30;
  std::size_t most_points = 0;  ///< Points of a block; 0 = as many as the memory holds.
  /// What kWinding finds before the surfels are made, 16 bytes a point, waits on a scratch file on
  /// the disk of this file, see ScratchFile.
  std::string beside = {};
  Checkpoints* checkpoints = nullptr;  ///< Keeps the blocks that are finished; null: none.
  /// Processes among which the blocks are shared, which all call estimate_by_blocks() with the same
  /// arguments; null: this one alone. The sink of each gets the surfels of its blocks.
  Peers* peers = nullptr;
};

/// Why surfels cannot be estimated block by block with these options: one sentence each, empty if
/// they can.
SURFEL_API std::vector<std::string> block_problems(const EstimateOptions& options);

/// Bytes that estimate_surfels() takes for a cloud of so many points whose columns take
/// `point_bytes` each (row_bytes()), the cloud and the surfels included.
SURFEL_API std::uint64_t estimate_bytes(std::size_t points, std::size_t point_bytes);

/// Makes surfels of a cloud that need not be in memory: the same ones, in the same order, as
/// estimate_surfels() makes of all its points at once, whatever the size of the blocks.
///
/// A block is a range of consecutive points. Its neighbourhoods are searched for among its points
/// and a halo: all runs of consecutive points (run_index.h) that come within a distance of it that
/// suffices for nearly all of them, and is told from its density. A point of which that is not so
/// (halo_search.h), as at the edges of gaps and far from all others, is estimated again with as
/// much of the cloud around it as its neighbourhoods, and its neighbours' neighbourhoods, turn out
/// to need. What is decided for the whole cloud is told from samples of it (place_sample.h), the
/// same that estimate_surfels() looks at; that ellipses are worth it is guessed from some runs and
/// counted on the way: after a wrong guess, which a mixed cloud may cause, the blocks are made once
/// more.
///
/// In memory are 38 bytes for every 1024 points (fewer, down to 64, where blocks are small), a
/// block, and a halo of about its size at most (parts of a block are made one by one if need be).
/// The cloud is read once, for the boxes of its runs, and then block by block; with a cloud whose
/// consecutive points do not lie close to one another halos would be most of it, and Error(kInput)
/// is thrown that starts with `name`.
///
/// Throws Error(kUsage) for block_problems(), and as estimate_surfels() does otherwise.
SURFEL_API void estimate_by_blocks(const SurfelRanges& cloud, const EstimateOptions& options,
                                   const BlockOptions& blocks, SurfelSink& sink,
                                   EstimateReport* report = nullptr, const std::string& name = {});

}  // namespace surfel
