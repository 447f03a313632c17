#pragma once

// Surfels in few bytes, as pages of surfel-view hold them.

#include <cstddef>
#include <cstdint>
#include <string>

#include <surfel/base/export.h>
#include <surfel/store/render_cloud.h>

namespace surfel {

/// A packed cluster: this header, then the columns that `columns` names, in the order of
/// PackedColumn, each with `count` values. Little-endian, without gaps. A column that is missing
/// has the header's value, or what PackedColumn says.
///
/// The largest errors, `box` being the cluster's bounding box and `ratio` the one of the largest to
/// the least value in the cluster:
///   position   side of the box / 131070 along each axis
///   normals    0.004 degrees
///   tangent    0.006 degrees
///   deviation, area   the factor ratio^(1 / 131070)
///   colour     half a code of 8-bit sRGB, of the range 0..1, or of color_low .. color_low +
///              color_scale where colours lie outside of that
///   alpha      1 / 510
///   attribute  1 / 510 of its range
///   half-planes   0.003 degrees, and 0.00013 of the surfel's larger deviation
struct PackedCluster {
  std::uint16_t count;                  ///< Surfels, 1..kClusterSurfels.
  std::uint16_t columns;                ///< Bits of PackedColumn.
  std::uint32_t cluster;                ///< Index among the cloud's clusters.
  float min[3];                         ///< Relative to the cloud's origin.
  float step[3];                        ///< x = min + step times the 16-bit value.
  float deviation_log, deviation_step;  ///< log2 of a standard deviation = log + step times value.
  float area_log, area_step;            ///< The same for the area.
  float color_low, color_scale;         ///< Linear colour = low + scale times the decoded sRGB.
  std::uint8_t color[3];                ///< sRGB codes, where there is no column.
  std::uint8_t attribute;
  std::uint32_t reserved;  ///< 0.
};
static_assert(sizeof(PackedCluster) == 64);

/// Columns of a packed cluster by their bits.
enum PackedColumn : std::uint16_t {
  kPackedPosition = 1,   ///< 3 x 16 bits, all x first, then y, then z. Always there.
  kPackedNormal = 2,     ///< 2 x 16 bits, octahedral; both 65535: unknown. Missing: unknown.
  kPackedDeviation = 4,  ///< 16 bits: along the tangent, or in all directions.
  kPackedAcross = 8,     ///< 2 x 16 bits: the deviation across the tangent, and the angle of the
                         ///< tangent from packed_tangent(), of half a turn. Missing: round surfels.
  kPackedArea = 16,      ///< 16 bits.
  kPackedColor = 32,     ///< 3 x 8 bits, sRGB codes, surfel by surfel.
  kPackedAlpha = 64,     ///< 8 bits. Missing: opaque.
  kPackedShading = 128,  ///< 2 x 16 bits: the normal to shade with, as kPackedNormal has it.
                         ///< Missing: the surfel's own.
  kPackedAttribute = 256,  ///< 8 bits, 0..1.
  /// 2 x 16 bits: the angle of the direction of RenderCloud::clip from packed_tangent(), of a turn,
  /// and the distance, 0..65534 being kPackedClipReach of the larger deviation on both sides of the
  /// centre; 65535: nothing is cut. Missing: no surfel is cut.
  kPackedClip1 = 512,
  kPackedClip2 = 1024,  ///< The same of the second half-plane.
};

/// Appends a cluster, whose rows the cloud holds. The surfels are in an order in which the first
/// ones of any number are spread over the cluster as evenly as all are.
/// \param cloud      Surfels with a tree of clusters.
/// \param cluster    Number among the cloud's clusters.
/// \param attribute  A cloud of the same surfels whose red is the attribute, 0..1; null: none.
/// \param to         Gets the bytes: a PackedCluster, then its columns.
SURFEL_API void pack_cluster(const RenderCloud& cloud, std::uint32_t cluster,
                             const RenderCloud* attribute, std::string& to);

/// Half-planes that are farther from the centre cut nothing that is seen, and are left out.
inline constexpr float kPackedClipReach = 8;

/// Most bytes that a surfel takes in a packed cluster.
inline constexpr std::size_t kMostPackedSurfel = 35;

/// Octahedral code of a unit vector; both 65535 for the zero vector.
struct PackedDirection {
  std::uint16_t u, v;
};
SURFEL_API PackedDirection pack_direction(const Vec3f& direction);
/// Unit, or zero.
SURFEL_API Vec3f unpack_direction(PackedDirection code);

/// Unit tangent perpendicular to a unit vector (Duff et al. 2017), from which tangents' angles
/// count.
SURFEL_API Vec3f packed_tangent(const Vec3f& normal);

}  // namespace surfel
