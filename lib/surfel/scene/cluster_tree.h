#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
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

/// What is wrong with clusters [first, first + run.size()) of a tree of `clusters` clusters over
/// `surfels` surfels, which are of one level and of which nothing else is known; as tree_problem().
SURFEL_API std::string run_problem(std::span<const TreeCluster> run, std::size_t first,
                                   std::uint8_t level, std::size_t clusters, std::size_t surfels);

/// First cluster of the finest level; 0 where the tree is empty.
SURFEL_API std::size_t first_leaf(const ClusterTree& tree);

/// Clusters and surfels of a level of a tree: the first of them, and one past the last.
struct TreeLevel {
  std::size_t begin = 0, end = 0;
  std::size_t first_surfel = 0, end_surfel = 0;
};

/// The levels of a sound tree, coarsest first.
SURFEL_API std::vector<TreeLevel> levels_of(const ClusterTree& tree);

/// The part of a tree that one of several processes holds: subtrees whose roots are of one level,
/// and all that is above them. Every cluster of the tree is held by one process that draws it, and
/// coarse ones by others as well, which refine them.
struct TreePart {
  /// The clusters that this process holds, as a tree; it has the root at least. `begin` and `end`
  /// are surfels of the whole cloud.
  ClusterTree tree;
  std::vector<std::uint32_t> number;  ///< Of each cluster held, in the whole tree.
  std::vector<bool> drawn;            ///< The clusters held that this process draws.
  std::vector<TreeLevel> levels;      ///< Of the whole tree, coarsest first.
};

/// Chooses the level of the roots of the subtrees that are dealt to processes: the coarsest with
/// kSubtreesEach for each, else the finest.
/// \param clusters   Number of clusters of each level, coarsest first.
/// \param processes  Number of processes, >= 1.
/// \return The level's place in `clusters`.
SURFEL_API std::size_t dealt_level(std::span<const std::size_t> clusters, int processes);
inline constexpr std::size_t kSubtreesEach = 256;

/// The process that the i-th of the subtrees is dealt to. Neighbours along the curve go to
/// different processes, so that what any camera sees is spread over all.
constexpr int dealt_to(std::size_t subtree, int processes) {
  return static_cast<int>(subtree % static_cast<std::size_t>(processes));
}

}  // namespace surfel
