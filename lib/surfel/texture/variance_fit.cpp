// Zwicker, Pfister, van Baar, Gross 2001, "Surface Splatting", equation (9): the basis.
// Nocedal, Wright 2006, "Numerical Optimization", chapters 4 (trust regions) and 7 (L-BFGS).

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/solve/ceres_solver.h>
#include <surfel/solve/inverse_factor.h>
#include <surfel/texture/variance_fit.h>

namespace surfel {
namespace {

constexpr std::size_t kFunctionGrain = 1 << 11;
/// Points that are worked on at once, and add to the gradient in one place.
constexpr std::size_t kChunkPoints = 1 << 12;
constexpr int kMostVarianceRounds = 6;  ///< A bound: rounds end by kLeastGain.
/// Range of the log-variances in the first round, and from which on no further one is made.
constexpr double kFirstRange = 0.4;
constexpr double kLeastRange = 0.1;
/// Rounds end where one gains less of the objective.
constexpr double kLeastGain = 0.01;
/// Most steps of a round, and the relative gain that ends them.
constexpr int kSteps = 30;
constexpr double kStepTolerance = 1e-4;
/// Kernels of the model fade out between (1 -+ kFade) c: half the distance of 12 points a surfel,
/// by the radius of the kernels at sigma = spacing, c = 1.
constexpr double kFade = 0.2;
/// Pull of the log-variances towards their start, by the mean of the Gauss-Newton diagonal: a
/// variance that no point depends on stays.
constexpr double kPull = 0.02;
/// Weight of missing coverage in the model, by the mean square of the residuals.
constexpr double kCoverageWeight = 100;
/// Single precision of RenderSystem::coverage.
constexpr double kCoverageTolerance = 1e-6;
/// Times that changes are halved before they are withdrawn.
constexpr int kHalvings = 4;

/// Part of the kernel that is left at beta < (1 + kFade) cutoff, and its derivative.
struct Fade {
  double value, slope;
};
Fade fade(double beta, double cutoff) {
  const double width = 2 * kFade * cutoff;
  const double x = ((1 + kFade) * cutoff - beta) / width;
  if (x >= 1) return {1, 0};
  return {x * x * (3 - 2 * x), -6 * x * (1 - x) / width};
}

double objective(const RenderSolution& s, const FitTarget& target) {
  return (s.system.near.residual2(s.w, target.f) + s.system.pull2(s.w, target.w_0)).sum();
}

/// The basis with variances e^t times as large, as single precision holds them.
SurfelBasis scaled(const SurfelBasis& basis, const Array<double>& t) {
  SurfelBasis result = basis;
  for (std::size_t k = 0; k < basis.size(); ++k) {
    if (t[k] == 0) continue;
    SurfelBasis::Function& f = result.function[k];
    f.variance_u = static_cast<double>(static_cast<float>(f.variance_u * portable::exp(t[k])));
    f.variance_v = static_cast<double>(static_cast<float>(f.variance_v * portable::exp(t[k])));
  }
  return result;
}

/// The data that all rounds have in common.
struct Problem {
  SurfelBasis start;
  const Quadrature& quadrature;
  const FitTarget& target;
  const VarianceFitOptions& options;
  Array<double> least;  ///< Coverage that every point must keep.

  std::size_t channels() const { return static_cast<std::size_t>(target.channels); }
};

/// The state that a round starts from.
struct State : RenderSolution {
  Array<double> t;  ///< Log of the factor that all rounds before gave the variances.
};

/// The smooth objective about a state, in unknowns of curvature about 2: y, w = w_state + G^T y
/// with the factor G of the normal matrix, and z, the change of t within the round's range.
class Model {
 public:
  Model(const Problem& problem, const State& state, double range)
      : problem_(problem),
        state_(state),
        cutoff_(problem.options.cutoff),
        factor_(state.system.normal_matrix),
        exponent_(kernel_exponents(state.basis, problem.quadrature,
                                   cutoff_ * (1 + kFade) * portable::exp(range))) {
    const std::size_t count = state.basis.size();
    range_.resize(count);
    const double most = 2 * portable::log(kMostSigmaChange);
    for (std::size_t k = 0; k < count; ++k) {
      range_[k] = std::max(0.0, std::min(range, most - std::abs(state.t[k])));
    }
    make_chunks();
    w_ = state.w;
    change_.assign(count, 0.0);
    set_scales();
  }

