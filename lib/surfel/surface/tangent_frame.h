#pragma once

#include <algorithm>
#include <cmath>

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
  const double half = (xx - yy) / 2;
  const double radius = std::sqrt(half * half + xy * xy);
  Vec2d along(1, 0);
  if (radius > 0) {
    // The angle is half the one of (half, xy). Of its cosine and sine the larger one is a root, and
    // the other one follows, without a difference of nearly equal numbers.
    const double larger = std::sqrt((radius + std::abs(half)) / (2 * radius));
    const double other = xy / (2 * radius * larger);
    along = half >= 0 ? Vec2d(larger, other) : Vec2d(std::abs(other), std::copysign(larger, xy));
  }
  return {along, mean + radius, std::max(0.0, mean - radius)};
}

}  // namespace surfel
