#include <algorithm>
#include <atomic>
#include <cmath>

#include <surfel/base/parallel.h>
#include <surfel/surface/halo_search.h>

namespace surfel {

HaloSearch::HaloSearch(const NeighborSearch& search, const Array<Vec3f>& points,
                       const Array<float>& known, std::size_t whole,
                       const Array<std::uint8_t>& wanted)
    : search_(search), points_(points), known_(known), whole_(whole), wanted_(wanted) {
  mark_.assign(points.size(), 0);
  reach_.assign(points.size(), 0);
  most_.assign(points.size(), 0);
}

/// Several points may mark a neighbour at once.
void HaloSearch::set(std::size_t i, std::uint8_t bit) const {
  const std::atomic_ref<std::uint8_t> mark(mark_[i]);
  if ((mark.load(std::memory_order_relaxed) & bit) == 0) {
    mark.fetch_or(bit, std::memory_order_relaxed);
  }
}

void HaloSearch::check(std::size_t i, std::span<const Neighbor> found, std::size_t most,
                       float limit2) const {
  // Distances round; a point at the very distance that is known may be missing.
  constexpr float kRounding = 1 + 1e-5F;
  const bool all = found.size() == std::min(most, whole_);
  float reach = std::sqrt(all ? found.back().distance2 : limit2) * kRounding;
  if (!(reach < known_[i]) && std::isfinite(known_[i])) {
    set(i, kUncertain);
    if (all) reach = std::min(reach, std::sqrt(limit2) * kRounding);
    // Only queries at this point write here, one at a time.
    reach_[i] = std::max(reach_[i], reach);
    most_[i] = std::max(most_[i], static_cast<std::uint32_t>(std::min(most, whole_)));
  }
  if (first_stage_) return;
  for (const Neighbor& n : found) {
    const std::uint8_t mark =
        std::atomic_ref<std::uint8_t>(mark_[n.index]).load(std::memory_order_relaxed);
    if ((mark & kBefore) == 0) continue;
    set(i, kUncertain);
    set(n.index, kDisturbs);
  }
}

void HaloSearch::search(const Vec3f& query, std::size_t most, float limit2,
                        std::vector<Neighbor>& out) const {
  search_.search(query, most, limit2, out);
  check(static_cast<std::size_t>(&query - points_.data()), out, most, limit2);
}

void HaloSearch::for_each(std::size_t most, float limit2, Body body) const {
  search_.for_each(most, limit2, [&](std::size_t i, std::span<const Neighbor> found, int worker) {
    if (first_stage_ || wanted_[i] != 0) check(i, found, most, limit2);
    body(i, found, worker);
  });
}

void HaloSearch::next_stage() {
  first_stage_ = false;
  for (std::uint8_t& mark : mark_) {
    if ((mark & kUncertain) != 0) mark |= kBefore;
  }
}

std::vector<HaloSearch::Missing> HaloSearch::missing() const {
  std::vector<Missing> out;
  for (std::size_t i = 0; i < mark_.size(); ++i) {
    const bool disturbs =
        (mark_[i] & kDisturbs) != 0 || (wanted_[i] != 0 && (mark_[i] & kUncertain) != 0);
    if (disturbs && most_[i] > 0) {
      out.push_back({static_cast<std::uint32_t>(i), most_[i], reach_[i]});
    }
  }
  return out;
}

}  // namespace surfel