  /// \return the change of t in the minimum.
  Array<double> minimise(VarianceFitReport& report) {
    const std::size_t count = state_.basis.size();
    Array<double> x;
    x.assign(count * (problem_.channels() + 1), 0.0);
    // Where nothing changes with the variances they stay: a constant texture.
    if (pull_ == 0) return Array<double>(count, 0.0);
    int evaluations = 0;
    const auto evaluate = [&](const double* at, double* cost, double* gradient) {
      const double share = std::min(1.0, static_cast<double>(++evaluations) / kSteps);
      const auto& progress = problem_.options.progress;
      if (progress) progress((report.rounds + share) / kMostVarianceRounds);
      return this->evaluate(at, *cost, gradient);
    };
    report.iterations += ceres_minimize(x, evaluate, kStepTolerance, kSteps).iterations;
    unpack(x.data());
    return change_;
  }

  /// Halves changes, and withdraws them in the end, where coverage falls below the least.
  void hold_coverage(Array<double>& change, std::vector<char>& held) const {
    for (int round = 0;; ++round) {
      const std::vector<char> low = about_lacking(
          change, [&](const Chunk& chunk, std::size_t q) { return coverage(chunk, q, change); });
      if (low.empty()) return;
      withdraw(low, round < kHalvings ? 0.5 : 0, change, held);
    }
  }

  /// Withdraws changes about points that `system` covers less than the least. \return whether any.
  bool withdraw_uncovered(const RenderSystem& system, Array<double>& change,
                          std::vector<char>& held) const {
    const std::vector<char> low = about_lacking(change, [&](const Chunk&, std::size_t q) {
      return static_cast<double>(system.near.coverage[q]);
    });
    withdraw(low, 0, change, held);
    return !low.empty();
  }

 private:
  /// A range of points, and the functions that may reach them: exponent_.column holds places in it.
  struct Chunk {
    std::size_t begin, end;
    Array<std::uint32_t> function;
    Array<Channels> w_gradient;
    Array<double> t_gradient;
    double cost;
  };
  struct Kernel {
    double factor;  ///< e^-t.
    double peak;
    Channels w;
  };
  struct Value {
    std::uint32_t place;  ///< Place of the function k in the chunk.
    double r, slope;      ///< r_k(u_q), and its derivative by t.
  };
  struct Worker {
    std::vector<Kernel> kernels;
    std::vector<Value> values;
  };

  void make_chunks() {
    const std::size_t points = exponent_.rows();
    chunks_.resize((points + kChunkPoints - 1) / kChunkPoints);
    parallel_for(chunks_.size(), 1, [&](std::size_t begin, std::size_t end, int) {
      for (std::size_t c = begin; c < end; ++c) {
        Chunk& chunk = chunks_[c];
        chunk.begin = c * kChunkPoints;
        chunk.end = std::min(points, chunk.begin + kChunkPoints);
        const auto first = exponent_.column.begin();
        const auto from = first + static_cast<std::ptrdiff_t>(exponent_.row_begin[chunk.begin]);
        const auto to = first + static_cast<std::ptrdiff_t>(exponent_.row_begin[chunk.end]);
        chunk.function.assign(from, to);
        std::sort(chunk.function.begin(), chunk.function.end());
        chunk.function.erase(std::unique(chunk.function.begin(), chunk.function.end()),
                             chunk.function.end());
        chunk.function.shrink_to_fit();
        std::for_each(from, to, [&](std::uint32_t& column) {
          column = static_cast<std::uint32_t>(
              std::lower_bound(chunk.function.begin(), chunk.function.end(), column) -
              chunk.function.begin());
        });
      }
    });
  }

