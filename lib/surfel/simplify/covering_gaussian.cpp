#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <vector>

#include <surfel/base/elementary.h>
#include <surfel/simplify/covering_gaussian.h>
#include <surfel/surface/tangent_frame.h>

namespace surfel {
namespace {

/// Axes of an ellipse.
struct Axes {
  Vec2d along{1, 0};  ///< Unit, along the long axis.
  double u = 1;       ///< Long half axis.
  double v = 1;       ///< Short half axis.
};

/// Axes of the second moments about `position` of places, each a square of its area.
Axes second_moments(const TangentFrame& frame, const Vec3f& position,
                    std::span<const CoveredPlace> places) {
  double total = 0;
  for (const CoveredPlace& place : places) total += place.area;
  double tt = 0;
  double tb = 0;
  double bb = 0;
  for (const CoveredPlace& place : places) {
    const Vec2d flat = frame.flat((place.position - position).cast<double>());
    const double x = flat.x();
    const double y = flat.y();
    const double weight = total > 0 ? place.area / total : 1.0 / static_cast<double>(places.size());
    tt += weight * (x * x + place.area / 12.0);
    bb += weight * (y * y + place.area / 12.0);
    tb += weight * x * y;
  }
  if (!(tt + bb > 0)) return {};
  const PrincipalAxes axes = principal_axes(tt, tb, bb);
  const double u = std::sqrt(axes.larger);
  return {axes.along, u, std::max(std::sqrt(axes.smaller), u / kMostElongated)};
}

}  // namespace

TangentGaussian covering_gaussian(const Vec3f& position, const Vec3f& normal,
                                  std::span<const CoveredPlace> places, bool ellipse,
                                  double cutoff) {
  const TangentFrame frame = tangent_frame(normal.cast<double>());
  const Axes axes = ellipse ? second_moments(frame, position, places) : Axes{};
  const Vec3d along = frame.lifted(axes.along);
  const Vec3d across = frame.n.cross(along);
  double scale2 = 0;
  for (const CoveredPlace& place : places) {
    const Vec3d d = (place.position - position).cast<double>();
    Vec2d flat(d.dot(along), d.dot(across));
    const double reach = kPlaceReach * std::sqrt(static_cast<double>(place.area));
    const double length = flat.norm();
    flat = length > 0 ? Vec2d(flat * (1 + reach / length)) : Vec2d(reach, 0);
    scale2 = std::max(scale2,
                      portable::squared(flat.x() / axes.u) + portable::squared(flat.y() / axes.v));
  }
  // The kernel ends at beta = u^2 / (2 V) = cutoff.
  const double by_half_axis2 = scale2 / (2 * cutoff);
  return {along.cast<float>(), static_cast<float>(by_half_axis2 * axes.u * axes.u),
          static_cast<float>(by_half_axis2 * axes.v * axes.v)};
}

}  // namespace surfel
