// Huber 1964, "Robust estimation of a location parameter".
// Holland, Welsch 1977, "Robust regression using iteratively reweighted least-squares".

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include <surfel/base/median.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/solve/ceres_solver.h>
#include <surfel/solve/conjugate_gradients.h>
#include <surfel/solve/symmetric_product.h>
#include <surfel/texture/robust_fit.h>

namespace surfel {
namespace {

/// An unset scale, by the median length of the residuals.
constexpr double kScaleByMedian = 2;
/// Rounds after which an unset scale stands: each bends the fit less towards outliers.
constexpr int kScaleRounds = 2;
/// Reach of the medians about colour samples, whatever the renderer's cutoff: some ten neighbours.
constexpr double kMedianCutoff = 4;
/// Rounds after which a fit that has not come to rest is reported as such: fits to textures with
/// outliers take 10 to 40.
constexpr int kMostRobustRounds = 100;
constexpr std::size_t kMedianGrain = 1 << 11;

double length(const Channels& r) { return std::sqrt(r.square().sum()); }

double huber(double r, double scale) { return r <= scale ? r * r : 2 * scale * r - scale * scale; }

Array<double> lengths(const Array<Channels>& r) {
  Array<double> result(r.size());
  for (std::size_t i = 0; i < r.size(); ++i) result[i] = length(r[i]);
  return result;
}

Array<double> weights(const Array<double>& length, double scale) {
  Array<double> result(length.size());
  std::transform(length.begin(), length.end(), result.begin(),
                 [&](double r) { return r <= scale ? 1 : scale / r; });
  return result;
}

/// Diagonal matrix of the square roots of the pull's weights.
SparseMatrix pull_matrix(const RenderSystem& system, std::size_t size) {
  SparseMatrix matrix;
  matrix.columns = size;
  matrix.row_begin.resize(size + 1);
  std::iota(matrix.row_begin.begin(), matrix.row_begin.end(), std::uint64_t{0});
  matrix.column.resize(size);
  std::iota(matrix.column.begin(), matrix.column.end(), 0U);
  matrix.value.resize(size);
  for (std::size_t k = 0; k < size; ++k) matrix.value[k] = std::sqrt(system.pull(k));
  return matrix;
}

bool covered(const RenderSystem& system, std::size_t q) {
  return system.near.A.row_begin[q] < system.near.A.row_begin[q + 1];
}

double scale_of(std::vector<double> found) {
  if (found.empty()) return kLeastRobustScale;
  return std::max(kLeastRobustScale, kScaleByMedian * median(found));
}

double estimate_scale(const RenderSystem& system, const Array<double>& residual) {
  std::vector<double> found;
  found.reserve(residual.size());
  for (std::size_t q = 0; q < residual.size(); ++q) {
    if (covered(system, q)) found.push_back(residual[q]);
  }
  return scale_of(std::move(found));
}

/// Rounds of iteratively reweighted least squares on one system.
class Rounds {
 public:
  Rounds(const RenderSystem& system, const FitTarget& target, const RobustOptions& options)
      : system_(system), target_(target), options_(options) {
    require_usable(options);
  }

  Array<double> residual_lengths(const Array<Channels>& w) const {
    return lengths(system_.near.residuals(w, target_.f));
  }

  /// Solves the system with the weights of `w`. \return the change of w, relative to it.
  double run(double scale, const Array<double>& residual, Array<Channels>& w,
             RobustReport& report) const {
    const Array<double> weight = weights(residual, scale);
    const SymmetricMatrix matrix = system_.weighted_normal_matrix(weight);
    const InverseFactor factor(matrix);
    const Array<Channels> before = w;
    SolveOptions solve;
    solve.tolerance = options_.tolerance;
    const SolveReport solved = conjugate_gradients(matrix, right_side(weight), factor, w, solve);
    ++report.rounds;
    report.iterations += solved.iterations;
    report.converged = solved.converged && !solved.indefinite;
    double change2 = 0;
    double norm2 = 0;
    for (std::size_t k = 0; k < w.size(); ++k) {
      change2 += (w[k] - before[k]).square().sum();
      norm2 += w[k].square().sum();
    }
    return norm2 > 0 ? std::sqrt(change2 / norm2) : 0;
  }

  /// Estimates the scale from rounds on from w, unless it is set.
  double scale(Array<Channels>& w, RobustReport& report) const {
    if (options_.scale) return *options_.scale;
    for (int round = 0;; ++round) {
      const Array<double> residual = residual_lengths(w);
      const double scale = estimate_scale(system_, residual);
      if (round == kScaleRounds) return scale;
      run(scale, residual, w, report);
    }
  }

