#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <utility>
#include <vector>

#include <surfel/base/random.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/sp06/coloring.h>
#include <surfel/sp06/overlap_graph.h>

namespace surfel::test {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr std::size_t kManySplats = 3000;
#else
constexpr std::size_t kManySplats = 20000;
#endif

constexpr ColoringOrder kColoringOrders[] = {ColoringOrder::kLargestFirst,
                                             ColoringOrder::kSmallestLast, ColoringOrder::kDsatur};

inline void add_splat(SurfelCloud& cloud, const Vec3d& position, const Vec3d& normal,
                      double radius) {
  cloud.position.push_back(position.cast<float>());
  cloud.normal.push_back(normal.cast<float>());
  cloud.variance.push_back(static_cast<float>(radius * radius / 2));
}

/// Random splats on the unit sphere, every one with about `degree` others within the sum of the
/// radii, which vary by 2 : 1.
inline SurfelCloud sphere_cloud(std::size_t count, double degree) {
  SurfelCloud cloud;
  const double radius = std::sqrt((degree + 1) / static_cast<double>(count));
  for (std::size_t i = 0; i < count; ++i) {
    const double z = 2 * random_uniform(1, i, 0) - 1;
    const double angle = 2 * std::numbers::pi * random_uniform(1, i, 1);
    const double s = std::sqrt(1 - z * z);
    const Vec3d p(s * std::cos(angle), s * std::sin(angle), z);
    add_splat(cloud, p, p, radius * (0.65 + 0.65 * random_uniform(1, i, 2)));
  }
  return cloud;
}

/// Radii from 1e-6 to 1e3 in one file, at distances from the origin from 1e-6 to 1e4.
inline SurfelCloud cloud_of_all_radii(std::size_t count) {
  SurfelCloud cloud;
  for (std::size_t i = 0; i < count; ++i) {
    const double z = 2 * random_uniform(2, i, 0) - 1;
    const double angle = 2 * std::numbers::pi * random_uniform(2, i, 1);
    const double s = std::sqrt(1 - z * z);
    const double away = std::pow(10, -6 + 10 * random_uniform(2, i, 2));
    const Vec3d n(s * std::cos(angle), s * std::sin(angle), z);
    add_splat(cloud, away * n, n, std::pow(10, -6 + 9 * random_uniform(2, i, 3)));
  }
  return cloud;
}

/// Splats of one radius at random places of the unit square, normals up.
inline SurfelCloud plane_cloud(std::size_t count, double degree) {
  SurfelCloud cloud;
  const double radius =
      std::sqrt((degree + 1) / (4 * std::numbers::pi * static_cast<double>(count)));
  for (std::size_t i = 0; i < count; ++i) {
    add_splat(cloud, {random_uniform(3, i, 0), random_uniform(3, i, 1), 0}, {0, 0, 1}, radius);
  }
  return cloud;
}

inline SurfelCloud coincident_cloud(std::size_t count) {
  SurfelCloud cloud;
  for (std::size_t i = 0; i < count; ++i) add_splat(cloud, {1, 2, 3}, {0, 0, 1}, 0.5);
  return cloud;
}

using Pair = std::pair<std::uint32_t, std::uint32_t>;  ///< First below second.

/// All pairs of splats with |p_i - p_j| < overlap (r_i + r_j), by looking at every pair.
inline std::vector<Pair> overlapping_pairs(const SurfelCloud& cloud, double cutoff,
                                           double overlap) {
  struct Disc {
    double x, y, z, reach;
  };
  std::vector<Disc> discs;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3d p = cloud.position[i].cast<double>();
    discs.push_back({p.x(), p.y(), p.z(), splat_radius(cloud, i, cutoff)});
  }
  std::vector<Pair> pairs;
  for (std::uint32_t i = 0; i < discs.size(); ++i) {
    if (!(discs[i].reach > 0)) continue;
    for (std::uint32_t j = i + 1; j < discs.size(); ++j) {
      const double dx = discs[i].x - discs[j].x;
      const double dy = discs[i].y - discs[j].y;
      const double dz = discs[i].z - discs[j].z;
      const double reach = overlap * (discs[i].reach + discs[j].reach);
      if (dx * dx + dy * dy + dz * dz < reach * reach && discs[j].reach > 0)
        pairs.emplace_back(i, j);
    }
  }
  return pairs;
}

/// The edges of a graph as pairs of splats, ascending.
inline std::vector<Pair> edges_of(const OverlapGraph& graph) {
  std::vector<Pair> pairs;
  for (std::uint32_t v = 0; v < graph.size(); ++v) {
    for (const std::uint32_t w : graph.neighbors(v)) {
      const Pair pair(graph.splat[v], graph.splat[w]);
      if (pair.first < pair.second) pairs.push_back(pair);
    }
  }
  std::sort(pairs.begin(), pairs.end());
  return pairs;
}

/// A graph drawn by hand.
inline OverlapGraph graph_of(std::size_t vertices, const std::vector<Pair>& edges) {
  std::vector<std::vector<std::uint32_t>> rows(vertices);
  for (const auto& [a, b] : edges) {
    rows[a].push_back(b);
    rows[b].push_back(a);
  }
  OverlapGraph graph;
  graph.row_begin.push_back(0);
  for (std::uint32_t v = 0; v < vertices; ++v) {
    std::sort(rows[v].begin(), rows[v].end());
    graph.splat.push_back(v);
    graph.neighbor.insert(graph.neighbor.end(), rows[v].begin(), rows[v].end());
    graph.row_begin.push_back(graph.neighbor.size());
  }
  return graph;
}

}  // namespace surfel::test
