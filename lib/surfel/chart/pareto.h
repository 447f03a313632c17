#pragma once

#include <cstddef>
#include <vector>

#include <surfel/base/export.h>

namespace surfel {

/// Cost of a setting and its distance from the truth; less is better in both.
struct CostPoint {
  double time = 0;   ///< > 0.
  double error = 0;  ///< > 0.
};

/// Tells for every point whether it is on the Pareto front: no other point is better in one measure
/// and at least as good in the other. Equal points are on the front together. O(n log n).
SURFEL_API std::vector<bool> pareto_front(const std::vector<CostPoint>& points);

/// Distance of a point from the front: the factors by which the best other points are better.
struct FrontDistance {
  /// The point's time by the least time of points that are no less accurate.
  double time = 1;
  /// The point with the least time; the point itself if no other is faster.
  std::size_t faster = 0;
  double error = 1;  ///< The point's error by the least error of points that take no longer.
  /// The point with the least error; the point itself if no other is better.
  std::size_t sharper = 0;
};

/// The distance of points[index]. Throws std::out_of_range for an index beyond the points.
SURFEL_API FrontDistance front_distance(const std::vector<CostPoint>& points, std::size_t index);

}  // namespace surfel