  /// Scales of z from the diagonal of the Gauss-Newton matrix, and the weights that hang on it.
  void set_scales() {
    const std::size_t count = state_.basis.size();
    scale_.assign(count, 1.0);
    Array<double> diagonal;
    diagonal.assign(count, 0.0);
    visit_points([&](Chunk& chunk, Worker& worker, const auto& point) {
      for (const auto& [l, r, slope] : worker.values) {
        const Channels by_t = slope / point.sum * (worker.kernels[l].w - point.p);
        chunk.t_gradient[l] += by_t.square().sum();
      }
      chunk.cost += point.residual.square().sum();
    });
    double total = 0;
    double squares = 0;
    for (const Chunk& chunk : chunks_) {
      squares += chunk.cost;
      for (std::size_t l = 0; l < chunk.function.size(); ++l) {
        diagonal[chunk.function[l]] += chunk.t_gradient[l];
        total += chunk.t_gradient[l];
      }
    }
    const double points = static_cast<double>(std::max<std::size_t>(1, exponent_.rows()));
    coverage_weight_ = kCoverageWeight * squares / points;
    pull_ = kPull * total / static_cast<double>(std::max<std::size_t>(1, count));
    // Rounding of a constant texture is no reason to change anything.
    if (!(squares > 1e-12 * points)) pull_ = 0;
    if (pull_ == 0) return;
    for (std::size_t k = 0; k < count; ++k) scale_[k] = 1 / std::sqrt(diagonal[k] + pull_);
  }

  /// The model's colour at a point.
  struct Point {
    double sum;
    Channels p, residual;
    double missing;  ///< Coverage.
  };

  /// Sets the chunks' sums to zero, and calls body(chunk, worker, point) for the points of each.
  template <class Body>
  void visit_points(const Body& body) {
    parallel_for(chunks_.size(), 1, [&](std::size_t begin, std::size_t end, int w) {
      Worker& worker = workers_[w];
      for (std::size_t c = begin; c < end; ++c) {
        Chunk& chunk = chunks_[c];
        chunk.w_gradient.assign(chunk.function.size(), Channels::Zero());
        chunk.t_gradient.assign(chunk.function.size(), 0.0);
        chunk.cost = 0;
        worker.kernels.clear();
        for (const std::uint32_t k : chunk.function) {
          const double factor = portable::exp(-change_[k]);
          worker.kernels.push_back({factor, factor * state_.basis.function[k].peak(), w_[k]});
        }
        for (std::size_t q = chunk.begin; q < chunk.end; ++q) {
          Point point;
          if (see(q, worker, point)) body(chunk, worker, point);
        }
      }
    });
  }

  /// Evaluates (9) at a point. \return false where no function reaches it.
  bool see(std::size_t q, Worker& worker, Point& point) const {
    const double end = (1 + kFade) * cutoff_;
    point.sum = 0;
    point.p.setZero();
    worker.values.clear();
    for (std::size_t e = exponent_.row_begin[q]; e < exponent_.row_begin[q + 1]; ++e) {
      const std::uint32_t place = exponent_.column[e];
      const Kernel& kernel = worker.kernels[place];
      const double beta = exponent_.value[e] * kernel.factor;
      if (beta >= end) continue;
      const Fade left = fade(beta, cutoff_);
      const double whole = kernel.peak * portable::exp(-beta);
      const double r = whole * left.value;
      worker.values.push_back({place, r, (beta - 1) * r - beta * whole * left.slope});
      point.sum += r;
      point.p += r * kernel.w;
    }
    if (!(point.sum > 0)) return false;
    point.p /= point.sum;
    point.residual = point.p - problem_.target.f[q];
    point.missing = std::max(0.0, problem_.least[q] - point.sum);
    return true;
  }

  /// Sets w_ and change_.
  void unpack(const double* x) {
    const std::size_t channels = problem_.channels();
    const std::size_t count = state_.basis.size();
    y_.resize(count);
    product_.resize(count);
    const double* z = x + count * channels;
    for (std::size_t k = 0; k < count; ++k) {
      y_[k].setZero();
      for (std::size_t c = 0; c < channels; ++c) {
        y_[k][static_cast<Eigen::Index>(c)] = static_cast<float>(x[k * channels + c]);
      }
      change_[k] = range_[k] > 0 ? range_[k] * portable::tanh(scale_[k] * z[k] / range_[k]) : 0;
    }
    parallel_for(count, kFunctionGrain, [&](std::size_t begin, std::size_t end, int) {
      factor_.multiply_transposed(begin, end, y_.data(), product_.data() + begin);
      for (std::size_t k = begin; k < end; ++k) w_[k] = state_.w[k] + product_[k].cast<double>();
    });
  }

