#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include <surfel/base/parallel.h>
#include <surfel/surface/point_spacing.h>

namespace surfel {

double point_spacing(const Array<Vec3f>& points, const NeighborSearch& search) {
  constexpr std::size_t kMostLooked = 4096;
  constexpr std::size_t kRank = 8;  // One ring of neighbours.
  constexpr std::size_t kGrain = 64;
  if (points.size() < 2) return 0;
  const std::size_t looked = std::min(points.size(), kMostLooked);
  const std::size_t rank = std::min(kRank, points.size() - 1);
  std::vector<float> distance2(looked);
  PerWorker<std::vector<Neighbor>> scratch;
  parallel_for(looked, kGrain, [&](std::size_t begin, std::size_t end, int worker) {
    std::vector<Neighbor>& found = scratch[worker];
    for (std::size_t i = begin; i < end; ++i) {
      search.nearest(points[i * points.size() / looked], rank + 1, found);
      distance2[i] = found.back().distance2;
    }
  });
  const auto middle = distance2.begin() + static_cast<std::ptrdiff_t>(looked / 2);
  std::nth_element(distance2.begin(), middle, distance2.end());
  const double k = static_cast<double>(rank);
  return std::sqrt(std::numbers::pi / (k - 1.0 / 3) * static_cast<double>(*middle));
}

}  // namespace surfel
