#pragma once

#include <cstdint>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/function_ref.h>
#include <surfel/scene/cluster_tree.h>

namespace surfel {

/// What becomes of a cluster of a tree.
enum class CutStep : std::uint8_t {
  kSkip,    ///< It is not seen, nor is anything below it.
  kDraw,    ///< Its surfels are fine enough.
  kRefine,  ///< Its children are looked at; one without children is drawn.
};

/// A cut through the tree, from the root down: of every surfel of level 0, either itself, or one
/// cluster that stands for it, or a cluster that was skipped, is above it. Clusters in ascending
/// order. Cost: the clusters looked at.
SURFEL_API std::vector<std::uint32_t> cut_tree(const ClusterTree& tree,
                                               FunctionRef<CutStep(std::uint32_t cluster)> step);

/// Is a cluster's spacing at most `error` pixels at `z`, the least depth of its surfels?
/// `pixels_per_unit` is of a length at depth 1, or of any length where there is no perspective.
/// Never where it reaches the eye's plane.
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
/// filter, of `lowpass` pixels, that of a regular cloud, V = h^2 with h^2 the area. 0 as long as
/// the filter does it alone.
SURFEL_API float covering_variance(double error, double lowpass);

}  // namespace surfel