  bool evaluate(const double* x, double& cost, double* gradient) {
    unpack(x);
    visit_points([&](Chunk& chunk, Worker& worker, const Point& point) {
      chunk.cost +=
          point.residual.square().sum() + coverage_weight_ * point.missing * point.missing;
      const Channels twice = 2 / point.sum * point.residual;
      const double push = -2 * coverage_weight_ * point.missing;
      for (const auto& [l, r, slope] : worker.values) {
        chunk.w_gradient[l] += r * twice;
        chunk.t_gradient[l] += slope * ((twice * (worker.kernels[l].w - point.p)).sum() + push);
      }
    });
    cost = 0;
    for (const Chunk& chunk : chunks_) cost += chunk.cost;
    const std::size_t count = state_.basis.size();
    for (std::size_t k = 0; k < count; ++k) {
      const double t = state_.t[k] + change_[k];
      cost +=
          state_.system.lambda * (w_[k] - problem_.target.w_0[k]).square().sum() + pull_ * t * t;
    }
    if (gradient) set_gradient(x, gradient);
    return std::isfinite(cost);
  }

  void set_gradient(const double* x, double* gradient) {
    const std::size_t channels = problem_.channels();
    const std::size_t count = state_.basis.size();
    w_gradient_.resize(count);
    t_gradient_.resize(count);
    for (std::size_t k = 0; k < count; ++k) {
      w_gradient_[k] = 2 * state_.system.lambda * (w_[k] - problem_.target.w_0[k]);
      t_gradient_[k] = 2 * pull_ * (state_.t[k] + change_[k]);
    }
    for (const Chunk& chunk : chunks_) {
      for (std::size_t l = 0; l < chunk.function.size(); ++l) {
        w_gradient_[chunk.function[l]] += chunk.w_gradient[l];
        t_gradient_[chunk.function[l]] += chunk.t_gradient[l];
      }
    }
    for (std::size_t k = 0; k < count; ++k) y_[k] = w_gradient_[k].cast<float>();
    parallel_for(count, kFunctionGrain, [&](std::size_t begin, std::size_t end, int) {
      factor_.multiply(begin, end, y_.data(), product_.data() + begin);
    });
    const double* z = x + count * channels;
    for (std::size_t k = 0; k < count; ++k) {
      for (std::size_t c = 0; c < channels; ++c) {
        gradient[k * channels + c] = static_cast<double>(product_[k][static_cast<Eigen::Index>(c)]);
      }
      const double tanh = range_[k] > 0 ? portable::tanh(scale_[k] * z[k] / range_[k]) : 1;
      gradient[count * channels + k] = t_gradient_[k] * scale_[k] * (1 - tanh * tanh);
    }
  }

  /// The kernels' sum as the renderer has it, ending at beta = c.
  double coverage(const Chunk& chunk, std::size_t q, const Array<double>& change) const {
    double sum = 0;
    for (std::size_t e = exponent_.row_begin[q]; e < exponent_.row_begin[q + 1]; ++e) {
      const std::uint32_t k = chunk.function[exponent_.column[e]];
      const double factor = portable::exp(-change[k]);
      const double beta = exponent_.value[e] * factor;
      if (beta < cutoff_) {
        sum += factor * state_.basis.function[k].peak() * portable::exp(-beta);
      }
    }
    return sum;
  }

  /// Marks the changed functions about points whose coverage, coverage_of(chunk, q), is below the
  /// least; empty where there are none.
  template <class Coverage>
  std::vector<char> about_lacking(const Array<double>& change, const Coverage& coverage_of) const {
    std::vector<char> low(change.size(), 0);
    bool any = false;
    for (const Chunk& chunk : chunks_) {
      for (std::size_t q = chunk.begin; q < chunk.end; ++q) {
        if (coverage_of(chunk, q) >= (1 - kCoverageTolerance) * problem_.least[q]) continue;
        for (std::size_t e = exponent_.row_begin[q]; e < exponent_.row_begin[q + 1]; ++e) {
          const std::uint32_t k = chunk.function[exponent_.column[e]];
          if (change[k] == 0) continue;
          low[k] = 1;
          any = true;
        }
      }
    }
    if (!any) low.clear();
    return low;
  }

