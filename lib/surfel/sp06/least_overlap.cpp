// Zhang, Pajarola 2006, "Single-Pass Point Rendering and Transparent Shading", sections 4.2, 6.2.

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>
#include <utility>
#include <vector>

#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/sp06/least_overlap.h>

namespace surfel {
namespace {

constexpr int kMaxSweeps = 100;  ///< A bound: sweeps end when no splat moves any more.
constexpr std::size_t kAreaGrain = 1 << 12;
constexpr std::uint32_t kUnplaced = 0xffffffff;  ///< No group has this number.
/// A splat moves only for more than this share of its overlap, so that rounding cannot move it back
/// and forth for ever.
constexpr double kWorthMoving = 1e-6;

/// Areas that the two discs of each edge share, unit^2, for each end of an edge.
Array<float> lens_areas(const SurfelCloud& cloud, const OverlapGraph& graph, double cutoff) {
  Array<float> area(graph.neighbor.size());
  parallel_for(graph.size(), kAreaGrain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t v = begin; v < end; ++v) {
      const std::uint32_t i = graph.splat[v];
      const double radius = splat_radius(cloud, i, cutoff);
      for (std::uint64_t e = graph.row_begin[v]; e < graph.row_begin[v + 1]; ++e) {
        const std::uint32_t j = graph.splat[graph.neighbor[e]];
        const Vec3d d = cloud.position[j].cast<double>() - cloud.position[i].cast<double>();
        area[e] = static_cast<float>(lens_area(radius, splat_radius(cloud, j, cutoff), d.norm()));
      }
    }
  });
  return area;
}

class Placement {
 public:
  Placement(const OverlapGraph& graph, const Array<float>& area, std::uint32_t groups)
      : graph_(graph), area_(area), group_(graph.size(), kUnplaced), overlap_(groups, 0) {
    for (std::uint32_t g = 0; g < groups; ++g) by_size_.emplace(0, g);
    sizes_.assign(groups, 0);
  }

  const std::vector<std::uint32_t>& group() const { return group_; }

  /// Puts a vertex that has no group where it overlaps least.
  void place(std::uint32_t v) {
    sum_overlaps(v);
    enter(v, best_group());
    clear_overlaps();
  }

  /// Moves it if it overlaps less elsewhere.
  bool improve(std::uint32_t v) {
    sum_overlaps(v);
    const double now = overlap_[group_[v]];
    const std::uint32_t best = now > 0 ? best_group() : group_[v];
    const bool worth = overlap_[best] < now * (1 - kWorthMoving);
    if (worth) {
      leave(v);
      enter(v, best);
    }
    clear_overlaps();
    return worth;
  }

  /// Adds up the areas shared within groups, every pair once.
  void measure(double& overlap, std::uint64_t& pairs) const {
    overlap = 0;
    pairs = 0;
    for (std::size_t v = 0; v < graph_.size(); ++v) {
      for (std::uint64_t e = graph_.row_begin[v]; e < graph_.row_begin[v + 1]; ++e) {
        const std::uint32_t w = graph_.neighbor[e];
        if (w <= v || group_[w] != group_[v]) continue;
        overlap += static_cast<double>(area_[e]);
        ++pairs;
      }
    }
  }

 private:
  void sum_overlaps(std::uint32_t v) {
    for (std::uint64_t e = graph_.row_begin[v]; e < graph_.row_begin[v + 1]; ++e) {
      const std::uint32_t g = group_[graph_.neighbor[e]];
      if (g == kUnplaced) continue;
      if (overlap_[g] == 0) touched_.push_back(g);
      overlap_[g] += static_cast<double>(area_[e]);
    }
  }
  void clear_overlaps() {
    for (const std::uint32_t g : touched_) overlap_[g] = 0;
    touched_.clear();
  }

  /// The smallest of the groups without overlap, or else the group with the least overlap; of equal
  /// groups the first.
  std::uint32_t best_group() const {
    for (const auto& [size, g] : by_size_) {
      if (overlap_[g] == 0) return g;
    }
    std::uint32_t best = 0;
    for (std::uint32_t g = 1; g < overlap_.size(); ++g) {
      if (overlap_[g] < overlap_[best]) best = g;
    }
    return best;
  }

  void enter(std::uint32_t v, std::uint32_t g) {
    group_[v] = g;
    resize(g, sizes_[g] + 1);
  }
  void leave(std::uint32_t v) { resize(group_[v], sizes_[group_[v]] - 1); }
  void resize(std::uint32_t g, std::size_t size) {
    auto node = by_size_.extract({sizes_[g], g});
    sizes_[g] = size;
    node.value().first = size;
    by_size_.insert(std::move(node));
  }

  const OverlapGraph& graph_;
  const Array<float>& area_;
  std::vector<std::uint32_t> group_;
  std::vector<double> overlap_;         ///< Overlap of the vertex at hand with every group ...
  std::vector<std::uint32_t> touched_;  ///< ... and the groups where it is not 0.
  std::vector<std::size_t> sizes_;
  std::set<std::pair<std::size_t, std::uint32_t>> by_size_;  ///< Groups, the smallest first.
};

}  // namespace

double lens_area(double radius_a, double radius_b, double distance) {
  const double small = std::min(radius_a, radius_b);
  const double large = std::max(radius_a, radius_b);
  if (distance >= small + large) return 0;
  if (distance <= large - small) return std::numbers::pi * small * small;
  // Half the angles under which the discs see the lens, and the triangles between the centres and
  // its corners (Heron's formula, in factors that do not cancel).
  const double d2 = distance * distance;
  const double cos_small = (d2 + (small - large) * (small + large)) / (2 * distance * small);
  const double cos_large = (d2 - (small - large) * (small + large)) / (2 * distance * large);
  const double kite2 = (small + large - distance) * (distance + small - large) *
                       (distance - small + large) * (distance + small + large);
  const double sectors = small * small * portable::acos(std::clamp(cos_small, -1.0, 1.0)) +
                         large * large * portable::acos(std::clamp(cos_large, -1.0, 1.0));
  return std::max(0.0, sectors - std::sqrt(std::max(0.0, kite2)) / 2);
}

Coloring least_overlap_groups(const SurfelCloud& cloud, const OverlapGraph& graph, double cutoff,
                              const Array<std::uint32_t>& order, std::uint32_t groups,
                              LeastOverlapReport* report) {
  const Array<float> area = lens_areas(cloud, graph, cutoff);
  Placement placement(graph, area, groups);
  for (const std::uint32_t v : order) placement.place(v);

  LeastOverlapReport own;
  LeastOverlapReport& r = report ? *report : own;
  r = {};
  for (const std::uint32_t splat : graph.splat) {
    const double radius = splat_radius(cloud, splat, cutoff);
    r.disc_area += std::numbers::pi * radius * radius;
  }
  placement.measure(r.placed_overlap_area, r.overlapping_pairs);
  do {
    if (interrupt_requested()) throw Error(ErrorKind::kInterrupted, "interrupted");
    ++r.sweeps;
    r.moved_last = 0;
    for (const std::uint32_t v : order) r.moved_last += placement.improve(v) ? 1 : 0;
  } while (r.moved_last > 0 && r.sweeps < kMaxSweeps);
  placement.measure(r.overlap_area, r.overlapping_pairs);

  Coloring coloring;
  coloring.colors = groups;
  coloring.color.resize(graph.size());
  std::copy(placement.group().begin(), placement.group().end(), coloring.color.begin());
  return coloring;
}

}  // namespace surfel
