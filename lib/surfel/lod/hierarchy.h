#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/timing.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/scene/usable_surfels.h>
#include <surfel/surface/sheet.h>

namespace surfel {

struct HierarchyOptions {
  /// Surfels of a level for one surfel of the next coarser level, 2..16: finer steps come closer to
  /// what a picture needs, and make a larger file (1 / (reduction - 1) more surfels).
  int reduction = 3;
  SheetRules sheets = {};

  SURFEL_API std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// The surfels that build_hierarchy() left out, and the levels that it made.
struct HierarchyReport {
  UnusableSurfels dropped;          ///< Surfels left out of all levels.
  std::vector<std::size_t> levels;  ///< Surfels of each level, finest first.
  std::vector<double> spacing;      ///< By level: root of the mean square by area, scene units.
  std::size_t clusters = 0;
  StageTimes stages;  ///< sort, split, merge, assemble.
};

/// A cloud with levels of detail: its own surfels and, level by level, fewer surfels that stand for
/// the surface, with the tree of their clusters (SurfelCloud::tree).
///
/// The surfels are cut in two by their positions, across the longer side, until clusters of
/// kClusterSurfels are left (all but one are full). A cluster of the next level holds the surfels
/// of `reduction` neighbouring clusters, merged into `reduction` times fewer (surfel_partition.h,
/// surfel_merge.h), and so on to a single cluster. All variances become anisotropic; attributes
/// that are not merged come from one of the members. Does not depend on the number of threads, nor
/// on the order of the surfels.
///
/// Throws Error(kUsage) for bad options, Error(kInput) if the cloud has no variance, no usable
/// surfel, or too many surfels for 32-bit indices; `name` starts the messages. Time: about 4 s for
/// 4.8 million surfels on 2 threads; memory besides the result: 16 bytes for each surfel and 92 for
/// each merged surfel.
SURFEL_API SurfelCloud build_hierarchy(const SurfelCloud& cloud, const HierarchyOptions& options,
                                       HierarchyReport* report = nullptr,
                                       const std::string& name = {});

}  // namespace surfel
