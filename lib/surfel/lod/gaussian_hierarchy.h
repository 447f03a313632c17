#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/timing.h>
#include <surfel/scene/gaussian_cloud.h>

namespace surfel {

/// Shape of the levels that build_gaussian_hierarchy() makes.
struct GaussianHierarchyOptions {
  /// Gaussians of a level for one Gaussian of the next coarser level, 2..16.
  int reduction = 3;

  SURFEL_API std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// The Gaussians that build_gaussian_hierarchy() left out, and the levels that it made.
struct GaussianHierarchyReport {
  std::size_t unseen = 0;           ///< Gaussians left out, which no trained renderer shows.
  std::vector<std::size_t> levels;  ///< Gaussians of each level, finest first.
  std::vector<double> spacing;      ///< Mean TreeCluster::spacing of each level, scene units.
  std::size_t clusters = 0;
  StageTimes stages;  ///< sort, merge, assemble.
};

/// A cloud with levels of detail: its own Gaussians and, level by level, fewer Gaussians that look
/// the same from afar, with the tree of their clusters (GaussianCloud::tree).
///
/// Clusters are cut as build_hierarchy() cuts clusters of surfels. A cluster of the next level
/// holds the Gaussians of `reduction` neighbouring clusters, merged into `reduction` times fewer
/// (gaussian_reduction.h), and so on to a single cluster; opacities and sizes of a level's
/// Gaussians are made of its sums (gaussian_merge.h). The spacing of a cluster is twice the largest
/// standard deviation of a Gaussian that was merged, in the mean; 0 in the finest level. Does not
/// depend on the number of threads.
///
/// Throws Error(kUsage) for bad options, Error(kInput), starting with `name`, where no Gaussian can
/// be seen, or where there are too many for 32-bit indices.
SURFEL_API GaussianCloud build_gaussian_hierarchy(const GaussianCloud& cloud,
                                                  const GaussianHierarchyOptions& options = {},
                                                  const std::string& name = {},
                                                  GaussianHierarchyReport* report = nullptr);

}  // namespace surfel
