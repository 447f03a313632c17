#include <algorithm>
#include <limits>
#include <numeric>
#include <optional>

#include <surfel/base/median.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/io/cloud_to_records.h>
#include <surfel/measure/cloud_statistics.h>
#include <surfel/measure/disc_coverage.h>
#include <surfel/scene/surfel_variance.h>

namespace surfel {
namespace {

constexpr std::size_t kQueryGrain = 64;

/// Measures the coverage around one surfel after the other.
class CoverageProbe {
 public:
  CoverageProbe(const SurfelCloud& cloud, const CloudStatisticsOptions& options,
                const MeasuredDiscs& discs, const NeighborSearch& neighbors)
      : cloud_(cloud), options_(options), discs_(discs), neighbors_(neighbors) {
    std::vector<float> radius(discs.radius.begin(), discs.radius.end());
    largest_radius_ = *std::max_element(radius.begin(), radius.end());
    if (largest_radius_ > kLikeRadii * median(radius)) around_.emplace(discs, largest_radius_);
  }

  CellCoverage measure(std::size_t disc) const {
    CellCoverage out;
    const std::uint32_t k = discs_.surfel[disc];
    const Vec3f& center = discs_.position[disc];
    std::vector<Neighbor> near;
    neighbors_.nearest(center, kCellNeighbors + 1, near);
    std::vector<CellNeighbor> around;
    for (const auto& [j, distance2] : near) {
      around.push_back(
          {discs_.position[j], same_surface(cloud_.normal[discs_.surfel[j]], cloud_.normal[k])});
    }
    const std::optional<SurfelCell> cell =
        surfel_cell(center, cloud_.normal[k], k, options_.seed, around);
    if (!cell) return out;
    out.area = cell->area;
    if (!around_ || !around_->within(center, cell->radius, near)) {
      const double reach = largest_radius_ + cell->radius;
      neighbors_.within(center, static_cast<float>(reach) * kReachRounding, kMostDiscs, near);
    }
    out.looked_at = near.size();
    for (const Vec3d& place : cell->points) {
      const auto discs = std::count_if(near.begin(), near.end(), [&](const Neighbor& n) {
        return covers(cloud_, discs_.surfel[n.index], discs_.radius[n.index], options_.cutoff,
                      cloud_.normal[k], place);
      });
      ++out.points;
      out.holes += discs == 0 ? 1 : 0;
      out.overlap += static_cast<double>(discs);
    }
    return out;
  }

 private:
  const SurfelCloud& cloud_;
  const CloudStatisticsOptions& options_;
  const MeasuredDiscs& discs_;
  const NeighborSearch& neighbors_;
  float largest_radius_ = 0;
  std::optional<DiscsAround> around_;  ///< Where the radii differ much.
};

void measure_spacing(const MeasuredDiscs& discs, const NeighborSearch& neighbors,
                     const std::vector<std::size_t>& queries, CloudStatistics& out) {
  if (discs.position.size() < 2) return;
  std::vector<double> distance(queries.size());
  std::vector<std::size_t> within(queries.size());
  const bool sized = !discs.radius.empty();
  parallel_for(queries.size(), kQueryGrain, [&](std::size_t begin, std::size_t end, int) {
    std::vector<Neighbor> near;
    for (std::size_t q = begin; q < end; ++q) {
      const Vec3f& at = discs.position[queries[q]];
      double nearest = std::numeric_limits<double>::infinity();
      neighbors.nearest(at, sized ? NeighborCounts::kMost + 1 : 2, near);
      for (const auto& [j, distance2] : near) {
        if (j == queries[q]) continue;
        const double to = (discs.position[j] - at).cast<double>().norm();
        nearest = std::min(nearest, to);
        if (sized && to <= discs.radius[queries[q]]) ++within[q];
      }
      distance[q] = nearest;
    }
  });
  if (sized) {
    out.neighbors.emplace();
    for (const std::size_t count : within) out.neighbors->add(count);
  }
  const auto coincident = std::count(distance.begin(), distance.end(), 0.0);
  out.coincident_share = static_cast<double>(coincident) / static_cast<double>(distance.size());
  out.spacing = distribution(std::move(distance));
}

void measure_coverage(const SurfelCloud& cloud, const CloudStatisticsOptions& options,
                      const MeasuredDiscs& discs, const NeighborSearch& neighbors,
                      const std::vector<std::size_t>& queries, CloudStatistics& out) {
  if (cloud.normal.empty() || !has_variance(cloud)) return;
  const CoverageProbe probe(cloud, options, discs, neighbors);
  std::vector<CellCoverage> cells(queries.size());
  std::size_t looked_at = 0;
  for (std::size_t round = 0; round < std::min(kCellRounds, queries.size()); ++round) {
    const std::size_t count = (queries.size() - round + kCellRounds - 1) / kCellRounds;
    parallel_each(count, kQueryGrain, [&](std::size_t i) {
      const std::size_t q = round + i * kCellRounds;
      cells[q] = probe.measure(queries[q]);
    });
    for (std::size_t i = 0; i < count; ++i) looked_at += cells[round + i * kCellRounds].looked_at;
    if (looked_at > kDiscsPerCell * queries.size()) break;
  }
  out.coverage = coverage_of_cells(cells);
}

}  // namespace

std::size_t rank_of(double share, std::size_t count) {
  return static_cast<std::size_t>(share * static_cast<double>(count - 1) + 0.5);
}

Distribution distribution(std::vector<double> values) {
  double sum = 0;
  for (const double v : values) sum += v;
  std::sort(values.begin(), values.end());
  const auto rank = [&](double p) { return values[rank_of(p, values.size())]; };
  return {sum / static_cast<double>(values.size()),
          values.front(),
          rank(0.05),
          rank(0.5),
          rank(0.95),
          values.back()};
}

void NeighborCounts::add(std::size_t neighbors) { ++surfels[std::min(neighbors, kMost)]; }

std::size_t NeighborCounts::samples() const {
  return std::accumulate(surfels.begin(), surfels.end(), std::size_t{0});
}

std::vector<std::string> CloudStatisticsOptions::problems() const {
  std::vector<std::string> out;
  check_option(out, cutoff > 0 && std::isfinite(cutoff), "cutoff", cutoff, "above 0");
  check_option(out, samples >= 1, "samples", samples, "at least 1");
  return out;
}

CloudStatistics cloud_statistics(const SurfelCloud& cloud, const CloudStatisticsOptions& options) {
  require_usable(options);
  CloudStatistics out;
  count_flaws(cloud, out);
  out.bounds = cloud.bounds();
  const MeasuredDiscs discs = finite_discs(cloud, options.cutoff);
  if (!discs.radius.empty()) {
    out.radius = distribution({discs.radius.begin(), discs.radius.end()});
  }
  if (discs.position.empty()) return out;
  const auto neighbors = make_neighbor_search(discs.position);
  const auto queries = sampled(discs.position.size(), options.samples, options.seed);
  measure_spacing(discs, *neighbors, queries, out);
  measure_coverage(cloud, options, discs, *neighbors, queries, out);
  return out;
}

std::vector<PropertyInfo> cloud_properties(const SurfelCloud& cloud) {
  std::vector<PropertyInfo> out;
  const CloudRecords records(cloud, {});
  for (const RecordColumn& column : records.columns()) {
    // Radii are made of the variances, for other viewers.
    if (column.name != "radius") out.push_back({column.name, scalar_name(column.type)});
  }
  return out;
}

}  // namespace surfel
