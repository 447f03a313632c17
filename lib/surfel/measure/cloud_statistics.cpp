#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <type_traits>

#include <surfel/base/box_tree.h>
#include <surfel/base/median.h>
#include <surfel/base/morton.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/io/cloud_to_records.h>
#include <surfel/measure/cloud_statistics.h>
#include <surfel/scene/surfel_variance.h>
#include <surfel/surface/neighbor_search.h>
#include <surfel/surface/tangent_frame.h>
#include <surfel/surface/voronoi_cell.h>

namespace surfel {
namespace {

constexpr std::size_t kGrain = 1 << 14;
constexpr std::size_t kQueryGrain = 64;
/// Neighbours that bound a Voronoi cell; on a random surface six do on average.
constexpr std::size_t kCellNeighbors = 24;
/// Discs looked at per cell; more over one point than this are not counted.
constexpr std::size_t kMostDiscs = 1024;
constexpr int kPointsPerCell = 16;  ///< 20,000 cells tell a share to 0.1 % then.
/// Cells are measured in so many rounds, each spread over the cloud, of which the last are left out
/// once discs have been looked at so often for each cell in the mean. Discs that just close a
/// surface take a quarter of it; thousands over each other would take all the time there is.
constexpr std::size_t kRounds = 16;
constexpr std::size_t kDiscsPerCell = 48;
/// Where the largest radius is more than this times the median one, what lies over a place is
/// looked for by each disc's own radius.
constexpr float kLikeRadii = 4;
/// Normals within 60 degrees show the same surface (surface/sheet.h says why no more). The rule
/// that sizes are estimated by is another on purpose: coverage is a second opinion on the sizes.
constexpr float kAgreeingCosine = 0.5F;

bool finite(float value) { return std::isfinite(value); }
bool finite(const Vec2f& value) { return value.allFinite(); }
bool finite(const Vec3f& value) { return value.allFinite(); }
template <class Integer>
requires std::is_integral_v<Integer>
bool finite(Integer) { return true; }

void count_flaws(const SurfelCloud& cloud, CloudStatistics& out) {
  const std::size_t n = cloud.size();
  out.count = n;
  out.nonfinite_positions =
      count_where(n, [&](std::size_t i) { return !finite(cloud.position[i]); });
  if (!cloud.normal.empty()) {
    const auto& normal = cloud.normal;
    out.nonfinite_normals = count_where(n, [&](std::size_t i) { return !finite(normal[i]); });
    out.zero_normals = count_where(n, [&](std::size_t i) { return normal[i].isZero(0); });
    out.non_unit_normals = count_where(n, [&](std::size_t i) {
      return finite(normal[i]) && !normal[i].isZero(0) && std::abs(normal[i].norm() - 1) > 1e-3F;
    });
  }
  Array<std::uint8_t> flawed;
  flawed.assign(n, 0);
  SurfelCloud::visit_columns(cloud, [&](const auto& column) {
    const void* address = &column;
    if (column.empty() || address == &cloud.position || address == &cloud.normal) return;
    parallel_each(n, kGrain, [&](std::size_t i) {
      if (!finite(column[i])) flawed[i] = 1;
    });
  });
  out.nonfinite_values = count_where(n, [&](std::size_t i) { return flawed[i] != 0; });
}

/// The surfels with finite positions, which spacing and coverage are measured of.
struct Discs {
  Array<Vec3f> position;
  Array<std::uint32_t> surfel;  ///< Index into the cloud.
  Array<float> radius;          ///< sqrt(2 c max variance); empty without variances.
};

float largest_variance(const SurfelCloud& cloud, std::size_t i) {
  return cloud.anisotropic() ? std::max(cloud.variance_u[i], cloud.variance_v[i])
                             : cloud.variance[i];
}

Discs finite_discs(const SurfelCloud& cloud, double cutoff) {
  Discs discs;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (!finite(cloud.position[i])) continue;
    discs.position.push_back(cloud.position[i]);
    discs.surfel.push_back(static_cast<std::uint32_t>(i));
    if (!has_variance(cloud)) continue;
    const double variance = largest_variance(cloud, i);
    const bool usable = std::isfinite(variance) && variance > 0;
    discs.radius.push_back(usable ? static_cast<float>(std::sqrt(2 * cutoff * variance)) : 0.0F);
  }
  return discs;
}

/// The exponent beta = d^T V^-1 d / 2 of a place at the offset d from surfel i: half the squared
/// distance within the disc's plane, in the disc's standard deviations. [SS01 (6), no screen]
double exponent(const SurfelCloud& cloud, std::size_t i, const Vec3d& offset) {
  const Vec3d n = cloud.normal[i].cast<double>();
  if (!cloud.anisotropic()) {
    return (offset - offset.dot(n) * n).squaredNorm() /
           (2 * static_cast<double>(cloud.variance[i]));
  }
  const Vec3d t = cloud.tangent[i].cast<double>();
  const double u = offset.dot(t);
  const double v = offset.dot(n.cross(t));
  return u * u / (2 * static_cast<double>(cloud.variance_u[i])) +
         v * v / (2 * static_cast<double>(cloud.variance_v[i]));
}

/// Finds discs that may lie over places near a place by the radius of each, so that small ones
/// around a large one do not all count.
class DiscsAround {
 public:
  DiscsAround(const Discs& discs, float largest_radius)
      : discs_(discs), reach_(discs.radius), order_(morton_order(discs.position)) {
    // A place over a disc is no further from its plane and from its axis than the radius.
    for (float& r : reach_) r = std::min(r * std::numbers::sqrt2_v<float>, largest_radius);
    tree_ = BoxTree<Box, 4, 2>(order_.size(), [&](std::size_t place) {
      const std::uint32_t disc = order_[place];
      if (!(reach_[disc] > 0)) return Box();
      const Eigen::Array3f center = discs_.position[disc].array();
      return Box{center - reach_[disc], center + reach_[disc]};
    });
  }

