#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/estimate/neighborhood_plane.h>
#include <surfel/estimate/noisy_normals.h>
#include <surfel/estimate/normals.h>

namespace surfel {
namespace {

constexpr int kMostNeighbors = std::numeric_limits<std::uint16_t>::max();
/// Neighbourhoods that are too thin grow up to this many points.
constexpr std::size_t kMostExtended = 128;
/// Half width of the adaptive size's confidence intervals, in standard errors. Larger values take
/// noise away better and round edges off more; between 1 and 2.4 this is the best compromise on
/// plane, sphere, torus and cube.
constexpr double kIntervalErrors = 1.8;
/// Normals that differ by less, in radians, agree: they are floats.
constexpr double kSameAngle = 1e-6;

/// Normal of one neighbourhood, or why there is none.
struct Result {
  PointFlag flag = PointFlag::kTooFew;
  std::size_t neighbors = 0;
  Plane plane{};  ///< Set if the flag is kGood or kThin.
};

/// Makes the normals of single points from their neighbourhoods.
class Estimator {
 public:
  Estimator(const Array<Vec3f>& points, const NeighborSearch& search, const NormalOptions& options)
      : points_(points), search_(search) {
    // In steps of sqrt(2); the last one is k_max.
    if (!options.adaptive) return;
    const auto most = static_cast<std::size_t>(options.k_max);
    for (double k = options.k_min; k < options.k_max; k *= std::sqrt(2.0)) {
      sizes_.push_back(static_cast<std::size_t>(std::lround(k)));
    }
    while (!sizes_.empty() && sizes_.back() >= most) sizes_.pop_back();
    sizes_.push_back(most);
  }

  Moments moments(std::size_t i, std::span<const Neighbor> neighbors) const {
    Moments moments;
    for (const Neighbor& neighbor : neighbors) moments.add(offset(i, neighbor));
    return moments;
  }

  /// The reason why no plane fits; none if one does.
  std::optional<PointFlag> planeless(std::size_t i, const Moments& moments) const {
    if (moments.n < 3) return PointFlag::kTooFew;
    if (!(moments.variance() > least_variance(i))) return PointFlag::kCoincident;
    return std::nullopt;
  }

  Result of_plane(std::size_t i, const Plane& plane) const {
    Result result{PointFlag::kGood, static_cast<std::size_t>(plane.n), plane};
    const Vec3d& lambda = plane.lambda;
    if (!(lambda[1] > std::max(least_variance(i), Plane::kLineShare * lambda[2]))) {
      result.flag = PointFlag::kCollinear;
    } else if (plane.thin()) {
      result.flag = PointFlag::kThin;
    }
    return result;
  }

  /// Whether more neighbours may help; not if all points are neighbours already.
  bool extensible(const Result& result, std::size_t found) const {
    return result.flag != PointFlag::kGood && found < std::min(kMostExtended, search_.whole());
  }

  /// Result of twice as many neighbours as were `found`, four times as many, and so on, until the
  /// neighbourhood is not thin.
  Result extended(std::size_t i, std::size_t found, std::vector<Neighbor>& scratch) const {
    Result result;
    std::size_t before = 0;
    do {
      before = found;
      search_.nearest(points_[i], std::min(2 * found, kMostExtended), scratch);
      found = scratch.size();
      result = classified(i, moments(i, scratch));
      // A search of a part of a cloud may have no more points.
    } while (extensible(result, found) && found > before);
    return result;
  }

  /// Intersection of confidence intervals; neighbourhoods that are thin are passed over. Neighbours
  /// come by ascending distance, so that each size is a continuation of the one before.
  Result of_best_size(std::size_t i, std::span<const Neighbor> neighbors) const {
    struct Candidate {
      Vec3d normal;
      double error;
    };
    constexpr std::size_t kMostSizes = 40;  // sqrt(2)^40 > 65535.
    std::array<Candidate, kMostSizes> smaller;
    std::size_t count = 0;
    double noise = std::numeric_limits<double>::infinity();
    Result best;
    Moments moments;
    std::size_t added = 0;
    for (const std::size_t size : sizes_) {
      for (; added < std::min(size, neighbors.size()); ++added) {
        moments.add(offset(i, neighbors[added]));
      }
      const Result result = classified(i, moments);
      if (result.flag == PointFlag::kGood) {
        // A larger neighbourhood adds curvature and edges to the distances, but no noise.
        noise = std::min(noise, result.plane.noise());
        const Candidate candidate{result.plane.normal, result.plane.error(noise)};
        const bool agrees = std::all_of(
            smaller.begin(), smaller.begin() + static_cast<std::ptrdiff_t>(count),
            [&](const Candidate& other) {
              const double sine = candidate.normal.cross(other.normal).norm();
              return sine <= kIntervalErrors * (candidate.error + other.error) + kSameAngle;
            });
        if (!agrees) break;
        smaller[count++] = candidate;
      }
      if (result.flag == PointFlag::kGood || count == 0) best = result;
      if (added == neighbors.size()) break;
    }
    return best;
  }

 private:
  Vec3d offset(std::size_t i, const Neighbor& neighbor) const {
    return points_[neighbor.index].cast<double>() - points_[i].cast<double>();
  }

