#pragma once

#include <cstddef>
#include <cstdint>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/sp06/coloring.h>
#include <surfel/sp06/overlap_graph.h>

namespace surfel {

/// Area of the lens that two discs in one plane share, unit^2; radii >= 0.
SURFEL_API double lens_area(double radius_a, double radius_b, double distance);

/// How much the splats of the groups overlap.
struct LeastOverlapReport {
  double disc_area = 0;  ///< Sum of the areas of all discs, unit^2.
  /// Sum of the lens areas within groups, unit^2, after the first placement ...
  double placed_overlap_area = 0;
  double overlap_area = 0;              ///< ... and in the end.
  std::uint64_t overlapping_pairs = 0;  ///< Edges whose two splats share a group in the end.
  int sweeps = 0;                       ///< Over all splats, the last of which moved none, or
  std::size_t moved_last = 0;           ///< this many, where kMaxSweeps ended it.
};

/// A fixed number of groups for transparent rendering (SP06 sections 4.2 and 6.2): each splat goes
/// where it overlaps least. The overlap of a splat with a group is the sum of the lens areas that
/// it shares with the splats of that group which are its neighbours in the graph, discs of
/// splat_radius() taken as lying in one plane. Splats are placed in the order given; of groups
/// where a splat overlaps nothing it takes the one with the fewest splats, of equals the first.
/// Then, in the same order, every splat moves to where it overlaps less, until none does: in the
/// end no splat alone can lower the sum.
///
/// 4 bytes for each end of an edge. Placement is sequential: the same for any number of threads.
///
/// \param cloud   The surfels, with sizes.
/// \param graph   The pairs of splats that overlap.
/// \param cutoff  Radius of a splat in standard deviations, as splat_radius() takes it.
/// \param order   Every splat once: the order in which they are placed.
/// \param groups  1..kMaxGroups; some stay empty if there are fewer splats.
/// \param report  If not null, filled.
SURFEL_API Coloring least_overlap_groups(const SurfelCloud& cloud, const OverlapGraph& graph,
                                         double cutoff, const Array<std::uint32_t>& order,
                                         std::uint32_t groups,
                                         LeastOverlapReport* report = nullptr);

}  // namespace surfel
