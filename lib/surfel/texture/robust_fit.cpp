// Huber 1964, "Robust estimation of a location parameter".
// Holland, Welsch 1977, "Robust regression using iteratively reweighted least-squares".

#include <algorithm>
#include <cmath>
#include <utility>

#include <surfel/base/parallel.h>
#include <surfel/solve/ceres_solver.h>
#include <surfel/solve/conjugate_gradients.h>
#include <surfel/texture/robust_fit.h>

namespace surfel {
namespace {

/// Of an unset scale, by the median length of the residuals ...
constexpr double kScaleByMedian = 2;
/// ... which outliers have bent less after each round: the scale stands from this one on.
constexpr int kScaleRounds = 2;
/// Reach of the medians about colour samples, whatever the renderer's cutoff: some ten neighbours.
constexpr double kMedianCutoff = 4;
constexpr std::size_t kGrain = 1 << 11;

double length(const Channels& r) { return std::sqrt(r.square().sum()); }

double huber(double r, double scale) { return r <= scale ? r * r : 2 * scale * r - scale * scale; }

Array<double> lengths(const Array<Channels>& r) {
  Array<double> result(r.size());
  for (std::size_t i = 0; i < r.size(); ++i) result[i] = length(r[i]);
  return result;
}

Array<double> pull_lengths(const Array<Channels>& w, const Array<Channels>& w_0) {
  Array<double> result(w.size());
  for (std::size_t k = 0; k < w.size(); ++k) result[k] = length(w[k] - w_0[k]);
  return result;
}

Array<double> weights(const Array<double>& length, double scale) {
  Array<double> result(length.size());
  std::transform(length.begin(), length.end(), result.begin(),
                 [&](double r) { return r <= scale ? 1 : scale / r; });
  return result;
}

bool covered(const RenderSystem& system, std::size_t q) {
  return system.A.row_begin[q] < system.A.row_begin[q + 1];
}

/// Of any values but none; moves them.
double median(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
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
  Rounds(const RenderSystem& system, const Array<Channels>& f, const Array<Channels>& w_0,
         const RobustOptions& options)
      : system_(system), f_(f), w_0_(w_0), options_(options) {}

  Array<double> residual_lengths(const Array<Channels>& w) const {
    return lengths(system_.residuals(w, f_));
  }

  /// Solves the system with the weights of `w`. \return the change of w, relative to it.
  double run(double scale, const Array<double>& residual, Array<Channels>& w,
             RobustReport& report) const {
    const Array<double> point = weights(residual, scale);
    const Array<double> pull = weights(pull_lengths(w, w_0_), scale);
    const SparseMatrix matrix = system_.weighted_normal_matrix(point, pull);
    const InverseFactor factor(matrix, Preconditioner::kSparseInverse);
    const Array<Channels> before = w;
    SolveOptions solve;
    solve.tolerance = options_.tolerance;
    const SolveReport solved =
        conjugate_gradients(matrix, right_side(point, pull), factor, w, solve);
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
    report.cost = robust_cost(system_, f_, w_0_, w, report.scale);
    // The gradient of the cost, by the right side of the system that it belongs to.
    const Array<double> point = weights(residual, report.scale);
    const Array<double> pull = weights(pull_lengths(w, w_0_), report.scale);
    const Array<Channels> b = right_side(point, pull);
    Array<Channels> r = system_.residuals(w, f_);
    for (std::size_t q = 0; q < r.size(); ++q) r[q] *= point[q];
    Array<Channels> pulled(w.size());
    for (std::size_t k = 0; k < w.size(); ++k) pulled[k] = pull[k] * (w[k] - w_0_[k]);
    Channels error2 = Channels::Zero();
    Channels norm2 = Channels::Zero();
    for (const Channels& g : system_.right_side(r, pulled)) error2 += g.square();
    for (const Channels& value : b) norm2 += value.square();
    report.residual = (norm2 > 0).select(error2 / norm2, 0).sqrt().maxCoeff();
  }

 private:
  /// Of the system with these weights.
  Array<Channels> right_side(const Array<double>& point, const Array<double>& pull) const {
    Array<Channels> weighted_f(point.size());
    for (std::size_t q = 0; q < point.size(); ++q) weighted_f[q] = point[q] * f_[q];
    Array<Channels> weighted_w_0(pull.size());
    for (std::size_t k = 0; k < pull.size(); ++k) weighted_w_0[k] = pull[k] * w_0_[k];
    return system_.right_side(weighted_f, weighted_w_0);
  }

  const RenderSystem& system_;
  const Array<Channels>& f_;
  const Array<Channels>& w_0_;
  const RobustOptions& options_;
};

}  // namespace

double robust_cost(const RenderSystem& system, const Array<Channels>& f, const Array<Channels>& w_0,
                   const Array<Channels>& w, double scale) {
  double points = 0;
  for (const Channels& r : system.residuals(w, f)) points += huber(length(r), scale);
  double pulls = 0;
  for (const double r : pull_lengths(w, w_0)) pulls += huber(r, scale);
  return points + system.lambda * pulls;
}

RobustReport robust_fit(const RenderSystem& system, const Array<Channels>& f,
                        const Array<Channels>& w_0, Array<Channels>& w,
                        const RobustOptions& options) {
  RobustReport report;
  const Rounds rounds(system, f, w_0, options);
  report.scale = rounds.scale(w, report);
  double first = 0;
  double change = 0;
  do {
    change = rounds.run(report.scale, rounds.residual_lengths(w), w, report);
    if (first == 0) first = change;
    if (options.progress && change > 0 && first > options.tolerance) {
      options.progress(
          std::clamp(std::log(change / first) / std::log(options.tolerance / first), 0.0, 1.0));
    }
  } while (change > options.tolerance && report.rounds < options.max_rounds);
  report.converged = report.converged && change <= options.tolerance;
  rounds.finish(w, report);
  return report;
}

RobustReport robust_fit_ceres(const RenderSystem& system, const Array<Channels>& f,
                              const Array<Channels>& w_0, Array<Channels>& w,
                              const RobustOptions& options) {
  RobustReport report;
  const Rounds rounds(system, f, w_0, options);
  report.scale = rounds.scale(w, report);
  const CeresReport solved = ceres_least_squares({.A = system.A,
                                                  .f = f,
                                                  .w_0 = w_0,
                                                  .lambda = system.lambda,
                                                  .huber = report.scale,
                                                  .channels = options.channels},
                                                 options.tolerance, w);
  report.rounds += solved.iterations;
  report.iterations = solved.iterations;
  report.converged = solved.converged;
  rounds.finish(w, report);
  return report;
}

Array<Channels> winsorized(const SurfelBasis& basis, const Array<Channels>& sample,
                           std::optional<double> scale) {
  const SparseMatrix neighbors = kernel_exponents(basis, at_functions(basis), kMedianCutoff);
  Array<Channels> medians(sample.size());
  parallel_for(sample.size(), kGrain, [&](std::size_t begin, std::size_t end, int) {
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
  const Array<double> distance = pull_lengths(sample, medians);
  const double most = scale.value_or(scale_of({distance.begin(), distance.end()}));
  const Array<double> kept = weights(distance, most);
  Array<Channels> result(sample.size());
  for (std::size_t k = 0; k < sample.size(); ++k) {
    result[k] = medians[k] + kept[k] * (sample[k] - medians[k]);
  }
  return result;
}

}  // namespace surfel