  static void withdraw(const std::vector<char>& low, double keep, Array<double>& change,
                       std::vector<char>& held) {
    for (std::size_t k = 0; k < low.size(); ++k) {
      if (low[k] == 0) continue;
      change[k] *= keep;
      held[k] = 1;
    }
  }

  const Problem& problem_;
  const State& state_;
  const double cutoff_;
  InverseFactor factor_;
  SparseMatrix exponent_;  ///< beta of the state's variances; columns are places in the chunks.
  std::vector<Chunk> chunks_;
  PerWorker<Worker> workers_;
  Array<double> range_, scale_;
  double pull_ = 0;
  double coverage_weight_ = 0;
  Array<Channels> w_, w_gradient_;
  Array<double> change_, t_gradient_;
  Array<ChannelsF> y_, product_;
};

/// A round's outcome: the candidate's state, with the changes that coverage allows.
State candidate(const Problem& problem, const State& state, const Model& model,
                Array<double> change, std::vector<char>& held) {
  State next;
  model.hold_coverage(change, held);
  do {
    next.t = state.t;
    for (std::size_t k = 0; k < change.size(); ++k) next.t[k] += change[k];
    next.basis = scaled(problem.start, next.t);
    next.system = assemble_render_system(
        next.basis, problem.quadrature,
        {.cutoff = problem.options.cutoff, .minified = 0, .lambda = state.system.lambda});
  } while (model.withdraw_uncovered(next.system, change, held));
  return next;
}

}  // namespace

std::vector<std::string> VarianceFitOptions::problems() const {
  std::vector<std::string> found;
  check_positive(found, "cutoff", cutoff);
  if (!(coverage >= 0 && std::isfinite(coverage))) {
    found.push_back(fmt::format("`coverage` is {}; it must not be negative", coverage));
  }
  return found;
}

VarianceFitReport refine_variance(
    RenderSolution& solution, const Quadrature& quadrature, const FitTarget& target,
    FunctionRef<void(const RenderSystem& system, Array<Channels>& w)> solve,
    const VarianceFitOptions& options) {
  require_usable(options);
  if (solution.system.mu != 0)
    throw_usage("variances are fitted to systems without a minified term");
  VarianceFitReport report;
  Problem problem{solution.basis, quadrature, target, options, {}};
  for (const float coverage : solution.system.near.coverage) {
    problem.least.push_back(std::min(options.coverage, static_cast<double>(coverage)));
  }
  const SurfelBasis& start = problem.start;
  State state{std::move(solution), Array<double>(start.size(), 0.0)};
  report.objective_start = objective(state, target);
  report.objective = report.objective_start;
  std::vector<char> held(start.size(), 0);
  double range = kFirstRange;
  while (report.rounds < kMostVarianceRounds && range >= kLeastRange) {
    Model model(problem, state, range);
    std::vector<char> held_now = held;
    const Array<double> change = model.minimise(report);
    ++report.rounds;
    State next = candidate(problem, state, model, change, held_now);
    next.w = state.w;
    solve(next.system, next.w);
    const double reached = objective(next, target);
    if (!(reached < report.objective)) {
      range /= 2;
      continue;
    }
    const double gain = 1 - reached / report.objective;
    report.objective = reached;
    ++report.accepted;
    held = std::move(held_now);
    state = std::move(next);
    if (gain < kLeastGain) break;
  }
  report.held = static_cast<std::size_t>(std::count(held.begin(), held.end(), 1));
  for (std::size_t k = 0; k < start.size(); ++k) {
    const double ratio =
        std::sqrt(state.basis.function[k].variance_u / start.function[k].variance_u);
    report.sigma_min = std::min(report.sigma_min, ratio);
    report.sigma_max = std::max(report.sigma_max, ratio);
  }
  solution = std::move(state);
  return report;
}

}  // namespace surfel
