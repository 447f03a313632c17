#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include <surfel/base/checkpoints.h>
#include <surfel/base/export.h>
#include <surfel/scene/surfel_ranges.h>
#include <surfel/scene/surfel_sink.h>
#include <surfel/simplify/simplify.h>

namespace surfel {

/// More surfels than that are simplified block by block, whatever the memory.
inline constexpr std::size_t kMostAtOnce = std::size_t{1} << 18;

/// Bytes that simplify_surfels() takes for surfels that are simplified at once, of which each takes
/// `row_bytes`, the surfels and their result included.
SURFEL_API std::uint64_t simplify_bytes(std::size_t surfels, std::size_t row_bytes);
/// Bytes that simplify_by_blocks() takes for any number of surfels.
SURFEL_API std::uint64_t simplify_block_bytes(std::size_t row_bytes);

/// Size of the blocks of simplify_by_blocks(), and where finished ones are kept.
struct SimplifyBlockOptions {
  std::size_t most = std::size_t{1} << 16;  ///< Surfels of a block, >= 1.
  /// Keeps what blocks need and the blocks that are finished; null: none.
  Checkpoints* checkpoints = nullptr;
};

/// Simplifies surfels that need not be in memory, in the blocks of curve_blocks(): no surfel is
/// merged with one of another block.
///
/// With `count`, blocks share the count by what they need: a first pass over the blocks finds how
/// many surfels each has at any price of a further surfel (detail_tree.h), and the price at which
/// all blocks together have as many as asked for. With `max_error`, a block may have the error that
/// it has at the price at which the whole cloud has the error asked for, and half of the latter
/// at least, such that the root mean square over the whole surface is kept.
///
/// The result depends neither on the memory nor on threads. Mirror images follow the surfels of
/// their block. Coordinates are double wherever the cloud's origin is not zero.
///
/// \param cloud    The surfels, read by ranges.
/// \param options  The number of surfels, or the error, that is asked for.
/// \param sink     Gets the results of the blocks along the curve; how many surfels will come is
///                 not known when it begins, and 0 there.
/// \param report   If not null, filled.
/// \param name     The cloud's file, for messages.
/// \param blocks   Size of the blocks, and where finished ones are kept.
///
/// Returns false, before anything comes to the sink, where the cloud is not in the order of
/// morton_order(). Throws as simplify_surfels() does.
SURFEL_API bool simplify_by_blocks(const SurfelRanges& cloud, const SimplifyOptions& options,
                                   SurfelSink& sink, SimplifyReport* report = nullptr,
                                   const std::string& name = {},
                                   const SimplifyBlockOptions& blocks = {});

}  // namespace surfel
