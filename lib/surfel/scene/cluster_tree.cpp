#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <surfel/scene/cluster_tree.h>

namespace surfel {
namespace {

bool finite(const TreeCluster& c) {
  const ClusterBounds& b = c.bounds;
  return b.center.allFinite() && std::isfinite(b.radius) && b.radius >= 0 &&
         std::isfinite(b.max_deviation) && b.max_deviation >= 0 && b.cone_axis.allFinite() &&
         std::isfinite(b.cone_cosine) && std::isfinite(c.spacing) && c.spacing >= 0 &&
         c.reach_min.allFinite() && c.reach_max.allFinite() &&
         (c.reach_min.array() <= c.reach_max.array()).all();
}

/// What is wrong with a cluster by itself; the surfels before it end at `next_surfel`.
std::string cluster_problem(const TreeCluster& c, std::size_t i, std::size_t next_surfel) {
  if (c.begin != next_surfel || c.end <= c.begin || c.end - c.begin > kClusterSurfels) {
    return fmt::format("cluster {} holds the surfels {} to {}; it must hold 1 to {}, from {} on", i,
                       c.begin, c.end, kClusterSurfels, next_surfel);
  }
  if ((c.child_count == 0) != (c.level == 0)) {
    return fmt::format("cluster {} of level {} has {} children", i, c.level, c.child_count);
  }
  if (!finite(c)) return fmt::format("the bounds of cluster {} are no usable numbers", i);
  return {};
}

/// What is wrong with where a cluster's children are; the children of the clusters before it end at
/// `next_child`.
std::string children_problem(const TreeCluster& c, std::size_t i, std::size_t next_child,
                             std::size_t clusters) {
  // In breadth-first order no cluster can be above itself, nor below two others.
  if (c.child_count == 0 || (c.first_child == next_child && next_child < clusters &&
                             c.child_count <= clusters - next_child)) {
    return {};
  }
  return fmt::format("cluster {} has the {} children from {} on; of {} clusters, {} is next", i,
                     c.child_count, c.first_child, clusters, next_child);
}

}  // namespace

std::string tree_problem(const ClusterTree& tree, std::size_t surfels) {
  std::size_t next_surfel = 0;
  std::size_t next_child = 1;
  for (std::size_t i = 0; i < tree.size(); ++i) {
    const TreeCluster& c = tree[i];
    std::string problem = cluster_problem(c, i, next_surfel);
    if (problem.empty()) problem = children_problem(c, i, next_child, tree.size());
    if (!problem.empty()) return problem;
    next_surfel = c.end;
    for (std::size_t k = 0; k < c.child_count; ++k) {
      if (tree[next_child + k].level + 1 != c.level) {
        return fmt::format("cluster {} of level {} has a child of level {}", i, c.level,
                           tree[next_child + k].level);
      }
    }
    next_child += c.child_count;
  }
  if (!tree.empty() && next_child != tree.size()) {
    return fmt::format("{} of {} clusters are nobody's children", tree.size() - next_child,
                       tree.size());
  }
  if (!tree.empty() && next_surfel != surfels) {
    return fmt::format("the clusters hold {} surfels of {}", next_surfel, surfels);
  }
  return {};
}

std::size_t first_leaf(const ClusterTree& tree) {
  const auto leaf = std::partition_point(tree.begin(), tree.end(),
                                         [](const TreeCluster& c) { return c.level > 0; });
  return static_cast<std::size_t>(leaf - tree.begin());
}

std::vector<TreeLevel> levels_of(const ClusterTree& tree) {
  std::vector<TreeLevel> levels;
  for (std::size_t i = 0; i < tree.size(); ++i) {
    if (i == 0 || tree[i].level != tree[i - 1].level) levels.push_back({i, i, tree[i].begin, 0});
    levels.back().end = i + 1;
    levels.back().end_surfel = tree[i].end;
  }
  return levels;
}

}  // namespace surfel
