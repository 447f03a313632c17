#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/timing.h>
#include <surfel/lod/surfel_partition.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/scene/usable_surfels.h>

namespace surfel {

struct HierarchyOptions {
  /// Surfels of a level for one of the next coarser level, 2..16: finer steps come closer to what a
  /// picture needs, and make a larger file (1 / (reduction - 1) more surfels).
  int reduction = 3;
  SheetRules sheets = {};

  /// Empty if usable, else one sentence per violated rule.
  SURFEL_API std::vector<std::string> problems() const;
};

/// What a hierarchy came to.
struct HierarchyReport {
  UnusableSurfels dropped;          ///< Left out of all levels.
  std::vector<std::size_t> levels;  ///< Surfels of each, finest first.
  std::vector<double> spacing;      ///< Of each: root of the mean square by area, scene units.
  std::size_t clusters = 0;
  StageTimes stages;  ///< sort, split, merge, assemble.
};

/// A cloud with levels of detail: its own surfels and, level by level, fewer that stand for the
/// same surface, with the tree of their clusters (SurfelCloud::tree).
///
/// The surfels are cut in two by their positions, across the longer side, until clusters of
/// kClusterSurfels are left (all but one are full). A cluster of the next level holds the surfels
/// of `reduction` neighbouring ones merged into that many times fewer (surfel_partition.h,
/// surfel_merge.h), and so on to a single cluster. All variances become anisotropic; the other
/// attributes of a merged surfel are those of one of its members. Does not depend on the number of
/// threads, nor on the order of the surfels. Throws Error(kInput) if the cloud has no variance, no
/// usable surfel, or more than fit. `name` starts its messages. Time: about 4 s for 4.8 million
/// surfels on 2 threads; memory besides the result: 16 bytes for each surfel and 92 for each merged
/// one.
SURFEL_API SurfelCloud build_hierarchy(const SurfelCloud& cloud, const HierarchyOptions& options,
                                       HierarchyReport* report = nullptr,
                                       const std::string& name = {});

}  // namespace surfel
