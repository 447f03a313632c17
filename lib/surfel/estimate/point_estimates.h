#pragma once

#include <cstdint>

#include <surfel/base/types.h>
#include <surfel/estimate/edge_lines.h>
#include <surfel/estimate/normals.h>
#include <surfel/estimate/splat_size.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Normals and sizes of points, in any order.
struct PointEstimates {
  NormalEstimate normals;
  Array<float> side_confidence;  ///< Empty if sides were not looked for.
  SplatSizes sizes;
  Array<EdgeLines> lines;  ///< Empty if edges were not looked for.
};

/// Makes surfels of points: the estimate of the point out[i] is the one at place[i]. Positions stay
/// as they are.
void set_estimates(const PointEstimates& estimates, const Array<std::uint32_t>& place,
                   SurfelCloud& out);

/// How many neighbours are kept for all stages, which go over the same neighbourhoods; large or
/// adaptive neighbourhoods of the normals are searched for on their own.
std::size_t shared_neighbors(const NormalOptions& normals);

/// From a point to its sensor, which is in world coordinates as the origin is.
inline Vec3f direction_to_sensor(const Vec3d& sensor, const Vec3d& origin, const Vec3f& position) {
  const Vec3d to = sensor - origin - position.cast<double>();
  return to.cast<float>();
}

/// Points with finite coordinates whose colour is not finite.
std::size_t unusable_colors(const SurfelCloud& cloud);

/// Sum of confidences, 0..1 each, in units of 2^-32: whole numbers, so that the order in which
/// points come does not matter.
std::uint64_t sum_of_confidences(const Array<float>& confidence);
/// The mean of `count` confidences of that sum.
inline double mean_confidence(std::uint64_t sum, std::size_t count) {
  return static_cast<double>(sum) / static_cast<double>(count) * 0x1p-32;
}

/// Can a normal tell the side of an estimated one?
inline bool usable_normal(const Vec3f& normal) { return normal.allFinite() && !normal.isZero(0); }

}  // namespace surfel
