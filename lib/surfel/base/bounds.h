#pragma once

#include <limits>
#include <string>

#include <surfel/base/export.h>
#include <surfel/base/types.h>

namespace surfel {

/// Axis-aligned box; empty() until something was added.
struct Bounds {
  Vec3d min{Vec3d::Constant(std::numeric_limits<double>::infinity())};
  Vec3d max{Vec3d::Constant(-std::numeric_limits<double>::infinity())};
  bool empty() const { return !(min.x() <= max.x()); }
  void add(const Vec3d& p) {
    min = min.cwiseMin(p);
    max = max.cwiseMax(p);
  }
  bool contains(const Vec3d& p) const {
    return (p.array() >= min.array()).all() && (p.array() <= max.array()).all();
  }
  Vec3d center() const { return (min + max) / 2; }
  /// Length of the diagonal; 0 when empty.
  double diagonal() const { return empty() ? 0 : (max - min).norm(); }
};

/// Where to put the origin of a cloud that fills the box, so that float offsets from it are as
/// precise as can be: (0, 0, 0) unless the box lies far from it for its size. Where coordinates are
/// floats themselves the offsets are exact.
SURFEL_API Vec3d float_origin(const Bounds& box);
/// An origin in the middle of the box wherever that lies, so that float offsets from it are half as
/// long as the box at most: for coordinates that are multiples of a step and must stay so.
SURFEL_API Vec3d central_origin(const Bounds& box);

/// Lengths that single precision can work with, whose squares and areas are neither denormal nor
/// infinite, scene units.
inline constexpr double kLeastExtent = 1e-15;
inline constexpr double kLargestExtent = 1e18;

/// Throws Error(kInput), starting with `name`, if the box is smaller than kLeastExtent without
/// being a point, or larger than kLargestExtent.
SURFEL_API void require_float_extent(const Bounds& box, const std::string& name);

}  // namespace surfel
