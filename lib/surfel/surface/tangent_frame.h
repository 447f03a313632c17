#pragma once

#include <algorithm>
#include <cmath>

#include <surfel/base/elementary.h>
#include <surfel/base/types.h>

namespace surfel {

/// Orthonormal, right-handed frame of a surface at a point.
struct TangentFrame {
  Vec3d a, b;  ///< Span the tangent plane.
  Vec3d n;     ///< Normal of the surface, a x b.

  /// Coordinates in the tangent plane of an offset from the point, and its height above the plane.
  Vec2d flat(const Vec3d& offset) const { return {offset.dot(a), offset.dot(b)}; }
  double height(const Vec3d& offset) const { return offset.dot(n); }
  /// The vector in space that has these coordinates in the tangent plane.
  Vec3d lifted(const Vec2d& flat) const { return flat.x() * a + flat.y() * b; }
};

/// A frame for a unit normal, turned about it in any way.
inline TangentFrame tangent_frame(const Vec3d& normal) {
  const Vec3d a = normal.unitOrthogonal();
  return {a, normal.cross(a), normal};
}

/// Ellipses are no longer than this many times their width, so that places on a line do not make a
/// needle.
inline constexpr double kMostElongated = 16;

/// Principal axes of a symmetric 2x2 matrix.
struct PrincipalAxes {
  Vec2d along;             ///< Unit eigenvector of the larger eigenvalue.
  double larger, smaller;  ///< Eigenvalues; the smaller one not below 0, whatever rounding makes.
};

inline PrincipalAxes principal_axes(double xx, double xy, double yy) {
  const double mean = (xx + yy) / 2;
  const double radius = portable::hypot((xx - yy) / 2, xy);
  const double angle = portable::atan2(2 * xy, xx - yy) / 2;
  return {
      {portable::cos(angle), portable::sin(angle)}, mean + radius, std::max(0.0, mean - radius)};
}

}  // namespace surfel
