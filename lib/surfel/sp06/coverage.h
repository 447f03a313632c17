#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/timing.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/sp06/enlargement.h>

namespace surfel {

/// How the groups are made to cover the surface (SP06 section 4.2.2).
enum class CoverMethod : std::uint8_t {
  kNone,         ///< Not at all: it is measured how much they cover.
  kEnlarge,      ///< Method (2): one factor for all radii of a group.
  kEnlargeEach,  ///< One radius for every splat, so that it covers its cell: overlaps less than
                 ///< kEnlarge.
  kDuplicate,    ///< Method (1): splats of other groups are added.
};

/// How cover_groups() closes the holes of groups.
struct CoverageOptions {
  CoverMethod method = CoverMethod::kEnlargeEach;
  double cutoff = 1;  ///< c of beta < c: a disc's radius is sqrt(2 c max variance), > 0.
  /// Share of the surface's area A that a group shall cover with kEnlarge, in (0, 1]; SP06 (8): 1.
  double target = 1;
  /// kEnlargeEach: a splat's radius grows by no more than this many times the median of its group,
  /// >= 1. At creases and edges cells have spikes, which would make discs that stick out of the
  /// surface: on the Stanford dragon with four groups 15 to 21 times their own radius, where half
  /// of the splats do not grow at all.
  double most_growth = 2.5;
  /// kDuplicate adds a splat if it newly covers more than this share of its disc, in (0, 1).
  /// Smaller: fewer holes, more points.
  double least_gain = 0.02;
  /// Iterations of the paper's fixed point (9), run beside kEnlarge for comparison; 0: it is not.
  int fixed_point_iterations = 0;
  SURFEL_API std::vector<std::string> problems() const;
};

/// The part of the surface that a group covers. Areas are in scene units squared, measured in the
/// tangent planes of the group's splats.
struct GroupCoverage {
  std::size_t splats = 0;  ///< The group's, with the added splats.
  std::size_t added = 0;   ///< Splats that kDuplicate added.
  /// Splats at the place and on the sheet of a larger one, which need not cover anything.
  std::size_t hidden = 0;
  /// Cells that end at the surface's border, so that the splat grows no further (see GroupCells).
  std::size_t capped = 0;
  /// kEnlargeEach: splats that grow as much as is allowed, and would have to grow more.
  std::size_t limited = 0;
  /// Area of the restricted Voronoi cells: the surface as the group sees it.
  double cell_area = 0;
  double covered_area = 0;    ///< The cells' area that their own discs cover.
  double uncovered_area = 0;  ///< cell_area - covered_area.
  /// Area of all discs less covered_area, `Clipped` of SP06 (7): the parts beyond the discs' own
  /// cells, over one another or over the border.
  double overlap_area = 0;
  /// A - cell_area where that is positive: surface that is in no cell of the group, as it is on
  /// sheets where the group has no splat, or is curved within a cell. No radius covers it. With
  /// kEnlarge: the part of the area asked for that the factor does not cover.
  double unreachable_area = 0;
  /// Share of the surface that none of the group's discs on its side reaches, counted at 65,536
  /// places at most, about the cloud's splats (missed_samples.h).
  double missed_share = 0;
  double growth_mean = 1;  ///< Mean ratio of new to old radius.
  double growth_max = 1;
  std::optional<Enlargement> enlargement;  ///< kEnlarge: how (8) was solved.
  std::optional<Enlargement>
      fixed_point;  ///< The solution of the paper's (9) for this area, if asked for.
};

/// What the groups cover of the surface, by group and in all.
struct CoverageReport {
  double area = 0;                ///< A, unit^2.
  bool area_from_column = false;  ///< Sum of `area`; otherwise (7) over all splats: their union.
  std::vector<GroupCoverage> groups;
  std::size_t points_before = 0;
  std::size_t points_added = 0;
  std::size_t capped = 0;
  std::size_t limited = 0;
  std::size_t hidden = 0;
  /// Splats without a finite position, a normal or a variance above zero: they have no disc.
  std::size_t without_disc = 0;
  std::size_t border_splats = 0;  ///< Splats at which the whole cloud's surface ends.
  double covered_area = 0;        ///< Mean over the groups, as in the next four members.
  double uncovered_area = 0;
  double unreachable_area = 0;
  double overlap_area = 0;
  double missed_share = 0;
  double growth_mean = 1;  ///< Mean ratio of new to old radius over the splats of all groups.
  double growth_max = 1;
  StageTimes times;
};

/// Measures how much of the surface the groups of a cloud (column `group`) cover, and makes them
/// cover it. Discs are circles of the larger variance.
///
/// kEnlarge and kEnlargeEach write `group_radius`, never smaller than a splat's own radius (splats
/// that are hidden or have no disc keep their own radius; 0 where there is none). kNone and
/// kDuplicate leave splats their own radius and drop that column. kDuplicate appends copies with
/// the group that they are added to, in the order of groups, and gives all splats `source`: the
/// index of the original before, or its own `source` if there was that column.
///
/// The surface is the union of the cloud's discs (DiscSurface), whole ones, whatever half-planes
/// leave of them: groups are asked to cover rather too much. Copies keep their half-planes. Discs
/// whose centres are cut off, which continue others beyond the surface, keep their own radius and
/// count for nothing.
/// Where a border is in a splat's cell, the cell ends there and so does the splat's growth;
/// most_growth limits it on top of that, and the area that it leaves open is in uncovered_area.
/// Coverage that no radius of the group can give is reported as unreachable_area. kEnlarge solves
/// (8) for the share `target` of A. The cells, which lie in tangent planes, may hold less than
/// that, and (8) then has no solution: the factor is the one that covers 0.999 of the cells, whose
/// last spikes would inflate all radii.
///
/// O(n log n) in practice; a group of a few splats takes a pass over the surface for each of them.
/// Memory some 100 bytes a splat, and 150 a splat of the largest group.
/// The same for any number of threads. Throws Error(kUsage) for bad options, Error(kInput) if
/// group, normals or variances are missing, with a message that starts with `name`, the cloud's.
SURFEL_API CoverageReport cover_groups(SurfelCloud& cloud, const CoverageOptions& options = {},
                                       const std::string& name = "surfels");

}  // namespace surfel
