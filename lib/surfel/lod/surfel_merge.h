#pragma once

#include <array>
#include <cstdint>
#include <span>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/lod/merged_lines.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// A surfel on the way to be merged. Its Gaussian is kept in space, not in a tangent plane, so that
/// merging in steps gives the Gaussian that merging at once does.
struct MergeSurfel : LinedSurfel {
  Vec3f normal;                     ///< Unit, or zero = unknown.
  Vec3f shading_normal;             ///< SurfelCloud::shading_normal, or `normal` without one.
  std::array<float, 6> covariance;  ///< xx xy xz yy yz zz, scene unit^2.
  /// Square of the length that the surfel's piece of surface has on its longer side, scene unit^2.
  float extent2;
  Vec3f color;
  Vec3f coefficient;
  float alpha;
  std::uint16_t material;
  std::uint32_t source;  ///< The surfel of the cloud from which all other attributes are taken.
};

/// Surfel i of a cloud that has variances. Where the cloud has no areas the area is sqrt |V|, as in
/// rendering.
SURFEL_API MergeSurfel merge_surfel(const SurfelCloud& cloud, std::uint32_t i);

/// One surfel instead of surfels[members[0]], surfels[members[1]], ..., one at least. With the
/// areas as weights (all weights alike where all areas are zero):
/// - position: the mean; covariance: of the sum of the Gaussians, within and between them;
/// - normal: the mean, unit; where normals cancel each other, the largest member's normal;
/// - shading normal: the mean, whose length heeds how much the members' normals vary, or zero
///   where it has no direction;
/// - area: |sum of area times normal|, the area that the pieces have together as seen along the
///   mean normal. Pieces of a plane keep the sum of their areas; a rough surface covers as much of
///   a picture as before, where the plain sum would cover more. At least half the sum.
/// - alpha: the mean; colours: the mean weighted by area times alpha, in linear light;
/// - members whose centres half-planes cut off take no part where other members are whole, as they
///   continue the whole ones up to a line. Where no member is whole and no line would cut off the
///   mean position, the member with the largest area (the first of several) remains, unmerged;
/// - half-planes: merged_lines();
/// - material: the one of most area, ties to the smaller number; source: of the member that is
///   nearest to the mean position, ties to the earlier member.
SURFEL_API MergeSurfel merged(std::span<const MergeSurfel> surfels,
                              std::span<const std::uint32_t> members);

/// The half-planes of surfel i of a cloud, as lines.
SURFEL_API LinedSurfel lined_surfel(const SurfelCloud& cloud, std::uint32_t i);

/// Gives surfel i of a cloud half-planes, as far as the cloud has these columns.
SURFEL_API void write_lines(SurfelCloud& cloud, std::size_t i, const std::array<CutLine, 2>& lines);

/// Gives surfel i of a cloud the position, normals, area, colours, alpha, material and half-planes
/// of a merged surfel, as far as the cloud has these columns.
SURFEL_API void write_attributes(SurfelCloud& cloud, std::size_t i, const MergeSurfel& merged);

/// A Gaussian in its tangent plane: V = diag(variance_u, variance_v) in the frame (t, n x t).
struct TangentGaussian {
  Vec3f tangent;
  float variance_u;  ///< Variance along the tangent: the larger one.
  float variance_v;  ///< Variance across the tangent.
};

/// The part of a Gaussian in space that lies in the plane across `normal`. An unknown (zero) normal
/// gives the isotropic Gaussian of the disc that has this Gaussian in space, however it is turned.
SURFEL_API TangentGaussian tangent_gaussian(const std::array<float, 6>& covariance,
                                            const Vec3f& normal);

}  // namespace surfel
