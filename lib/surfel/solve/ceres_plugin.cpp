// Plug-in libsurfel_ceres.so: the one place that sees Ceres.
//
// Agarwal, Mierle et al., Ceres Solver (trust region with exact steps; L-BFGS).
// Triggs, McLauchlan, Hartley, Fitzgibbon 1999, "Bundle adjustment: a modern synthesis", 4.3 (how
// Ceres turns a loss into least squares).

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <ceres/ceres.h>
#include <ceres/rotation.h>
#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/export.h>
#include <surfel/base/parallel.h>
#include <surfel/solve/ceres_plugin.h>

namespace surfel {
namespace {

/// Unknown blocks up to which steps are solved exactly. Beyond, what the factor takes of time and
/// memory grows faster than the system, and conjugate gradients on the normal equations do.
constexpr std::size_t kMostFactorised = 20000;

/// residual_c = sum_i value_i w_ic - f_c.
class Row final : public ceres::CostFunction {
 public:
  Row(const double* value, std::size_t entries, const double* f, int channels)
      : value_(value), f_(f), channels_(channels) {
    set_num_residuals(channels);
    mutable_parameter_block_sizes()->assign(entries, channels);
  }

  bool Evaluate(const double* const* w, double* residuals, double** jacobians) const override {
    const std::size_t entries = parameter_block_sizes().size();
    for (int c = 0; c < channels_; ++c) {
      double sum = -f_[c];
      for (std::size_t i = 0; i < entries; ++i) sum += value_[i] * w[i][c];
      residuals[c] = sum;
    }
    if (!jacobians) return true;
    for (std::size_t i = 0; i < entries; ++i) {
      if (!jacobians[i]) continue;
      std::fill_n(jacobians[i], channels_ * channels_, 0.0);
      for (int c = 0; c < channels_; ++c) {
        jacobians[i][c * (channels_ + 1)] = value_[i];
      }
    }
    return true;
  }

 private:
  const double* value_;
  const double* f_;
  int channels_;
};

class StopWhenAsked final : public ceres::IterationCallback {
 public:
  ceres::CallbackReturnType operator()(const ceres::IterationSummary& /*summary*/) override {
    return interrupt_requested() ? ceres::SOLVER_ABORT : ceres::SOLVER_CONTINUE;
  }
};

void require_usable(bool usable, const std::string& message) {
  if (interrupt_requested()) throw Error(ErrorKind::kInterrupted, "interrupted");
  if (!usable) throw Error(ErrorKind::kNumeric, "Ceres failed: " + message);
}

/// Solves, and throws where that fails or is interrupted.
ceres::Solver::Summary solve_on_one_thread(ceres::Solver::Options options,
                                           ceres::Problem& problem) {
  // Debian's build has SuiteSparse, parts of which are under the GPL: only Eigen's factorisation
  // may be called.
  options.sparse_linear_algebra_library_type = ceres::EIGEN_SPARSE;
  // Threads would add up the gradient in the order in which they come.
  options.num_threads = 1;
  options.logging_type = ceres::SILENT;
  StopWhenAsked stop;
  options.callbacks.push_back(&stop);
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  require_usable(summary.IsSolutionUsable(), summary.message);
  return summary;
}

/// `channels` of the unknowns together, from channel `first` on.
void solve(const CeresLeastSquares& p, int first, int channels, CeresReport& report) {
  ceres::Problem::Options ownership;
  ownership.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ownership.disable_all_safety_checks = true;
  std::vector<std::unique_ptr<ceres::LossFunction>> losses;
  ceres::Problem problem(ownership);
  std::vector<double*> blocks;
  const auto unknown = [&](std::size_t k) { return p.w + k * p.stride + first; };
  // In their own order, so that the factor's does not hang on addresses.
  for (std::size_t k = 0; k < p.columns; ++k) problem.AddParameterBlock(unknown(k), channels);
  for (const CeresTerm* term = p.term; term != p.term + p.terms; ++term) {
    // The weight outside of the loss, whose scale is that of the colours.
    losses.push_back(std::make_unique<ceres::ScaledLoss>(
        term->huber > 0 ? new ceres::HuberLoss(term->huber) : nullptr, term->weight,
        ceres::TAKE_OWNERSHIP));
    for (std::size_t q = 0; q < term->rows; ++q) {
      const std::uint64_t begin = term->row_begin[q];
      const std::uint64_t end = term->row_begin[q + 1];
      if (begin == end) continue;
      blocks.clear();
      for (std::uint64_t e = begin; e < end; ++e) blocks.push_back(unknown(term->column[e]));
      problem.AddResidualBlock(
          new Row(term->value + begin, end - begin, term->f + q * p.stride + first, channels),
          losses.back().get(), blocks);
    }
  }

  ceres::Solver::Options options;
  options.linear_solver_type =
      p.columns <= kMostFactorised ? ceres::SPARSE_NORMAL_CHOLESKY : ceres::CGNR;
  options.preconditioner_type = ceres::JACOBI;
  options.max_linear_solver_iterations = 2000;
  options.eta = std::clamp(p.tolerance, 1e-12, 1e-2);
  // The problem is convex: full Gauss-Newton steps. What rounding takes from one the next restores.
  options.initial_trust_region_radius = 1e16;
  options.max_trust_region_radius = 1e32;
  options.max_num_iterations = p.max_iterations;
  options.parameter_tolerance = p.tolerance;
  options.function_tolerance = 0.01 * p.tolerance * p.tolerance;
  options.gradient_tolerance = 0;
  const ceres::Solver::Summary summary = solve_on_one_thread(std::move(options), problem);
  report.iterations = std::max(report.iterations, static_cast<int>(summary.iterations.size()) - 1);
  report.cost += 2 * summary.final_cost;
  report.converged = report.converged && summary.termination_type == ceres::CONVERGENCE;
}

class SmoothFunction final : public ceres::FirstOrderFunction {
 public:
  explicit SmoothFunction(const CeresMinimization& p) : p_(p) {}

