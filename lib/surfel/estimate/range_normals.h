#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/function_ref.h>
#include <surfel/base/types.h>
#include <surfel/estimate/normals.h>
#include <surfel/estimate/place_sample.h>

namespace surfel {

/// Places whose nearest directions tell whether points are pixels.
inline constexpr std::size_t kPixelSample = 1024;

/// Direction in which a sensor sees a point, unit.
inline Vec3f direction_from(const Vec3d& sensor, const Vec3f& point) {
  return (point.cast<double>() - sensor).normalized().cast<float>();
}

/// Finds the squared distances, ascending, of the `k` directions nearest to one among the
/// directions of all points of a cloud.
using NearestDirections =
    FunctionRef<void(const Vec3f& direction, std::size_t k, std::vector<float>& distance2)>;

/// Do the directions to points spread as evenly as pixels do, see remake_range_normals()?
/// \param points  how many points the cloud has; none is where the sensor is.
/// \param sample  PlaceSample of kPixelSample of its places.
SURFEL_API bool seen_as_pixels(std::size_t points, std::span<const Vec3f> sample,
                               const Vec3d& sensor, NearestDirections nearest);

/// Makes the normals of a range image anew, whose noise and quantisation are along the lines of
/// sight. False, and nothing is done, if `points` are no range image of a sensor at `sensor`: if
/// their directions from there are not spread as evenly as pixels are. (A twentieth of the pixels
/// has its nearest neighbour nearer than 0.85 to 0.95 of the median distance; of points of a
/// surface seen from anywhere else, than 0.1 to 0.3 of it; and its four nearest are about as far.)
/// Nor are they one if the noise comes out larger than half the range.
///
/// With image coordinates u, w in a plane across the line of sight at depth 1, a plane n x = d of
/// space is a linear function of them in inverse depth, 1 / z = a + b u + c w, with n parallel to
/// (b, c, a); stereo and structured light measure disparities, multiples of 1 / z, so that the
/// noise of 1 / z changes slowly, and not at all across a window. The line through it is what least
/// squares find without bias, where a plane fitted to all three coordinates turns towards the
/// sensor's rays as soon as the noise is as large as the window. Along the way:
///
/// - The relative noise of the range, C r^p with p in 0 to 2, is told from residuals of windows of
///   64 points all over the image: medians of 16 groups by range, and the median slope between
///   them [Theil, Sen], so that silhouettes and clutter do not count.
/// - The window has the number of points, 16 to 512, for which the normal of a surface seen from
///   the front has a standard error of 0.05. Up to 16 pixels nearer to one another than 0.2 of its
///   radius share it.
/// - Four fits with Tukey's weights (1 - e^2)^2, e < 1 the residual by 20, 10, 5 and 5 standard
///   deviations of the noise, the first about the point itself, keep edges and jumps of depth. (At
///   first what a surface at 76 degrees to the sensor may recede is no residual.)
/// - A camera sees no surface edge-on: the slope's prior is normal with the standard deviation 2,
///   so that what has no neighbours on its surface, as pixels between front and back, faces the
///   sensor.
///
/// Sets normals and quality of `out`, which are estimates of `points`. The result does not depend
/// on the number of threads.
SURFEL_API bool remake_range_normals(const Array<Vec3f>& points, const Vec3d& sensor,
                                     NormalEstimate& out);

}  // namespace surfel
