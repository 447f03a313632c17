#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/lod/merged_lines.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/surface/neighbor_search.h>
#include <surfel/surface/sheet.h>

namespace surfel {

/// Groups of surfels around seeds, which are surfels too. Every surfel is in one cluster.
struct SheetClusters {
  Array<std::uint32_t> seed;  ///< Seed of each cluster; ascending.
  /// First place of each cluster in `member`, then the places' number.
  Array<std::uint64_t> begin;
  Array<std::uint32_t> member;  ///< Surfels, cluster by cluster, ascending within each.

  std::size_t size() const { return seed.size(); }
  std::span<const std::uint32_t> members(std::size_t cluster) const {
    return {member.data() + begin[cluster], member.data() + begin[cluster + 1]};
  }
};

/// Chooses seeds such that every surfel is within a seed's radius on the seed's sheet, and no seed
/// is within another seed's radius: a Poisson-disk subset by dart throwing in random order. A
/// surfel is on a seed's sheet if both have the same material and normals within
/// rules.normal_angle; its distance from the seed is
///   d^2 = |along the seed's tangent plane|^2 + (rules.sheet_weight height above it)^2.
/// A surfel joins the seed with the least d / radius. A surfel without a normal stays alone.
///
/// \param cloud        Usable surfels with normals, in the order of a space-filling curve.
/// \param search       Searches the cloud's positions.
/// \param radius       Radius of every surfel if it becomes a seed, scene units, >= 0.
/// \param rules        When two surfels lie on one sheet.
/// \param random_seed  Chooses the random order.
/// \param fill_to      Number of seeds that is wanted: where there are fewer, surfels at smaller
///                     and smaller distances are made seeds as well, until there are as many, or no
///                     others.
/// \param edges        The surfels with their half-planes, past which no cluster extends
///                     (ClusterEdges); empty: none is cut.
///
/// The result depends on these parameters alone. Throws Error(kUsage) for bad rules. Sequential:
/// 0.5 s for a million surfels.
SURFEL_API SheetClusters cluster_sheets(const SurfelCloud& cloud, const NeighborSearch& search,
                                        const Array<float>& radius, const SheetRules& rules,
                                        std::uint64_t random_seed, std::size_t fill_to = 0,
                                        std::span<const LinedSurfel> edges = {});

}  // namespace surfel
