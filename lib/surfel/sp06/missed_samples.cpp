#include <surfel/base/parallel.h>
#include <surfel/sp06/missed_samples.h>

namespace surfel {

double missed_share(const Discs& discs, std::span<const Vec3f> places,
                    std::span<const Vec3f> normals) {
  if (places.empty()) return 0;
  if (discs.size() == 0) return 1;
  constexpr std::size_t kGrain = 1024;
  const DiscTree tree(discs);
  PerWorker<std::size_t> missed;
  parallel_for(places.size(), kGrain, [&](std::size_t begin, std::size_t end, int worker) {
    for (std::size_t s = begin; s < end; ++s) {
      bool found = false;
      tree.search(
          places[s],
          [&](const DiscTree::Node& node, std::size_t, float distance2) {
            return !found && distance2 <= node.radius() * node.radius();
          },
          [&](std::size_t i) {
            found = found || ((places[s] - discs.center[i]).squaredNorm() <=
                                  discs.radius[i] * discs.radius[i] &&
                              normals[s].dot(discs.normal[i]) > 0);
          });
      missed[worker] += found ? 0 : 1;
    }
  });
  std::size_t all = 0;
  missed.for_each([&](std::size_t m) { all += m; });
  return static_cast<double>(all) / static_cast<double>(places.size());
}

}  // namespace surfel
