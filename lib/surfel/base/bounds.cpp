#include <cmath>
#include <limits>

#include <fmt/format.h>
#include <surfel/base/bounds.h>
#include <surfel/base/error.h>

namespace surfel {
namespace {

/// A coordinate this many extents away from zero loses two bits or more of the extent's in float.
constexpr double kFar = 4;

/// The origin on one axis, given the range there and the extent of all axes: zero unless the range
/// lies far away. The origin is a multiple of a power of two of about the extent, so that
/// float coordinates minus it are exact: they are multiples of their spacing, which is finer than
/// the origin's, and the difference is smaller than they are.
double choose_origin(double min, double max, double extent) {
  const double center = min / 2 + max / 2;
  if (!(std::abs(center) > kFar * extent)) return 0;
  if (extent == 0) {  // All points are in one place: the offset holds what float cannot.
    if (std::abs(center) > static_cast<double>(std::numeric_limits<float>::max())) return center;
    const auto nearest = static_cast<double>(static_cast<float>(center));
    return nearest == center ? 0 : nearest;
  }
  int exponent = 0;
  const bool power_of_two = std::frexp(extent, &exponent) == 0.5;
  const double step = std::ldexp(1, power_of_two ? exponent - 1 : exponent);
  return std::round(center / step) * step;
}

}  // namespace

Vec3d float_origin(const Bounds& box) {
  const double extent = (box.max - box.min).cwiseMax(0).norm();
  Vec3d origin;
  for (int axis = 0; axis < 3; ++axis) {
    origin[axis] = choose_origin(box.min[axis], box.max[axis], extent);
  }
  return origin;
}

Vec3d central_origin(const Bounds& box) {
  const double extent = (box.max - box.min).maxCoeff();
  const Vec3d center = box.center();
  if (!center.allFinite()) return Vec3d::Zero();
  if (!(extent > 0)) return center;
  const double step = std::ldexp(1, std::ilogb(extent) - 4);
  return (center / step).array().round() * step;
}

void require_float_extent(const Bounds& box, const std::string& name) {
  // An axis without a finite coordinate has a negative extent.
  const double extent = (box.max - box.min).maxCoeff();
  if (extent <= 0 || (extent >= kLeastExtent && extent <= kLargestExtent)) return;
  throw_input(name,
              fmt::format("its points lie within a box of {:.2g} units, and single precision "
                          "holds {:g} to {:g}; scale it{}",
                          extent, kLeastExtent, kLargestExtent,
                          extent > kLargestExtent ? ", or remove points that lie far away" : ""));
}

}  // namespace surfel
