#include <algorithm>

#include <surfel/base/plugin.h>
#include <surfel/surface/exact_search.h>
#include <surfel/surface/flann_plugin.h>
#include <surfel/surface/neighbor_search.h>

namespace surfel {

std::unique_ptr<NeighborSearch> make_neighbor_search(const Array<Vec3f>& points,
                                                     SearchMethod method) {
  if (method == SearchMethod::kExact) return std::make_unique<ExactSearch>(points);
  std::unique_ptr<NeighborSearch> search;
  const auto make =
      reinterpret_cast<MakeFlannSearch*>(plugin_symbol("flann", kMakeFlannSearchSymbol));
  make(points, method == SearchMethod::kFlannApproximate, search);
  return search;
}

NeighborRows NeighborSearch::rows(std::size_t k) const {
  NeighborRows rows;
  rows.count = std::min(k, size());
  rows.stride = rows.count;
  rows.kept.resize(size() * rows.stride);
  rows.index = rows.kept.data();
  for_each_nearest(rows.count, [&](std::size_t i, std::span<const Neighbor> near, int) {
    std::uint32_t* row = rows.kept.data() + i * rows.stride;
    for (const Neighbor& neighbor : near) *row++ = neighbor.index;
  });
  return rows;
}

double neighbor_recall(const Array<Vec3f>& points, const NeighborSearch& search, std::size_t k) {
  constexpr std::size_t kMostSamples = 1000;  // The recall's standard error is below 1.6 %.
  const std::size_t samples = std::min(points.size(), kMostSamples);
  const ExactSearch exact(points);
  std::vector<Neighbor> expected;
  std::vector<Neighbor> near;
  std::size_t wanted = 0;
  std::size_t found = 0;
  for (std::size_t s = 0; s < samples; ++s) {
    const Vec3f& query = points[s * points.size() / samples];
    exact.nearest(query, k, expected);
    search.nearest(query, k, near);
    if (expected.empty()) continue;
    wanted += expected.size();
    found +=
        static_cast<std::size_t>(std::count_if(near.begin(), near.end(), [&](const Neighbor& n) {
          return n.distance2 <= expected.back().distance2;
        }));
  }
  return wanted == 0 ? 1 : static_cast<double>(found) / static_cast<double>(wanted);
}

}  // namespace surfel
