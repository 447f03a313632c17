#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>

namespace surfel {

/// Most surfels of a cluster: what the renderer sets up at a time.
inline constexpr std::uint32_t kClusterSurfels = 256;

/// Where surfels lie and which way they look, for culling.
struct ClusterBounds {
  Vec3f center{0, 0, 0};     ///< Of a sphere around the surfels' positions.
  float radius = 0;          ///< Of that sphere.
  float max_deviation = 0;   ///< Largest standard deviation of the surfels' Gaussians, scene units.
  Vec3f cone_axis{0, 0, 1};  ///< All normals lie within the cone around this axis ...
  float cone_cosine =
      -1;  ///< ... of this cosine; -1 if no cone narrower than a half-space holds them.
};

/// Cosine below which a cone of normals is of no use for culling.
inline constexpr float kWidestCone = 0.05F;

/// A node of a level-of-detail tree: consecutive surfels that stand for the same surface as those
/// of all its children do, with fewer of them.
struct TreeCluster {
  std::uint32_t begin = 0;  ///< Surfels of the cloud, kClusterSurfels at most.
  std::uint32_t end = 0;
  std::uint32_t first_child = 0;  ///< Children follow each other; their surfels do, too.
  std::uint32_t child_count = 0;  ///< 0: a cluster of the finest level.
  std::uint8_t level = 0;         ///< 0 = finest; children are one level below.
  /// Length that a surfel's piece of surface has on its longer side: root of the mean square by
  /// area, scene units.
  float spacing = 0;
  ClusterBounds bounds;  ///< Of this cluster's surfels and of all those below it.
};

/// Levels of detail: clusters in breadth-first order from the root, the surfels in the order of
/// their clusters; so all clusters and surfels of one level follow each other, the finest last.
using ClusterTree = std::vector<TreeCluster>;

/// What is wrong with a tree over `surfels` surfels, in a sentence; empty if nothing is. Of a sound
/// tree every cluster but the first is one other's child, every surfel is in one cluster, and
/// clusters without children are of level 0.
SURFEL_API std::string tree_problem(const ClusterTree& tree, std::size_t surfels);

/// First cluster of the finest level; 0 where the tree is empty.
SURFEL_API std::size_t first_leaf(const ClusterTree& tree);

/// Bounds of `count` surfels: position(i), normal(i) (unit, or zero = unknown), deviation(i).
template <class Position, class Normal, class Deviation>
ClusterBounds cluster_bounds(std::size_t count, Position position, Normal normal,
                             Deviation deviation) {
  ClusterBounds bounds;
  Vec3f lo = position(0);
  Vec3f hi = lo;
  Vec3f sum(0, 0, 0);
  bool all_oriented = true;
  for (std::size_t i = 0; i < count; ++i) {
    const Vec3f p = position(i);
    const Vec3f n = normal(i);
    lo = lo.cwiseMin(p);
    hi = hi.cwiseMax(p);
    sum += n;
    all_oriented = all_oriented && !n.isZero();
    bounds.max_deviation = std::max(bounds.max_deviation, deviation(i));
  }
  bounds.center = lo + (hi - lo) / 2;
  const float length = sum.norm();
  const Vec3f axis = length > 0 ? Vec3f(sum / length) : Vec3f(0, 0, 0);
  float cosine = all_oriented && length > 0 ? 1.0F : -1.0F;
  for (std::size_t i = 0; i < count; ++i) {
    bounds.radius = std::max(bounds.radius, (position(i) - bounds.center).norm());
    cosine = std::min(cosine, axis.dot(normal(i)));
  }
  bounds.radius *= 1.0F + 1e-6F;  // Rounding must not shrink a bound.
  if (cosine > kWidestCone) {
    bounds.cone_axis = axis;
    bounds.cone_cosine = cosine - 1e-6F;
  }
  return bounds;
}

}  // namespace surfel