  /// The discs that may lie over places in the ball; false if there are more than kMostDiscs.
  bool within(const Vec3f& center, double radius, std::vector<Neighbor>& out) const {
    out.clear();
    const float reach = static_cast<float>(radius) * kRounding;
    tree_.for_each_leaf(
        [&](const Box& box) {
          return box.distance2(center.array()) <= reach * reach && out.size() <= kMostDiscs;
        },
        [&](std::size_t leaf) {
          tree_.for_each_item(leaf, [&](std::size_t place) {
            const std::uint32_t disc = order_[place];
            const float distance2 = (discs_.position[disc] - center).squaredNorm();
            const float limit = reach + reach_[disc] * kRounding;
            if (reach_[disc] > 0 && distance2 <= limit * limit) out.push_back({disc, distance2});
          });
        });
    return out.size() <= kMostDiscs;
  }

 private:
  static constexpr float kRounding = 1.0001F;

  /// Box around what the discs reach.
  struct Box {
    Eigen::Array3f low = Eigen::Array3f::Constant(std::numeric_limits<float>::max());
    Eigen::Array3f high = Eigen::Array3f::Constant(-std::numeric_limits<float>::max());

    void add(const Box& other) {
      low = low.min(other.low);
      high = high.max(other.high);
    }
    float distance2(const Eigen::Array3f& p) const {
      return (low - p).max(p - high).max(0).matrix().squaredNorm();
    }
  };

