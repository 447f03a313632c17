#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include <surfel/base/checkpoints.h>
#include <surfel/base/export.h>
#include <surfel/scene/surfel_ranges.h>
#include <surfel/scene/surfel_sink.h>
#include <surfel/sp06/grouping.h>

namespace surfel {

/// More splats than that are divided into groups block by block, whatever the memory.
inline constexpr std::size_t kMostGroupedAtOnce = std::size_t{1} << 18;
/// Surfels of a block that group_by_blocks() divides into groups at a time, at most.
inline constexpr std::size_t kGroupBlock = std::size_t{1} << 16;

/// Size of the blocks of group_by_blocks(), and where finished ones are kept.
struct GroupBlockOptions {
  std::size_t most = kGroupBlock;      ///< Surfels of a block, >= 1.
  Checkpoints* checkpoints = nullptr;  ///< Keeps the blocks that are finished; null: none.
};

/// Bytes that group_by_blocks() takes for so many surfels, of which each takes `row_bytes`: 2 for
/// each surfel, and a block with the surfels around it.
SURFEL_API std::uint64_t group_block_bytes(std::size_t surfels, std::size_t row_bytes);

/// Divides surfels that need not be in memory into groups, none with two splats that overlap.
///
/// The blocks of curve_blocks() take their groups one after the other along the curve. The graph of
/// a block has the splats around it as well, which overlap some of its splats: where these lie in
/// blocks before, their groups are taken already, and a splat takes the first group that none of
/// its neighbours has; where they lie in later blocks, they count for the degree, by which
/// GroupingOptions::order sorts the splats of the block. The result depends neither on the memory
/// nor on threads: the blocks are the same for all. It may have more groups than one colouring of
/// all splats, see docs/groups.md.
///
/// \param cloud    The surfels, read by ranges.
/// \param options  `groups` is 0.
/// \param sink     Gets the blocks along the curve, with the column `group` and without
///                 `group_radius`.
/// \param report   If not null, filled.
/// \param name     The cloud's file, for messages.
/// \param parts    Size of the blocks, and where finished ones are kept.
///
/// Returns false, before anything comes to the sink, where the cloud is not in the order of
/// morton_order(). Throws as make_groups() does.
SURFEL_API bool group_by_blocks(const SurfelRanges& cloud, const GroupingOptions& options,
                                SurfelSink& sink, GroupingReport* report = nullptr,
                                const std::string& name = {}, const GroupBlockOptions& parts = {});

}  // namespace surfel
