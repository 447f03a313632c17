#pragma once

// Surfels of one smooth surface, found among a cluster's, so that their splats can be summed up
// before they meet the A-buffer (sheet.h).

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/render/splat.h>
#include <surfel/render/splat_setup.h>

namespace surfel {

/// Surfels of a cluster, as bits: bit i is the i-th one.
using SurfelBits = std::array<std::uint64_t, kSetupSurfels / 64>;
inline bool has_surfel(const SurfelBits& bits, std::uint32_t surfel) {
  return (bits[surfel / 64] >> surfel % 64 & 1) != 0;
}

/// Surfels of a cluster that lie on one smooth surface, and bounds of them. All of it depends on
/// the surfels alone: pictures from any side, and all parts of a picture, have the same sheets.
struct SurfaceSheet {
  SurfelBits surfels{};
  int count = 0;
  float center[3];      ///< Of a sphere around the surfels' centres ...
  float radius;         ///< ... its radius.
  float axis[3];        ///< All normals lie within a cone around this unit vector ...
  float cone_cosine;    ///< ... of this cosine, above 0.
  float max_deviation;  ///< Largest standard deviation of the surfels' Gaussians.
  /// How far tangent planes within the discs are off the smooth surface, at most, along the axis,
  /// by the discs' radii at cutoff 1.
  float off;
};

/// Most sheets that a cluster has.
inline constexpr std::size_t kMostSheets = 8;

/// The sheets of a cluster: SIMD, chosen at run time. Surfels that half-planes cut, or whose
/// normals are zero, are in none. A sheet has one material.
/// \param surfels   `count` of them, kSetupSurfels at most; columns as set_up_splats() takes them.
/// \param material  their materials; null: all have one.
SURFEL_API std::vector<SurfaceSheet> find_sheets(const SurfelColumns& surfels,
                                                 const std::uint16_t* material, int count);

/// Whether a picture may sum up the splats of a sheet. They are small and close together, which is
/// worth it; and where the sheet is not seen at a grazing angle their depths are within half of
/// epsilon of one surface, so that contributions to a pixel differ by less than epsilon. At a
/// grazing angle a surface is deeper within a pixel than that anyway. Nothing of it depends on
/// where the picture's pixels lie.
/// \param epsilon  FragmentRules::depth_epsilon of the sheet's splats.
bool may_sum_up(const SurfaceSheet& sheet, const SplatView& view, float epsilon);

}  // namespace surfel
