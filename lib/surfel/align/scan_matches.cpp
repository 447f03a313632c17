#include <algorithm>
#include <cmath>
#include <numbers>

#include <surfel/align/scan_matches.h>
#include <surfel/base/parallel.h>

namespace surfel {

std::size_t matched_points(const Scan& from, std::size_t most) {
  return std::min(from.position.size(), most);
}

std::vector<ScanMatch> match_scans(const Scan& from, const Scan& to, const RigidPose& relative,
                                   double reach, std::size_t most) {
  constexpr std::size_t kGrain = 256;
  constexpr double kLeastCosine = 0.5 * std::numbers::sqrt2;
  const std::size_t looked = matched_points(from, most);
  const bool oriented = from.oriented && to.oriented;
  std::vector<std::vector<ScanMatch>> found((looked + kGrain - 1) / kGrain);
  PerWorker<std::vector<Neighbor>> scratch;
  parallel_for(looked, kGrain, [&](std::size_t begin, std::size_t end, int worker) {
    std::vector<Neighbor>& nearest = scratch[worker];
    for (std::size_t k = begin; k < end; ++k) {
      const std::size_t i = k * from.position.size() / looked;
      const Vec3d place = relative(from.position[i].cast<double>());
      to.search->search(place.cast<float>(), 1, static_cast<float>(reach * reach), nearest);
      if (nearest.empty()) continue;
      const std::uint32_t j = nearest.front().index;
      const Vec3d normal = relative.rotation * from.normal[i].cast<double>();
      const double cosine = normal.dot(to.normal[j].cast<double>());
      if (to.border[j] != 0 || (oriented ? cosine : std::abs(cosine)) < kLeastCosine) continue;
      found[begin / kGrain].push_back({static_cast<std::uint32_t>(i), j});
    }
  });
  std::vector<ScanMatch> all;
  for (const std::vector<ScanMatch>& some : found) all.insert(all.end(), some.begin(), some.end());
  return all;
}

}  // namespace surfel
