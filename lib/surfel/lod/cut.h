#pragma once

#include <cstdint>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/function_ref.h>
#include <surfel/scene/cluster_tree.h>

namespace surfel {

/// The step of a cut at a cluster of a tree.
enum class CutStep : std::uint8_t {
  kSkip,    ///< The cluster is not seen, nor is anything below it.
  kDraw,    ///< The cluster's surfels are fine enough.
  kRefine,  ///< The children are looked at instead; a cluster without children is drawn.
};

/// The clusters to draw, in ascending order: a cut through the tree from the root down. Of the
/// clusters above a surfel of level 0, exactly one is drawn, or one was skipped. Cost: a call of
/// `step` for each cluster that is looked at.
SURFEL_API std::vector<std::uint32_t> cut_tree(const ClusterTree& tree,
                                               FunctionRef<CutStep(std::uint32_t cluster)> step);

/// Is a cluster's spacing at most `error` pixels at `z`, the least depth of its surfels? Not if the
/// cluster reaches the eye's plane. `pixels_per_unit` is how many pixels a scene unit has at depth
/// 1, or at any depth where there is no perspective.
inline bool fine_enough(const TreeCluster& cluster, float z, float pixels_per_unit,
                        bool orthographic, float error) {
  const float depth = orthographic ? 1.0F : z;
  return depth > 0 && cluster.spacing * pixels_per_unit <= error * depth;
}

/// Longer side of the pieces that merged surfels stand for, in units of the root of their area, as
/// measured on planes, spheres and terrain: 1.3 to 1.4.
inline constexpr double kLongerSide = 1.35;

/// Variance that a merged surfel's Gaussian must have at least, as a part of its area, for a level
/// whose pieces are up to `error` pixels long to cover without holes: together with the pixel
/// filter, of `lowpass` pixels, the variance of a regular cloud, V = h^2 with h^2 the area. 0 as
/// long as the filter alone is wide enough.
SURFEL_API float covering_variance(double error, double lowpass);

}  // namespace surfel
