#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>
#include <numbers>
#include <vector>

#include <surfel/base/types.h>
#include <surfel/scene/surface_sample.h>

namespace surfel {

/// Part of the points at either end of an axis that may be strays.
inline constexpr double kStrays = 0.002;
/// Height of what counts as the lowest or outermost part, as a share of the scene's.
inline constexpr double kSlab = 0.03;
/// Mean normal of a surface of which one side is seen.
inline constexpr double kOneSided = 0.4;
/// Share of the surface that finds itself in the mirror where the scene is symmetric: others reach
/// half by chance.
inline constexpr double kSymmetric = 0.6;
/// Extent across, by the smaller one along, of what lies rather than stands.
inline constexpr double kThin = 0.4;

inline double radians(double degrees) { return degrees * std::numbers::pi / 180; }

/// The axis within so many degrees of a unit vector, or the vector itself.
Vec3d snapped(const Vec3d& direction, double degrees);

/// Range of values.
struct Range {
  double min = 0;
  double max = 0;
  double size() const { return max - min; }
  bool holds(double v) const { return v >= min && v <= max; }
};

/// Range of values without the share `strays` of them at either end.
Range range_of(std::vector<double> values, double strays = kStrays);

/// Axes of coordinates in which a scene is judged, and its ranges along them.
struct ReferenceFrame {
  std::array<Vec3d, 3> axis;
  std::array<Range, 3> range;
  /// Extent along an axis, by the smaller one across it.
  double thinness(std::size_t k) const {
    const double other = std::min(range[(k + 1) % 3].size(), range[(k + 2) % 3].size());
    return other > 0 ? range[k].size() / other : std::numeric_limits<double>::infinity();
  }
  /// The largest extent.
  double size() const { return std::max({range[0].size(), range[1].size(), range[2].size()}); }
};

/// A sample of a surface, with what all guesses of how the scene stands need to know of it. Refers
/// to the sample.
struct JudgedSurface {
  using Point = SurfaceSample::Point;

  explicit JudgedSurface(const SurfaceSample& sample);

  /// False where there is too little to judge.
  bool usable() const;
  ReferenceFrame make_frame(const std::array<Vec3d, 3>& axes) const;
  /// Share of the surface that lies on the surface again, to a cell, when mirrored in the middle of
  /// its range along an axis of the file.
  double mirrored(std::size_t axis) const;
  /// Are these coordinates of a map: far from the origin, a surface seen from one side, which is
  /// lower than it is wide? Then z is the height.
  bool of_map() const;
  /// Are these points what a camera in the origin sees, which looks along z: all in front of it,
  /// and none behind another?
  bool of_camera() const;

  static double weight_of(const Point& p) { return static_cast<double>(p.area); }
  static double along(const Point& p, const Vec3d& axis) {
    return p.position.cast<double>().dot(axis);
  }

  const std::vector<Point>& points;
  Vec3d origin;
  double weight = 0;      ///< Of all points: their area.
  Vec3d center{0, 0, 0};  ///< Centre of mass, relative to the origin.
  /// Mean normal: about zero for closed surfaces, and zero where the normals' sides tell nothing.
  Vec3d normal{0, 0, 0};
  ReferenceFrame frame;  ///< The file's axes.

 private:
  /// Do all normals look to the origin of coordinates, which lies among the points? Programs that
  /// estimate normals turn them there where they do not know the scanner's place.
  bool turned_to_origin() const;
  /// 1 where normals look away from the middle, as on the outside of a thing, -1 where they look to
  /// it, 0 where that cannot be told.
  double outward() const;
};

}  // namespace surfel