  void finish(const Array<Channels>& w, RobustReport& report) const {
    const Array<double> residual = residual_lengths(w);
    report.down_weighted = static_cast<std::size_t>(std::count_if(
        residual.begin(), residual.end(), [&](double r) { return r > report.scale; }));
    report.cost = robust_cost(system_, target_, w, report.scale);
    // The gradient of the cost, by the right side of the system that it belongs to.
    const Array<double> weight = weights(residual, report.scale);
    report.residual =
        relative_residual(system_.weighted_normal_matrix(weight), right_side(weight), w);
  }

 private:
  /// The right side of the system with these weights.
  Array<Channels> right_side(const Array<double>& weight) const {
    Array<Channels> weighted(weight.size());
    for (std::size_t q = 0; q < weight.size(); ++q) weighted[q] = weight[q] * target_.f[q];
    return system_.right_side(weighted, target_.w_0);
  }

  const RenderSystem& system_;
  const FitTarget& target_;
  const RobustOptions& options_;
};

}  // namespace

std::vector<std::string> RobustOptions::problems() const {
  std::vector<std::string> found;
  if (scale) check_positive(found, "scale", *scale);
  check_option(found, tolerance > 0 && tolerance < 1, "tolerance", tolerance, "in (0, 1)");
  return found;
}

double robust_cost(const RenderSystem& system, const FitTarget& target, const Array<Channels>& w,
                   double scale) {
  double points = 0;
  for (const Channels& r : system.near.residuals(w, target.f)) points += huber(length(r), scale);
  return points + system.pull2(w, target.w_0).sum();
}

RobustReport robust_fit(const RenderSystem& system, const FitTarget& target, Array<Channels>& w,
                        const RobustOptions& options) {
  RobustReport report;
  const Rounds rounds(system, target, options);
  report.scale = rounds.scale(w, report);
  double first = 0;
  double change = 0;
  do {
    change = rounds.run(report.scale, rounds.residual_lengths(w), w, report);
    if (first == 0) first = change;
    tell_decay(options.progress, first, change, options.tolerance);
  } while (change > options.tolerance && report.rounds < kMostRobustRounds);
  report.converged = report.converged && change <= options.tolerance;
  rounds.finish(w, report);
  return report;
}

RobustReport robust_fit_ceres(const RenderSystem& system, const FitTarget& target,
                              Array<Channels>& w, const RobustOptions& options) {
  RobustReport report;
  const Rounds rounds(system, target, options);
  report.scale = rounds.scale(w, report);
  const CeresReport solved = ceres_fit(system, target, report.scale, options.tolerance, w);
  report.rounds += solved.iterations;
  report.iterations = solved.iterations;
  report.converged = solved.converged;
  rounds.finish(w, report);
  return report;
}

CeresReport ceres_fit(const RenderSystem& system, const FitTarget& target, double scale,
                      double tolerance, Array<Channels>& w) {
  const SparseMatrix pull = pull_matrix(system, w.size());
  Array<Channels> pulled(w.size());
  for (std::size_t k = 0; k < w.size(); ++k) pulled[k] = pull.value[k] * target.w_0[k];
  return ceres_least_squares({{.A = system.near.A, .f = target.f, .huber = scale},
                              {.A = system.far.A, .f = target.w_0, .weight = system.mu},
                              {.A = pull, .f = pulled}},
                             target.channels, tolerance, w);
}

Array<Channels> winsorized(const SurfelBasis& basis, const Array<Channels>& sample,
                           std::optional<double> scale) {
  const SparseMatrix neighbors = kernel_exponents(basis, at_functions(basis), kMedianCutoff);
  Array<Channels> medians(sample.size());
  parallel_for(sample.size(), kMedianGrain, [&](std::size_t begin, std::size_t end, int) {
    std::vector<double> values;
    for (std::size_t k = begin; k < end; ++k) {
      for (Eigen::Index c = 0; c < 4; ++c) {
        values.clear();
        for (std::size_t e = neighbors.row_begin[k]; e < neighbors.row_begin[k + 1]; ++e) {
          values.push_back(sample[neighbors.column[e]][c]);
        }
        medians[k][c] = values.empty() ? sample[k][c] : median(values);
      }
    }
  });
  Array<double> distance(sample.size());
  for (std::size_t k = 0; k < sample.size(); ++k) distance[k] = length(sample[k] - medians[k]);
  const double most = scale.value_or(scale_of({distance.begin(), distance.end()}));
  const Array<double> kept = weights(distance, most);
  Array<Channels> result(sample.size());
  for (std::size_t k = 0; k < sample.size(); ++k) {
    result[k] = medians[k] + kept[k] * (sample[k] - medians[k]);
  }
  return result;
}

}  // namespace surfel