  const Discs& discs_;
  Array<float> reach_;
  Array<std::uint32_t> order_;
  BoxTree<Box, 4, 2> tree_;
};

/// Measures the coverage around one surfel after the other.
class CoverageProbe {
 public:
  CoverageProbe(const SurfelCloud& cloud, const CloudStatisticsOptions& options, const Discs& discs,
                const NeighborSearch& neighbors)
      : cloud_(cloud), options_(options), discs_(discs), neighbors_(neighbors) {
    std::vector<float> radius(discs.radius.begin(), discs.radius.end());
    largest_radius_ = *std::max_element(radius.begin(), radius.end());
    if (largest_radius_ > kLikeRadii * median(radius)) around_.emplace(discs, largest_radius_);
  }

  struct Cell {
    double area = 0;  ///< 0 where the cell is open.
    int points = 0;
    int holes = 0;
    double overlap = 0;         ///< Discs over the points, summed.
    std::size_t looked_at = 0;  ///< Discs that may lie over the points.
  };

  Cell measure(std::size_t disc) const {
    Cell out;
    const std::uint32_t k = discs_.surfel[disc];
    const Vec3f& normal = cloud_.normal[k];
    if (!finite(normal) || normal.isZero(0)) return out;
    const TangentFrame frame = tangent_frame(normal.cast<double>().normalized());
    VoronoiCell cell;
    if (!closed_cell(disc, frame, cell)) return out;
    out.area = cell.area();

    const Vec3f& center = discs_.position[disc];
    std::vector<Neighbor> near;
    if (!around_ || !around_->within(center, cell.radius(), near)) {
      const double reach = largest_radius_ + cell.radius();
      neighbors_.within(center, static_cast<float>(reach) * 1.0001F, kMostDiscs, near);
    }
    out.looked_at = near.size();
    for (int point = 0; point < kPointsPerCell; ++point) {
      const double s = random_uniform(options_.seed, k, 2 * point + 1);
      const double t = random_uniform(options_.seed, k, 2 * point + 2);
      const Vec2d p = cell.point(s, t);
      const int discs = covering(near, k, discs_.position[disc].cast<double>() + frame.lifted(p));
      ++out.points;
      out.holes += discs == 0 ? 1 : 0;
      out.overlap += discs;
    }
    return out;
  }

 private:
  bool agree(std::uint32_t i, std::uint32_t k) const {
    return cloud_.normal[i].dot(cloud_.normal[k]) > kAgreeingCosine;
  }

  /// False where the cell is open, or neighbours that were not looked at could still cut it.
  bool closed_cell(std::size_t disc, const TangentFrame& frame, VoronoiCell& cell) const {
    const Vec3f& center = discs_.position[disc];
    std::vector<Neighbor> near;
    neighbors_.nearest(center, kCellNeighbors + 1, near);
    const double reach = (discs_.position[near.back().index] - center).norm();
    if (!(reach > 0)) return false;
    cell.reset(reach);
    for (const auto& [j, distance2] : near) {
      if (!agree(discs_.surfel[j], discs_.surfel[disc])) continue;
      cell.cut(frame.flat((discs_.position[j] - center).cast<double>()));
    }
    return cell.radius() <= reach / 2;
  }

  int covering(const std::vector<Neighbor>& near, std::uint32_t k, const Vec3d& point) const {
    int count = 0;
    for (const auto& [j, distance2] : near) {
      const std::uint32_t i = discs_.surfel[j];
      if (discs_.radius[j] == 0 || !agree(i, k)) continue;
      const Vec3d offset = point - discs_.position[j].cast<double>();
      const double height = std::abs(offset.dot(cloud_.normal[i].cast<double>()));
      if (height <= discs_.radius[j] && exponent(cloud_, i, offset) < options_.cutoff) ++count;
    }
    return count;
  }