  /// Extents below the rounding of the coordinates are not the points' own.
  double least_variance(std::size_t i) const {
    const double rounding = 0x1p-24 * static_cast<double>(points_[i].cwiseAbs().maxCoeff());
    return rounding * rounding;
  }

  Result classified(std::size_t i, const Moments& moments) const {
    if (const auto flag = planeless(i, moments)) {
      return {*flag, static_cast<std::size_t>(moments.n), {}};
    }
    return of_plane(i, plane_of(moments));
  }

  const Array<Vec3f>& points_;
  const NeighborSearch& search_;
  std::vector<std::size_t> sizes_;  ///< Ascending.
};

void store(const Result& result, std::size_t i, NormalEstimate& out) {
  out.normal[i] = Vec3f(0, 0, 0);
  NormalQuality& quality = out.quality[i];
  quality = {0, 0, static_cast<std::uint16_t>(result.neighbors), result.flag};
  if (result.flag != PointFlag::kGood && result.flag != PointFlag::kThin) return;
  const Plane& plane = result.plane;
  out.normal[i] = with_fixed_side(plane.normal);
  quality.curvature = static_cast<float>(plane.variation());
  quality.confidence = static_cast<float>(std::max(0.0, 1 - plane.error(plane.noise())));
}

}  // namespace

std::vector<std::string> NormalOptions::problems() const {
  std::vector<std::string> out;
  const auto check = [&](const char* name, int value, int least, int most) {
    check_option(out, value >= least && value <= most, name, value,
                 fmt::format("{} to {}", least, most));
  };
  check("k", k, 3, kMostNeighbors);
  check("k_max", k_max, 4, kMostNeighbors);
  if (k_max >= 4 && k_max <= kMostNeighbors) check("k_min", k_min, 4, k_max);
  check_option(out, radius >= 0 && std::isfinite(radius), "radius", radius,
               "above 0, or 0 for none");
  if (adaptive && radius > 0) {
    out.emplace_back("`radius` and an adaptive number of neighbours exclude each other");
  }
  return out;
}

NormalEstimate estimate_normals(const Array<Vec3f>& points, const NeighborSearch& search,
                                const NormalOptions& options) {
  require_usable(options);
  const std::size_t n = points.size();
  if (search.size() != n) {
    throw_usage("the neighbour search has " + std::to_string(search.size()) +
                " points, the cloud " + std::to_string(n));
  }
  NormalEstimate out;
  out.normal.resize(n);
  out.quality.resize(n);

  struct Worker {
    std::vector<Neighbor> scratch;
    std::array<std::size_t, kPointFlags> flagged{};
    std::size_t neighbors = 0;
    std::size_t extended = 0;
    // Neighbourhoods whose planes are fitted together.
    PlaneBatch planes;
    std::array<std::size_t, PlaneBatch::kSize> point{}, found{};
    std::size_t pending = 0;
  };
  PerWorker<Worker> workers;
  const Estimator estimator(points, search, options);
  const bool by_radius = options.radius > 0;
  const auto finish = [&](std::size_t i, std::size_t found, Result result, Worker& w) {
    if (!by_radius && estimator.extensible(result, found)) {
      result = estimator.extended(i, found, w.scratch);
      ++w.extended;
    }
    store(result, i, out);
    w.neighbors += result.neighbors;
    ++w.flagged[static_cast<std::size_t>(result.flag)];
  };
  const auto fit_pending = [&](Worker& w) {
    fit_planes(w.pending, w.planes);
    for (std::size_t k = 0; k < w.pending; ++k) {
      const auto size = static_cast<double>(w.found[k]);
      finish(w.point[k], w.found[k], estimator.of_plane(w.point[k], plane_of(w.planes, k, size)),
             w);
    }
    w.pending = 0;
  };
  const auto body = [&](std::size_t i, std::span<const Neighbor> neighbors, int worker) {
    Worker& w = workers[worker];
    if (options.adaptive) {
      finish(i, neighbors.size(), estimator.of_best_size(i, neighbors), w);
      return;
    }
    const Moments moments = estimator.moments(i, neighbors);
    if (const auto flag = estimator.planeless(i, moments)) {
      finish(i, neighbors.size(), {*flag, neighbors.size(), {}}, w);
      return;
    }
    moments.store(w.pending, w.planes);
    w.point[w.pending] = i;
    w.found[w.pending++] = neighbors.size();
    if (w.pending == PlaneBatch::kSize) fit_pending(w);
  };
  if (by_radius) {
    search.for_each_within(static_cast<float>(options.radius), kMostNeighbors, body);
  } else {
    search.for_each_nearest(static_cast<std::size_t>(options.adaptive ? options.k_max : options.k),
                            body);
  }
  workers.for_each([&](Worker& w) {
    fit_pending(w);
    for (std::size_t f = 0; f < kPointFlags; ++f) out.flagged[f] += w.flagged[f];
    out.neighbors += w.neighbors;
    out.extended += w.extended;
  });
  if (options.grow_in_noise && !by_radius) {
    remake_noisy_normals(points, search, options.sensor, out);
  }
  return out;
}

}  // namespace surfel
