#include <surfel/estimate/exact_search.h>
#include <surfel/estimate/flann_search.h>
#include <surfel/estimate/neighbor_search.h>

namespace surfel {

std::unique_ptr<NeighborSearch> make_neighbor_search(const Array<Vec3f>& points,
                                                     SearchMethod method) {
  if (method == SearchMethod::kExact) return std::make_unique<ExactSearch>(points);
  return make_flann_search(points, method == SearchMethod::kFlannApproximate);
}

}  // namespace surfel
