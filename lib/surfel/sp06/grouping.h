#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/timing.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/sp06/coloring.h>
#include <surfel/sp06/least_overlap.h>
#include <surfel/sp06/overlap_graph.h>

namespace surfel {

/// How many groups there are, and how they are chosen.
struct GroupingOptions {
  OverlapOptions overlap{};
  ColoringOrder order = ColoringOrder::kLargestFirst;
  /// 0: as few groups as the colouring needs, none with two splats that overlap. Above 0: so many,
  /// each splat where it overlaps least (least_overlap_groups()). At most kMaxGroups.
  int groups = 0;
  SURFEL_API std::vector<std::string> problems() const;
};

/// The groups that were made, and the graph of overlaps that they come from.
struct GroupingReport {
  std::size_t splats = 0;
  std::size_t unusable = 0;  ///< Position not finite or variance not positive: in group 0.
  std::uint32_t groups = 0;  ///< SP06's K.
  std::size_t max_degree = 0;
  double mean_degree = 0;
  std::uint64_t edges = 0;
  std::uint64_t graph_bytes = 0;
  std::vector<std::size_t> sizes;             ///< The number of usable splats of every group.
  std::optional<LeastOverlapReport> overlap;  ///< With a fixed number of groups.
  StageTimes times;
};

/// The group of every splat of the cloud (SP06 section 4). No two splats of a group overlap, unless
/// a relaxation allows it; with a fixed number of groups they overlap as little as can be. Does not
/// depend on the order of the splats in the cloud (except for splats at the very same place) nor on
/// the number of threads. Of more than kMostGroupedAtOnce splats, unless their number of groups is
/// fixed, blocks along a Morton curve get their groups one after the other (group_blocks.h). Throws
/// Error(kUsage) for bad options, Error(kInput) starting with `name` as make_overlap_graph() and
/// greedy_coloring() do.
SURFEL_API Array<std::uint16_t> make_groups(const SurfelCloud& cloud,
                                            const GroupingOptions& options,
                                            GroupingReport* report = nullptr,
                                            const std::string& name = {});

/// Sets the column `group` to make_groups(), and drops `group_radius`, which belongs to the groups
/// before.
SURFEL_API void group_splats(SurfelCloud& cloud, const GroupingOptions& options,
                             GroupingReport* report = nullptr, const std::string& name = {});

}  // namespace surfel
