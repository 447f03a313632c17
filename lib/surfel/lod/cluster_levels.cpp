#include <algorithm>
#include <cmath>
#include <iterator>

#include <surfel/base/parallel.h>
#include <surfel/lod/cluster_levels.h>

namespace surfel {
namespace {

constexpr std::size_t kPlaceGrain = std::size_t{1} << 15;
constexpr std::size_t kPlaceClusters = 8;

/// A point while clusters are cut; `index` is its place in the order before, so that ties depend on
/// nothing else.
struct Place {
  Vec3f position;
  std::uint32_t index;
};

/// Orders places so that each run of kClusterSurfels is compact, each sequence of `reduction` such
/// runs is, each sequence of `reduction` such sequences, and so on: places are cut at a multiple of
/// the largest of these sizes, across the longest side of the box.
void split_places(Array<Place>& places, int reduction) {
  struct Run {
    std::size_t begin, end;  ///< Places among the clusters.
  };
  std::vector<Run> runs{{0, (places.size() + kClusterSurfels - 1) / kClusterSurfels}};
  std::vector<Run> parts;
  while (!runs.empty()) {
    parts.assign(2 * runs.size(), {0, 0});
    parallel_for(runs.size(), 1, [&](std::size_t r, std::size_t, int) {
      const Run run = runs[r];
      const std::size_t count = run.end - run.begin;
      if (count < 2) return;
      std::size_t unit = 1;
      while (unit * reduction < count) unit *= static_cast<std::size_t>(reduction);
      const std::size_t units = (count + unit - 1) / unit;
      const std::size_t middle = run.begin + units / 2 * unit;

      const auto at = [&](std::size_t cluster) {
        return places.begin() +
               static_cast<std::ptrdiff_t>(std::min(places.size(), cluster * kClusterSurfels));
      };
      Vec3f lo = at(run.begin)->position;
      Vec3f hi = lo;
      std::for_each(at(run.begin), at(run.end), [&](const Place& p) {
        lo = lo.cwiseMin(p.position);
        hi = hi.cwiseMax(p.position);
      });
      Eigen::Index axis = 0;
      (hi - lo).maxCoeff(&axis);
      std::nth_element(
          at(run.begin), at(middle), at(run.end), [axis](const Place& a, const Place& b) {
            return a.position[axis] != b.position[axis] ? a.position[axis] < b.position[axis]
                                                        : a.index < b.index;
          });
      parts[2 * r] = {run.begin, middle};
      parts[2 * r + 1] = {middle, run.end};
    });
    runs.clear();
    std::copy_if(parts.begin(), parts.end(), std::back_inserter(runs),
                 [](const Run& run) { return run.end - run.begin > 1; });
  }
  // Within a cluster points are in the order before again.
  const std::size_t clusters = (places.size() + kClusterSurfels - 1) / kClusterSurfels;
  parallel_for(clusters, kPlaceClusters, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t c = begin; c < end; ++c) {
      const std::size_t first = c * kClusterSurfels;
      const std::size_t last = std::min(places.size(), first + kClusterSurfels);
      std::sort(places.begin() + static_cast<std::ptrdiff_t>(first),
                places.begin() + static_cast<std::ptrdiff_t>(last),
                [](const Place& a, const Place& b) { return a.index < b.index; });
    }
  });
}

}  // namespace

Array<std::uint32_t> cluster_order(const Array<Vec3f>& position, const Array<std::uint32_t>& order,
                                   int reduction) {
  Array<Place> places(order.size());
  parallel_each(order.size(), kPlaceGrain, [&](std::size_t i) {
    places[i] = {position[order[i]], static_cast<std::uint32_t>(i)};
  });
  split_places(places, reduction);
  Array<std::uint32_t> out(order.size());
  parallel_each(order.size(), kPlaceGrain, [&](std::size_t i) { out[i] = order[places[i].index]; });
  return out;
}

std::vector<TreeCluster> finest_clusters(std::size_t count) {
  std::vector<TreeCluster> clusters((count + kClusterSurfels - 1) / kClusterSurfels);
  for (std::size_t c = 0; c < clusters.size(); ++c) {
    clusters[c].begin = static_cast<std::uint32_t>(c * kClusterSurfels);
    clusters[c].end = static_cast<std::uint32_t>(
        std::min<std::size_t>(count, clusters[c].begin + kClusterSurfels));
  }
  return clusters;
}

std::vector<TreeCluster> coarser_clusters(const std::vector<TreeCluster>& finer, int reduction) {
  const auto by = static_cast<std::size_t>(reduction);
  std::vector<TreeCluster> clusters((finer.size() + by - 1) / by);
  std::uint32_t members = 0;
  for (std::size_t c = 0; c < clusters.size(); ++c) {
    TreeCluster& cluster = clusters[c];
    cluster.level = static_cast<std::uint8_t>(finer.front().level + 1);
    cluster.first_child = static_cast<std::uint32_t>(c * by);
    cluster.child_count =
        static_cast<std::uint32_t>(std::min(finer.size() - cluster.first_child, by));
    const TreeCluster& last = finer[cluster.first_child + cluster.child_count - 1];
    const std::size_t below = last.end - finer[cluster.first_child].begin;
    cluster.begin = members;
    members += static_cast<std::uint32_t>((below + by - 1) / by);
    cluster.end = members;
  }
  return clusters;
}

std::span<const std::uint32_t> finest_below(const Array<std::uint32_t>& finest, std::size_t level,
                                            std::size_t cluster, int reduction) {
  std::size_t each = kClusterSurfels;
  for (std::size_t l = 0; l < level; ++l) each *= static_cast<std::size_t>(reduction);
  const std::size_t begin = std::min(cluster * each, finest.size());
  return {finest.data() + begin, std::min(each, finest.size() - begin)};
}

void bound_sphere(ClusterBounds& bounds, const Array<Vec3f>& position,
                  std::span<const std::uint32_t> members) {
  Vec3f lo = position[members.front()];
  Vec3f hi = lo;
  for (const std::uint32_t i : members) {
    lo = lo.cwiseMin(position[i]);
    hi = hi.cwiseMax(position[i]);
  }
  bounds.center = lo + (hi - lo) / 2;
  float radius2 = 0;
  for (const std::uint32_t i : members) {
    radius2 = std::max(radius2, (position[i] - bounds.center).squaredNorm());
  }
  bounds.radius = std::sqrt(radius2) * (1.0F + 1e-5F);  // Means are rounded.
}

ClusterTree joined_levels(std::span<const std::span<const TreeCluster>> levels) {
  ClusterTree tree;
  std::uint32_t members = 0;
  for (std::size_t l = levels.size(); l-- > 0;) {
    const auto next_level = static_cast<std::uint32_t>(tree.size() + levels[l].size());
    for (TreeCluster cluster : levels[l]) {
      cluster.begin += members;
      cluster.end += members;
      if (cluster.child_count > 0) cluster.first_child += next_level;
      tree.push_back(cluster);
    }
    members += levels[l].back().end;
  }
  return tree;
}

}  // namespace surfel