  const SurfelCloud& cloud_;
  const CloudStatisticsOptions& options_;
  const Discs& discs_;
  const NeighborSearch& neighbors_;
  float largest_radius_ = 0;
  std::optional<DiscsAround> around_;  ///< Where the radii differ much.
};

/// `samples` of [0, count), spread evenly, one from each of equal stretches; all if there are
/// fewer.
std::vector<std::size_t> sampled(std::size_t count, std::size_t samples, std::uint64_t seed) {
  std::vector<std::size_t> picked(std::min(count, samples));
  const double stretch = static_cast<double>(count) / static_cast<double>(picked.size());
  for (std::size_t i = 0; i < picked.size(); ++i) {
    const double jitter = picked.size() == count ? 0 : random_uniform(seed, i);
    const auto at = static_cast<std::size_t>((static_cast<double>(i) + jitter) * stretch);
    picked[i] = std::min(at, count - 1);
  }
  return picked;
}

void measure_spacing(const Discs& discs, const NeighborSearch& neighbors,
                     const std::vector<std::size_t>& queries, CloudStatistics& out) {
  if (discs.position.size() < 2) return;
  std::vector<double> distance(queries.size());
  parallel_for(queries.size(), kQueryGrain, [&](std::size_t begin, std::size_t end, int) {
    std::vector<Neighbor> near;
    for (std::size_t q = begin; q < end; ++q) {
      const Vec3f& at = discs.position[queries[q]];
      double nearest = std::numeric_limits<double>::infinity();
      neighbors.nearest(at, 2, near);
      for (const auto& [j, distance2] : near) {
        if (j != queries[q])
          nearest = std::min(nearest, (discs.position[j] - at).cast<double>().norm());
      }
      distance[q] = nearest;
    }
  });
  const auto coincident = std::count(distance.begin(), distance.end(), 0.0);
  out.coincident_share = static_cast<double>(coincident) / static_cast<double>(distance.size());
  out.spacing = distribution(std::move(distance));
}

void measure_coverage(const SurfelCloud& cloud, const CloudStatisticsOptions& options,
                      const Discs& discs, const NeighborSearch& neighbors,
                      const std::vector<std::size_t>& queries, CloudStatistics& out) {
  if (cloud.normal.empty() || !has_variance(cloud)) return;
  const CoverageProbe probe(cloud, options, discs, neighbors);
  std::vector<CoverageProbe::Cell> cells(queries.size());
  std::size_t looked_at = 0;
  for (std::size_t round = 0; round < std::min(kRounds, queries.size()); ++round) {
    const std::size_t count = (queries.size() - round + kRounds - 1) / kRounds;
    parallel_each(count, kQueryGrain, [&](std::size_t i) {
      const std::size_t q = round + i * kRounds;
      cells[q] = probe.measure(queries[q]);
    });
    for (std::size_t i = 0; i < count; ++i) looked_at += cells[round + i * kRounds].looked_at;
    if (looked_at > kDiscsPerCell * queries.size()) break;
  }
  // Cells differ in area and have the same number of points: a point counts by its cell's area.
  Coverage coverage;
  double area = 0;
  for (const CoverageProbe::Cell& cell : cells) {
    if (cell.area <= 0) continue;
    ++coverage.cells;
    area += cell.area;
    coverage.hole_share += cell.area * cell.holes / cell.points;
    coverage.overlap += cell.area * cell.overlap / cell.points;
  }
  if (coverage.cells == 0) return;
  coverage.hole_share /= area;
  coverage.overlap /= area;
  coverage.cell_area_mean = area / static_cast<double>(coverage.cells);
  out.coverage = coverage;
}

}  // namespace

Distribution distribution(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const auto rank = [&](double p) {
    return values[static_cast<std::size_t>(p * static_cast<double>(values.size() - 1) + 0.5)];
  };
  double sum = 0;
  for (const double v : values) sum += v;
  return {sum / static_cast<double>(values.size()),
          values.front(),
          rank(0.05),
          rank(0.5),
          rank(0.95),
          values.back()};
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
  const Discs discs = finite_discs(cloud, options.cutoff);
  if (has_variance(cloud)) {
    out.negative_variances =
        count_where(cloud.size(), [&](std::size_t i) { return largest_variance(cloud, i) < 0; });
    if (!discs.radius.empty())
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
