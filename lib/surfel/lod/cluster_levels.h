#pragma once

// The clusters of levels of detail, whatever they hold: surfels or Gaussians in space.

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <surfel/base/types.h>
#include <surfel/scene/cluster_tree.h>

namespace surfel {

/// Orders points so that each run of kClusterSurfels is compact, each sequence of `reduction` such
/// runs is, each sequence of `reduction` such sequences, and so on: they are cut at a multiple of
/// the largest of these sizes, across the longest side of the box. Within a run they keep their
/// order.
/// \param order  points to be ordered, all of them finite, along a curve that does not depend on
///               how they are numbered.
Array<std::uint32_t> cluster_order(const Array<Vec3f>& position, const Array<std::uint32_t>& order,
                                   int reduction);

/// Clusters of the finest level of so many members; bounds are to be filled in.
std::vector<TreeCluster> finest_clusters(std::size_t count);

/// Clusters of the level above: each of `reduction` neighbours, with `reduction` times fewer
/// members. Members and children are counted from their level's first; bounds are to be filled in.
std::vector<TreeCluster> coarser_clusters(const std::vector<TreeCluster>& finer, int reduction);

/// The members of the finest level, of all in their order, that are below a cluster of a level.
std::span<const std::uint32_t> finest_below(const Array<std::uint32_t>& finest, std::size_t level,
                                            std::size_t cluster, int reduction);

/// Sphere around members of the finest level; merged ones lie between them.
void bound_sphere(ClusterBounds& bounds, const Array<Vec3f>& position,
                  std::span<const std::uint32_t> members);

/// The tree of all levels, finest first.
ClusterTree joined_levels(std::span<const std::span<const TreeCluster>> levels);

}  // namespace surfel
