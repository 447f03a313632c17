#include <algorithm>

#include <surfel/base/parallel.h>
#include <surfel/surface/neighbor_lists.h>

namespace surfel {

NeighborLists::NeighborLists(const NeighborSearch& search, const Array<Vec3f>& points,
                             std::size_t k)
    : search_(search), points_(points), k_(std::min(k, points.size())) {}

void NeighborLists::for_each(std::size_t most, float limit2, Body body) const {
  const std::size_t k = std::min(most, points_.size());
  if (k > k_ || limit2 < kNoLimit) {
    search_.for_each(most, limit2, body);
    return;
  }
  if (index_.empty()) {
    index_.resize(points_.size() * k_);
    search_.for_each_nearest(k_, [&](std::size_t i, std::span<const Neighbor> near, int worker) {
      std::uint32_t* list = index_.data() + i * k_;
      for (const Neighbor& neighbor : near) *list++ = neighbor.index;
      body(i, near.first(k), worker);
    });
    return;
  }
  constexpr std::size_t kGrain = 1024;
  parallel_for(points_.size(), kGrain, [&](std::size_t begin, std::size_t end, int worker) {
    std::vector<Neighbor> near(k);
    for (std::size_t i = begin; i < end; ++i) {
      const std::uint32_t* list = index_.data() + i * k_;
      for (std::size_t n = 0; n < k; ++n) {
        near[n] = {list[n], (points_[list[n]] - points_[i]).squaredNorm()};
      }
      body(i, near, worker);
    }
  });
}

NeighborRows NeighborLists::rows(std::size_t k) const {
  k = std::min(k, points_.size());
  if (k > k_) return search_.rows(k);
  if (index_.empty()) {
    for_each_nearest(k, [](std::size_t, std::span<const Neighbor>, int) {});
  }
  return {index_.data(), k, k_, {}};
}

}  // namespace surfel