  bool Evaluate(const double* x, double* cost, double* gradient) const override {
    return p_.evaluate(p_.self, x, cost, gradient);
  }
  int NumParameters() const override { return static_cast<int>(p_.size); }

 private:
  const CeresMinimization& p_;
};

/// Distance of a moved point from a moved plane.
struct PlaneDistance {
  const PlaneMatch& match;

  template <class T>
  bool operator()(const T* moving, const T* fixed, T* residual) const {
    T point[3];
    T on_plane[3];
    T normal[3];
    move(moving, match.point, point);
    move(fixed, match.on_plane, on_plane);
    const T still[3] = {T(match.normal[0]), T(match.normal[1]), T(match.normal[2])};
    ceres::AngleAxisRotatePoint(fixed, still, normal);
    residual[0] = T(0);
    for (int c = 0; c < 3; ++c) residual[0] += normal[c] * (point[c] - on_plane[c]);
    return true;
  }

 private:
  template <class T>
  static void move(const T* motion, const double* from, T* to) {
    const T still[3] = {T(from[0]), T(from[1]), T(from[2])};
    ceres::AngleAxisRotatePoint(motion, still, to);
    for (int c = 0; c < 3; ++c) to[c] += motion[3 + c];
  }
};

void move_bodies(const CeresBodies& p, CeresReport& report) {
  ceres::CauchyLoss loss(p.scale);
  ceres::Problem::Options ownership;
  ownership.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem problem(ownership);
  const auto unknown = [&](std::size_t k) { return p.motion[k].value; };
  for (std::size_t k = 0; k < p.bodies; ++k) problem.AddParameterBlock(unknown(k), 6);
  problem.SetParameterBlockConstant(unknown(0));
  for (std::size_t m = 0; m < p.matches; ++m) {
    const PlaneMatch& match = p.match[m];
    problem.AddResidualBlock(
        new ceres::AutoDiffCostFunction<PlaneDistance, 1, 6, 6>(new PlaneDistance{match}), &loss,
        unknown(match.moving), unknown(match.fixed));
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.max_num_iterations = p.max_iterations;
  const ceres::Solver::Summary summary = solve_on_one_thread(std::move(options), problem);
  report.iterations = std::max(0, static_cast<int>(summary.iterations.size()) - 1);
  report.cost = 2 * summary.final_cost;
  report.converged = summary.termination_type == ceres::CONVERGENCE;
}

}  // namespace
}  // namespace surfel

extern "C" SURFEL_API void surfel_ceres_least_squares(const surfel::CeresLeastSquares& problem,
                                                      surfel::CeresReport& report);
extern "C" SURFEL_API void surfel_ceres_minimize(const surfel::CeresMinimization& problem,
                                                 surfel::CeresReport& report);
extern "C" SURFEL_API surfel::CeresMoveBodies surfel_ceres_move_bodies;

extern "C" void surfel_ceres_least_squares(const surfel::CeresLeastSquares& problem,
                                           surfel::CeresReport& report) {
  if (problem.columns == 0) return;
  // Without a loss the channels have nothing to do with each other, and small systems are faster.
  const bool loss = std::any_of(problem.term, problem.term + problem.terms,
                                [](const surfel::CeresTerm& term) { return term.huber > 0; });
  const int together = loss ? problem.channels : 1;
  for (int first = 0; first < problem.channels; first += together) {
    surfel::solve(problem, first, together, report);
  }
}

extern "C" void surfel_ceres_minimize(const surfel::CeresMinimization& problem,
                                      surfel::CeresReport& report) {
  ceres::GradientProblemSolver::Options options;
  options.line_search_direction_type = ceres::LBFGS;
  options.max_lbfgs_rank = 10;
  options.max_num_iterations = problem.max_iterations;
  options.function_tolerance = problem.tolerance;
  options.gradient_tolerance = 0;
  options.parameter_tolerance = 0;
  options.logging_type = ceres::SILENT;
  surfel::StopWhenAsked stop;
  options.callbacks.push_back(&stop);
  const ceres::GradientProblem function(new surfel::SmoothFunction(problem));
  ceres::GradientProblemSolver::Summary summary;
  ceres::Solve(options, function, problem.x, &summary);
  // A line search that gains nothing more has arrived at what rounding allows.
  surfel::require_usable(
      std::isfinite(summary.final_cost) && summary.termination_type != ceres::USER_FAILURE,
      summary.message);
  report.iterations = std::max(0, static_cast<int>(summary.iterations.size()) - 1);
  report.cost = summary.final_cost;
  report.converged = summary.termination_type == ceres::CONVERGENCE;
}

extern "C" void surfel_ceres_move_bodies(const surfel::CeresBodies& problem,
                                         surfel::CeresReport& report) {
  surfel::move_bodies(problem, report);
}
