#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// What is taken for different sheets of a surface, which must not be merged.
struct SheetRules {
  /// Normals further than this from those merged with (their mean, or the seed of their cluster)
  /// are of another sheet, degrees, in (0, 90].
  double normal_angle = 40;
  /// How much more an offset along the normal counts than one along the surface, 1..1000: sheets
  /// that lie upon one another are told apart before one sheet is cut finer.
  double sheet_weight = 3;

  SURFEL_API std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// A surfel as merging takes it. The Gaussian is kept in space, not in a tangent plane, so that
/// merging in steps gives what merging at once does.
struct MergeSurfel {
  Vec3f position;
  Vec3f normal;                     ///< Unit, or zero = unknown.
  float area;                       ///< Scene unit^2, >= 0.
  std::array<float, 6> covariance;  ///< xx xy xz yy yz zz, scene unit^2.
  /// Square of the length that the piece of surface has on its longer side, scene unit^2.
  float extent2;
  Vec3f color;
  Vec3f coefficient;
  float alpha;
  std::uint16_t material;
  std::uint32_t source;  ///< A surfel of the cloud that other attributes are taken from.
};

/// Surfel i of a cloud that has variances. The area of a cloud without such a column is sqrt |V|,
/// as in rendering.
SURFEL_API MergeSurfel merge_surfel(const SurfelCloud& cloud, std::uint32_t i);

/// One surfel instead of surfels[members[0]], surfels[members[1]], ..., one at least. With the
/// areas as weights:
/// - position: the mean; covariance: that of the sum of the Gaussians, within and between them;
/// - normal: the mean, unit; where normals cancel each other, that of the largest member;
/// - area: |sum of area times normal|, the area that the pieces have together as seen along the
///   mean normal. Pieces of a plane keep their sum; a rough surface covers as much of a picture as
///   it did, where the plain sum would cover more. At least half the sum.
/// - alpha: the mean; colours: the mean weighted by area times alpha, in linear light;
/// - material: that of most area, ties to the smaller number; source: that of the member that is
///   nearest to the mean position, ties to the earlier.
/// Where all areas are zero, all weights are alike.
SURFEL_API MergeSurfel merged(std::span<const MergeSurfel> surfels,
                              std::span<const std::uint32_t> members);

/// Gives surfel i of a cloud the position, normal, area, colours, alpha and material of a merged
/// one, as far as the cloud has these columns.
SURFEL_API void write_attributes(SurfelCloud& cloud, std::size_t i, const MergeSurfel& merged);

/// A Gaussian in its tangent plane: V = diag(variance_u, variance_v) in the frame (t, n x t).
struct TangentGaussian {
  Vec3f tangent;
  float variance_u;  ///< The larger one.
  float variance_v;
};

/// The part of a Gaussian in space that lies in the plane across `normal`. For an unknown normal,
/// the isotropic Gaussian in the plane of a disc whose Gaussian in space this is, however it is
/// turned.
SURFEL_API TangentGaussian tangent_gaussian(const std::array<float, 6>& covariance,
                                            const Vec3f& normal);

}  // namespace surfel
