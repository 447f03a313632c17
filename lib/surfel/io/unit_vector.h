#pragma once

#include <cmath>

#include <surfel/base/types.h>

namespace surfel {

/// Unit vector, or zero where the vector has no direction. Internal to the library.
inline Vec3f unit_or_zero(const Vec3f& v) {
  const Vec3d wide = v.cast<double>();  // Neither overflows nor vanishes when squared.
  const double length = wide.norm();
  if (!(length > 0 && std::isfinite(length))) return Vec3f::Zero();
  return (wide / length).cast<float>();
}

/// Squared lengths that differ from 1 by no more are those of unit vectors in float: three squares
/// and two sums round by 2^-24 each, and so do the coordinates.
inline constexpr float kUnitTolerance = 1e-6F;

}  // namespace surfel
