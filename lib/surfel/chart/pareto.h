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

/// For every point whether it is on the Pareto front: no other is better in one and as good in the
/// other. Equal points are on it together. O(n log n).
SURFEL_API std::vector<bool> pareto_front(const std::vector<CostPoint>& points);

/// How far a point is from the front: the factors that the best of the others would save.
struct FrontDistance {
  double time = 1;          ///< Its time by the least one of points that are no less accurate.
  std::size_t faster = 0;   ///< The point with that time, itself if there is none.
  double error = 1;         ///< Its error by the least one of points that take no longer.
  std::size_t sharper = 0;  ///< The point with that error.
};

/// The distance of points[index]. Throws std::out_of_range for an index beyond the points.
SURFEL_API FrontDistance front_distance(const std::vector<CostPoint>& points, std::size_t index);

}  // namespace surfel
