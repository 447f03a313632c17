#pragma once

#include <cmath>

#include <surfel/base/elementary.h>
#include <surfel/base/types.h>

namespace surfel {

/// The rotation by an angle, in radians, about a unit axis. Eigen's own calls functions of the C
/// library that differ between processors.
inline Quaternion rotation_about(const Vec3d& axis, double angle) {
  const double sine = portable::sin(angle / 2);
  return {portable::cos(angle / 2), sine * axis.x(), sine * axis.y(), sine * axis.z()};
}

/// The angle of a rotation, in radians, 0 to pi.
inline double rotation_angle(const Quaternion& rotation) {
  return 2 * portable::atan2(rotation.vec().norm(), std::abs(rotation.w()));
}

}  // namespace surfel
