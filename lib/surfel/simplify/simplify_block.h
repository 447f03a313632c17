#pragma once

// simplify_surfels() of a part of a cloud. Internal to the simplify module.

#include <cstddef>
#include <string>
#include <vector>

#include <surfel/scene/surfel_cloud.h>
#include <surfel/simplify/simplify.h>

namespace surfel {

/// What holds for the whole cloud that a block is a part of.
struct SimplifiedWhole {
  double total_area = 0;  ///< Of the surfels, unit^2.
  double brightness = 0;  ///< Mean of their colours.
};

/// Prices of a further surfel that blocks are compared at: errors squared of the whole surface,
/// from the highest on.
std::vector<double> compared_prices();

/// What a block has at each of compared_prices().
struct BlockDetail {
  std::size_t surfels = 0;      ///< Usable ones.
  double area = 0;              ///< Of these.
  std::vector<double> samples;  ///< Surfels that are left, about.
  std::vector<double> error2;   ///< Square of the error, as a mean over the block.
};

/// Throws Error(kInput), its message starting with `name`, for a cloud without surfels, or without
/// the columns that simplify_surfels() needs.
void require_simplifiable(const SurfelCloud& cloud, const std::string& name);
/// \param block    holds a surfel that can be drawn and whose centre is not cut off.
/// \param options  `unit_deviation` is set.
BlockDetail block_detail(const SurfelCloud& block, const SimplifyOptions& options,
                         const SimplifiedWhole& whole, const std::string& name);
/// Simplifies a block: all blocks get the same columns.
SurfelCloud simplify_block(const SurfelCloud& block, const SimplifyOptions& options,
                           const SimplifiedWhole& whole, SimplifyReport& report,
                           const std::string& name);

}  // namespace surfel
