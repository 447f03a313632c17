#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/lod/surfel_merge.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/surface/neighbor_search.h>

namespace surfel {

/// Surfels in groups around seeds, which are some of them. Every surfel is in one.
struct SheetClusters {
  Array<std::uint32_t> seed;    ///< By cluster: its seed; ascending.
  Array<std::uint64_t> begin;   ///< By cluster: its first place in `member`; then their number.
  Array<std::uint32_t> member;  ///< Surfels, cluster by cluster, ascending in each.

  std::size_t size() const { return seed.size(); }
  std::span<const std::uint32_t> members(std::size_t cluster) const {
    return {member.data() + begin[cluster], member.data() + begin[cluster + 1]};
  }
};

/// Seeds such that every surfel is within a seed's radius of it, on its sheet, and none within
/// another's: a Poisson-disk subset by dart throwing in random order. On one sheet are surfels of
/// one material, whose normals are within rules.normal_angle of each other, distances being
///   d^2 = |along the seed's tangent plane|^2 + (sheet_weight height above it)^2.
/// A surfel joins the seed with the least d / radius. A surfel without a normal stays alone.
///
/// \param cloud   usable surfels with normals, in the order of a space-filling curve.
/// \param search  over its positions.
/// \param radius  of every surfel if it becomes a seed, scene units, >= 0.
/// \param fill_to  if there are fewer seeds than that, surfels at smaller and smaller distances are
///                made seeds as well, until there are that many, or no others.
/// Depends on nothing but these and `random_seed`. Sequential: 0.5 s for a million surfels.
SURFEL_API SheetClusters cluster_sheets(const SurfelCloud& cloud, const NeighborSearch& search,
                                        const Array<float>& radius, const SheetRules& rules,
                                        std::uint64_t random_seed, std::size_t fill_to = 0);

}  // namespace surfel
