#pragma once

#include <cmath>
#include <span>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>

namespace surfel {

/// Where the Voronoi cell of a point ends on a side without neighbours, in local spacings. Smaller
/// values leave more gaps where leaves, branches and occlusions interrupt the surface (at 0.75 a
/// fifth more pixels of real scans are seen through); larger values reach further beyond borders,
/// where this one reaches half a spacing too far.
inline constexpr double kBorderReach = 0.95;

/// Voronoi cell of the origin of a plane: cut out of a square by the bisector of one neighbour
/// after another. Keeps its memory, so that many cells cost no allocations.
class SURFEL_API VoronoiCell {
 public:
  /// Starts anew with the square |x|, |y| <= half_side, > 0.
  void reset(double half_side);
  /// Keeps the part that is no further from the origin than from `neighbor` (Sutherland and Hodgman
  /// 1974). A neighbour at the origin is ignored. Was anything cut off?
  bool cut(const Vec2d& neighbor);

  /// Counter-clockwise.
  std::span<const Vec2d> corners() const { return corners_; }
  /// Distance of the furthest corner. A cell that all neighbours up to a distance d have cut is
  /// final if its radius is d / 2 at most: no neighbour further away can cut it.
  double radius() const { return std::sqrt(radius2_); }
  double radius2() const { return radius2_; }
  double area() const;
  /// Integral of x x^T over the cell: second moments about the origin.
  Mat2d moments() const;
  /// Point of the cell for (s, t) in [0, 1)^2, uniform by area.
  Vec2d point(double s, double t) const;

 private:
  Array<Vec2d> corners_;
  Array<Vec2d> other_;
  Array<double> excess_;
  double radius2_ = 0;
};

}  // namespace surfel
