#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/cluster_bounds.h>

namespace surfel {

/// Most surfels of a cluster, which is the number that the renderer sets up at a time.
inline constexpr std::uint32_t kClusterSurfels = 256;

/// A node of a level-of-detail tree: consecutive surfels that stand for the surface of all its
/// children's surfels, with fewer of them.
struct TreeCluster {
  std::uint32_t begin = 0;  ///< Surfels of the cloud, kClusterSurfels at most.
  std::uint32_t end = 0;
  /// A cluster's children follow one another, and so do the children's surfels.
  std::uint32_t first_child = 0;
  std::uint32_t child_count = 0;  ///< 0: a cluster of the finest level.
  std::uint8_t level = 0;         ///< 0 = finest; children are one level below.
  /// Length that a surfel's piece of surface has on its longer side: root of the mean square by
  /// area, scene units.
  float spacing = 0;
  ClusterBounds bounds;  ///< Bounds of the surfels of this cluster and of all clusters below it.
  /// Box around the discs, to one standard deviation, of the surfels of the finest level below.
  Vec3f reach_min{0, 0, 0}, reach_max{0, 0, 0};
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

/// Clusters and surfels of a level of a tree: the first of them, and one past the last.
struct TreeLevel {
  std::size_t begin = 0, end = 0;
  std::size_t first_surfel = 0, end_surfel = 0;
};

/// The levels of a sound tree, coarsest first.
SURFEL_API std::vector<TreeLevel> levels_of(const ClusterTree& tree);

}  // namespace surfel
