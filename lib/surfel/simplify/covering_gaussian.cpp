#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <vector>

#include <surfel/simplify/covering_gaussian.h>

namespace surfel {
namespace {

/// Ellipses are no longer than this, so that places on a line do not make a needle.
constexpr double kMostElongated = 16;

/// An ellipse's axes: a unit vector along the long one, and both half axes.
struct Axes {
  Vec2d along{1, 0};
  double u = 1;
  double v = 1;
};

/// Of places (offset, area), each a square of its area.
Axes second_moments(const Vec3d& t, const Vec3d& b, const Vec3f& position,
                    std::span<const CoveredPlace> places) {
  double total = 0;
  for (const CoveredPlace& place : places) total += place.area;
  double tt = 0;
  double tb = 0;
  double bb = 0;
  for (const CoveredPlace& place : places) {
    const Vec3d d = (place.position - position).cast<double>();
    const double x = d.dot(t);
    const double y = d.dot(b);
    const double weight = total > 0 ? place.area / total : 1.0 / static_cast<double>(places.size());
    tt += weight * (x * x + place.area / 12.0);
    bb += weight * (y * y + place.area / 12.0);
    tb += weight * x * y;
  }
  const double mean = (tt + bb) / 2;
  const double difference = std::hypot((tt - bb) / 2, tb);
  if (!(mean > 0)) return {};
  const double angle = std::atan2(2 * tb, tt - bb) / 2;
  Axes axes{{std::cos(angle), std::sin(angle)}, std::sqrt(mean + difference), 0};
  axes.v = std::max(std::sqrt(std::max(0.0, mean - difference)), axes.u / kMostElongated);
  return axes;
}

}  // namespace

TangentGaussian covering_gaussian(const Vec3f& position, const Vec3f& normal,
                                  std::span<const CoveredPlace> places, bool ellipse,
                                  double cutoff) {
  const Vec3d n = normal.cast<double>();
  const Vec3d t = n.unitOrthogonal();
  const Vec3d b = n.cross(t);
  const Axes axes = ellipse ? second_moments(t, b, position, places) : Axes{};
  const Vec3d along = axes.along.x() * t + axes.along.y() * b;
  const Vec3d across = n.cross(along);
  double scale2 = 0;
  for (const CoveredPlace& place : places) {
    const Vec3d d = (place.position - position).cast<double>();
    Vec2d flat(d.dot(along), d.dot(across));
    const double reach = kPlaceReach * std::sqrt(static_cast<double>(place.area));
    const double length = flat.norm();
    flat = length > 0 ? Vec2d(flat * (1 + reach / length)) : Vec2d(reach, 0);
    scale2 = std::max(scale2, std::pow(flat.x() / axes.u, 2) + std::pow(flat.y() / axes.v, 2));
  }
  // The kernel ends at beta = u^2 / (2 V) = cutoff.
  const double by_half_axis2 = scale2 / (2 * cutoff);
  return {along.cast<float>(), static_cast<float>(by_half_axis2 * axes.u * axes.u),
          static_cast<float>(by_half_axis2 * axes.v * axes.v)};
}

}  // namespace surfel
