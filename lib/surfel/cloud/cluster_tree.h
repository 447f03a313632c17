#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/cloud/value_range.h>

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

/// Bounds of surfels [begin, end): position(axis, i), normal(axis, i) (unit, or zero = unknown),
/// deviation(i). Columns of floats are read as vectors.
template <class Position, class Normal, class Deviation>
ClusterBounds cluster_bounds(std::size_t begin, std::size_t end, const Position& position,
                             const Normal& normal, const Deviation& deviation) {
  ClusterBounds bounds;
  for (int axis = 0; axis < 3; ++axis) {
    const auto [lo, hi] = value_range(begin, end, [&](std::size_t i) { return position(axis, i); });
    bounds.center[axis] = lo + (hi - lo) / 2;
  }
  bounds.max_deviation = std::max(0.0F, value_range(begin, end, deviation).max);
  const Vec3f center = bounds.center;
  const float squared = value_range(begin, end, [&](std::size_t i) {
                          const float x = position(0, i) - center.x();
                          const float y = position(1, i) - center.y();
                          const float z = position(2, i) - center.z();
                          return x * x + (y * y + z * z);
                        }).max;
  // Rounding must not shrink a bound.
  bounds.radius = std::sqrt(std::max(0.0F, squared)) * (1.0F + 1e-6F);

  Vec3f sum(0, 0, 0);
  bool all_oriented = true;
  for (std::size_t i = begin; i < end; ++i) {
    const Vec3f n(normal(0, i), normal(1, i), normal(2, i));
    sum += n;
    all_oriented = all_oriented && !n.isZero();
  }
  const float length = sum.norm();
  if (!all_oriented || !(length > 0)) return bounds;
  const Vec3f axis = sum / length;
  const float cosine = std::min(1.0F, value_range(begin, end, [&](std::size_t i) {
                                        return axis.x() * normal(0, i) +
                                               (axis.y() * normal(1, i) + axis.z() * normal(2, i));
                                      }).min);
  if (cosine > kWidestCone) {
    bounds.cone_axis = axis;
    bounds.cone_cosine = cosine - 1e-6F;
  }
  return bounds;
}

}  // namespace surfel
