// Zwicker, Pfister, van Baar, Gross 2001, "Surface Splatting", section 5 and appendix A.

#include <algorithm>
#include <cmath>
#include <utility>

#include <surfel/base/parallel.h>
#include <surfel/base/stage_timer.h>
#include <surfel/scene/amplitude.h>
#include <surfel/solve/ceres_solver.h>
#include <surfel/solve/conjugate_gradients.h>
#include <surfel/solve/range_sums.h>
#include <surfel/solve/spectrum.h>
#include <surfel/solve/symmetric_product.h>
#include <surfel/texture/coefficient_fit.h>
#include <surfel/texture/gram_system.h>
#include <surfel/texture/robust_fit.h>
#include <surfel/texture/unresolved_detail.h>
#include <surfel/texture/variance_fit.h>

namespace surfel {
namespace {

/// Gram matrices are regularised down to this condition: beyond it, coefficients are some thousand
/// times as large as the colours, and single precision does not hold them.
constexpr double kMostCondition = 1e6;
/// The condition decides on lambda alone, which does not need it closely.
constexpr int kSpectrumSteps = 12;
/// R is indefinite on thin sheets and bent surfaces; its least eigenvalue was -0.55 on a mesh of
/// 5,000 surfels. The shift makes about definite what an InverseFactor is made of. So many entries
/// of a row are enough for the factor, as the condition is below 100.
constexpr double kShift = 1;
constexpr std::size_t kShiftedEntries = 16;
/// Steps by which the least eigenvalue is estimated; what they miss, kIndefiniteLambda allows for.
constexpr int kShiftedSteps = 30;
/// Lambda by the least eigenvalue of an indefinite R: the nearer to 1, the less the solution is
/// pulled to w_ewa, and the more the direction of that eigenvalue is enlarged.
constexpr double kIndefiniteLambda = 1.5;
/// An automatic lambda grows by this factor where conjugate gradients do not converge.
constexpr double kRaise = 2;
constexpr std::size_t kIntegralGrain = 1 << 12;
constexpr std::size_t kErrorGrain = 1 << 11;

Array<Channels> coefficients_of(const SurfelCloud& cloud, const SurfelBasis& basis, bool alpha) {
  Array<Channels> w(basis.size());
  for (std::size_t i = 0; i < basis.size(); ++i) {
    const std::uint32_t k = basis.surfel[i];
    w[i] << cloud.coefficient[k].cast<double>().array(),
        alpha ? static_cast<double>(cloud.alpha[k]) : 0.0;
  }
  return w;
}

void store(const Array<Channels>& w, const SurfelBasis& basis, bool alpha, SurfelCloud& cloud) {
  for (std::size_t i = 0; i < basis.size(); ++i) {
    const std::uint32_t k = basis.surfel[i];
    cloud.coefficient[k] = w[i].head<3>().matrix().cast<float>();
    if (alpha) cloud.alpha[k] = std::clamp(static_cast<float>(w[i][3]), 0.0F, 1.0F);
  }
}

void tell(const TextureFitOptions& options, double done) {
  if (options.progress) options.progress(done);
}

/// Does a function count in the report?
bool counts(const TextureFitOptions& options, const SurfelBasis& basis, std::size_t i) {
  return !options.part || options.part->owns(basis.surfel[i]);
}

std::size_t counted_functions(const TextureFitOptions& options, const SurfelBasis& basis) {
  std::size_t count = 0;
  for (std::size_t i = 0; i < basis.size(); ++i) count += counts(options, basis, i) ? 1 : 0;
  return count;
}

/// Entries in the counted functions' rows of the whole matrix.
std::size_t counted_entries(const TextureFitOptions& options, const SurfelBasis& basis,
                            const SymmetricMatrix& matrix) {
  if (!options.part) return matrix.entries();
  std::size_t count = 0;
  for (std::size_t row = 0; row < matrix.rows(); ++row) {
    const bool own = counts(options, basis, row);
    for (std::size_t e = matrix.row_begin[row]; e < matrix.row_begin[row + 1]; ++e) {
      count += own ? 1 : 0;
      count += matrix.column[e] != row && counts(options, basis, matrix.column[e]) ? 1 : 0;
    }
  }
  return count;
}

/// The progress of a stage, as a part of the whole's.
std::function<void(double)> stage(const TextureFitOptions& options, double begin, double end) {
  if (!options.progress) return {};
  return [&options, begin, end](double done) { options.progress(begin + (end - begin) * done); };
}

void note(const CeresReport& solved, SystemReport& report) {
  report.iterations = solved.iterations;
  report.converged = solved.converged;
}

/// The system matrix x = b in the first `channels` (1..4); all other channels are 0.
struct LinearSystem {
  const SymmetricMatrix& matrix;
  const Array<Channels>& b;
  const InverseFactor& factor;
  std::optional<CoefficientBounds> bounds;
  int channels;
};

/// Solves the system from x on by the options' solver.
void solve(const LinearSystem& system, const TextureFitOptions& options,
           const std::function<void(double)>& progress, Array<Channels>& x, SystemReport& report) {
  const auto& [matrix, b, factor, bounds, channels] = system;
  if (options.solver == FitSolver::kCeres) {
    note(ceres_solve(matrix, b, channels, options.tolerance, x), report);
    report.residual = relative_residual(matrix, b, x);
    return;
  }
  SolveOptions solve_options;
  solve_options.tolerance = options.tolerance;
  solve_options.bounds = bounds;
  solve_options.progress = progress;
  const SolveReport solved = conjugate_gradients(matrix, b, factor, x, solve_options);
  report.iterations = solved.iterations;
  report.residual = solved.residual;
  report.converged = solved.converged && !solved.indefinite;
}

double largest(const Array<double>& values) {
  return values.empty() ? 0 : *std::max_element(values.begin(), values.end());
}

/// Replaces R by S R S with S = mean(diag(R))^-1/2 I. \return the diagonal of S.
Array<double> scale_by_mean_diagonal(SymmetricMatrix& matrix) {
  const double mean = matrix.trace() / static_cast<double>(matrix.rows());
  for (double& value : matrix.value) value /= mean;
  return Array<double>(matrix.rows(), 1 / std::sqrt(mean));
}

/// R w = c in the coefficients x = S^-1 w: (S R S + lambda I) x = S c + lambda S^-1 w_ewa, with a
/// diagonal of 1; bounded unknowns must all be scaled alike.
class GramFit {
 public:
  /// \param gram  is scaled.
  GramFit(GramSystem& gram, const TextureFitOptions& options)
      : gram_(gram), options_(options), bounds_(options.bounds) {
    if (bounds_ && gram.matrix.rows() > 0) {
      scale_ = scale_by_mean_diagonal(gram.matrix);
      bounds_ = {bounds_->lower / scale_.front(), bounds_->upper / scale_.front()};
    } else {
      scale_ = scale_to_unit_diagonal(gram.matrix);
    }
  }

  /// Chooses lambda, where the options leave it open, and makes the preconditioner.
  void choose_lambda(SystemReport& report) {
    // Lifted by about as much as lambda may come to, the matrix has a good factor, which serves
    // whatever lambda is.
    most_lambda_ = largest(row_sums(gram_.matrix));
    set_lambda(options_.lambda.value_or(most_lambda_ / kMostCondition));
    factor_.emplace(gram_.matrix);
    spectrum_ = estimate(kSpectrumSteps);
    if (options_.lambda) {
      set_lambda(*options_.lambda);
    } else if (spectrum_.min < -spectrum_.max / kMostCondition) {
      make_definite();
    } else {
      set_lambda(spectrum_.condition() <= kMostCondition
                     ? 0
                     : std::max(0.0, spectrum_.max / kMostCondition - spectrum_.min) +
                           gram_.left_out);
    }
    if (options_.part && !options_.lambda && lambda_ < options_.part->least_lambda) {
      use_lambda(options_.part->least_lambda);
    }
    note_lambda(report);
  }

  /// \param weights  c_k / w_ewa. \param w  in: w_ewa; out: the solution.
  void solve(const Array<double>& weights, int channels, Array<Channels>& w, SystemReport& report) {
    const Array<Channels> w_ewa = std::exchange(w, {});
    for (int iterations = 0;; iterations = report.iterations) {
      Array<Channels> b(w_ewa.size());
      w.resize(w_ewa.size());
      for (std::size_t i = 0; i < w.size(); ++i) {
        w[i] = w_ewa[i] / scale_[i];
        b[i] = (scale_[i] * weights[i]) * w_ewa[i] + lambda_ * w[i];
      }
      surfel::solve({gram_.matrix, b, *factor_, bounds_, channels}, options_,
                    stage(options_, 0.5, 1), w, report);
      report.iterations += iterations;
      if (report.converged || options_.lambda || lambda_ > most_lambda_) break;
      if (options_.solver != FitSolver::kConjugateGradients) break;
      raise_lambda();
      note_lambda(report);
    }
    for (std::size_t i = 0; i < w.size(); ++i) w[i] *= scale_[i];
  }

 private:
  void set_lambda(double lambda) {
    add_to_diagonal(gram_.matrix, (lambda - lambda_) / (1 + lambda_));  // The mean is 1 + lambda_.
    lambda_ = lambda;
  }

  /// Without lambda.
  Spectrum estimate(int steps) const {
    Spectrum spectrum = estimate_spectrum(gram_.matrix, *factor_, steps);
    spectrum.min -= lambda_;
    spectrum.max -= lambda_;
    return spectrum;
  }

  /// Of an indefinite matrix there is no good factor, and without one no good estimate of the least
  /// eigenvalue: both are made of a shifted matrix.
  void make_definite() {
    is_shifted_ = true;
    set_lambda(kShift);
    factor_.emplace(gram_.matrix, kShiftedEntries);
    const Spectrum shifted = estimate(kShiftedSteps);
    spectrum_ = {std::min(spectrum_.min, shifted.min), std::max(spectrum_.max, shifted.max)};
    set_lambda(spectrum_.max / kMostCondition - kIndefiniteLambda * spectrum_.min + gram_.left_out);
    // A lambda far below the shift needs its own factor.
    if (lambda_ < kShift / 4) factor_.emplace(gram_.matrix);
  }

  void raise_lambda() {
    const double before = lambda_;
    if (!is_shifted_) make_definite();
    if (lambda_ > before) return;
    use_lambda(std::max(kRaise * before, spectrum_.max / kMostCondition));
  }

  /// Sets a lambda that the factor was not made for.
  void use_lambda(double lambda) {
    set_lambda(lambda);
    factor_.emplace(gram_.matrix, lambda_ < kShift / 4 ? 0 : kShiftedEntries);
  }

  void note_lambda(SystemReport& report) const {
    report.lambda = lambda_;
    report.eigen_min = spectrum_.min + lambda_;
    report.eigen_max = spectrum_.max + lambda_;
  }

  GramSystem& gram_;
  const TextureFitOptions& options_;
  std::optional<CoefficientBounds> bounds_;  ///< Of the scaled coefficients.
  Array<double> scale_;                      ///< The diagonal of S.
  double lambda_ = 0;
  bool is_shifted_ = false;  ///< make_definite() has been called.
  std::optional<InverseFactor> factor_;
  double most_lambda_ = 0;  ///< The largest row sum: beyond it the matrix is definite.
  Spectrum spectrum_;       ///< Without lambda.
};

/// Takes out the points without colour.
void leave_out_unknown(Quadrature& quadrature, Array<Channels>& color,
                       const Array<std::uint8_t>& known) {
  if (std::find(known.begin(), known.end(), 0) == known.end()) return;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < quadrature.functions(); ++i) {
    const std::size_t begin = quadrature.begin[i];
    quadrature.begin[i] = kept;
    for (std::size_t q = begin; q < quadrature.begin[i + 1]; ++q) {
      if (known[q] == 0) continue;
      quadrature.offset[kept] = quadrature.offset[q];
      color[kept++] = color[q];
    }
  }
  quadrature.begin.back() = kept;
  quadrature.offset.resize(kept);
  color.resize(kept);
}

/// Writes the variances of a refined basis. Amplitudes stay: where the cloud leaves them to the
/// variances, it gets them as areas.
void store_variances(const SurfelBasis& basis, SurfelCloud& cloud) {
  if (cloud.area.empty()) {
    for (std::size_t k = 0; k < cloud.size(); ++k) {
      cloud.area.push_back(root_of_determinant(cloud, k));
    }
  }
  for (std::size_t i = 0; i < basis.size(); ++i) {
    const std::uint32_t k = basis.surfel[i];
    const SurfelBasis::Function& f = basis.function[i];
    if (cloud.anisotropic()) {
      cloud.variance_u[k] = static_cast<float>(f.variance_u);
      cloud.variance_v[k] = static_cast<float>(f.variance_v);
    } else {
      cloud.variance[k] = static_cast<float>(f.variance_u);
    }
  }
}

/// The least squares of fit_render(), whatever the system's variances.
struct RenderFit {
  const TextureFitOptions& options;
  FitTarget target;

  Array<Channels> right_side(const RenderSystem& system) const {
    return system.right_side(target.f, target.w_0);
  }

  void solve(const RenderSystem& system, const Array<Channels>& b, const InverseFactor& factor,
             Array<Channels>& w, SystemReport& report,
             const std::function<void(double)>& progress = {}) const {
    if (options.solver != FitSolver::kCeres) {
      surfel::solve({system.normal_matrix, b, factor, options.bounds, target.channels}, options,
                    progress, w, report);
      return;
    }
    note(ceres_fit(system, target, 0, options.tolerance, w), report);
    report.residual = relative_residual(system.normal_matrix, b, w);
  }

  /// Holds the coefficients where detail is unresolved (unresolved_detail.h).
  /// \param b  the right side, which is brought up to date.
  /// \param w  in: where a rough solution starts; out: the rough solution.
  void hold_unresolved(RenderSystem& system, Array<Channels>& b, Array<Channels>& w,
                       SystemReport& report) const {
    constexpr double kRough = 1e-5;          // The default tolerance: shares need no more.
    constexpr std::size_t kFewEntries = 16;  // A quarter of InverseFactor's most.
    SolveOptions rough;
    rough.tolerance = std::max(kRough, options.tolerance);
    // The matrix is about to change: a better factor would take longer than the steps it saves.
    const InverseFactor factor(system.normal_matrix, kFewEntries);
    report.rough_iterations =
        conjugate_gradients(system.normal_matrix, b, factor, w, rough).iterations;
    surfel::hold_unresolved(system, w, target.f);
    for (std::size_t k = 0; k < system.held.size(); ++k) b[k] += system.held[k] * target.w_0[k];
  }

  void solve_robust(const RenderSystem& system, Array<Channels>& w, SystemReport& report) const {
    RobustOptions robust;
    robust.scale = options.robust_scale;
    robust.tolerance = options.tolerance;
    robust.progress = stage(options, 0.5, 1);
    report.robust = options.solver == FitSolver::kCeres
                        ? robust_fit_ceres(system, target, w, robust)
                        : robust_fit(system, target, w, robust);
    report.iterations = report.robust->iterations;
    report.residual = report.robust->residual;
    report.converged = report.robust->converged;
  }

  /// Root mean square over the covered points that count.
  double error(const RenderSystem& system, const SurfelBasis& basis, const SystemReport& report,
               const Array<Channels>& w) const {
    const std::size_t points = report.points - report.uncovered;
    if (points == 0) return 0;
    const EvaluatedBasis& near = system.near;
    const Channels sum = sum_of(basis.size(), kErrorGrain, [&](std::size_t i) -> Channels {
      Channels squares = Channels::Zero();
      if (!counts(options, basis, i)) return squares;
      for (std::size_t q = near.point_begin[i]; q < near.point_begin[i + 1]; ++q) {
        squares += near.residual(q, w, target.f).square();
      }
      return squares;
    });
    return std::sqrt(sum.sum() / (static_cast<double>(points) * target.channels));
  }
};

/// Counts points, and of them the uncovered ones.
void count_points(const TextureFitOptions& options, const SurfelBasis& basis,
                  const EvaluatedBasis& near, SystemReport& report) {
  report.points = report.uncovered = 0;
  for (std::size_t i = 0; i < basis.size(); ++i) {
    if (!counts(options, basis, i)) continue;
    report.points += near.point_begin[i + 1] - near.point_begin[i];
    for (std::size_t q = near.point_begin[i]; q < near.point_begin[i + 1]; ++q) {
      report.uncovered += near.A.row_begin[q] == near.A.row_begin[q + 1] ? 1 : 0;
    }
  }
}

}  // namespace

Array<double> texture_integrals(const SurfelCloud& cloud, const SurfelBasis& basis,
                                const TextureSet& textures, const TextureFitOptions& options) {
  Array<double> integrals(basis.size());
  parallel_for(basis.size(), kIntegralGrain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t i = begin; i < end; ++i) {
      const std::uint32_t k = basis.surfel[i];
      const TextureMap& map = textures.maps[textures.map_index(cloud, k)];
      integrals[i] =
          basis.function[i].area * lattice_sum(ewa_footprint(cloud, k, map, options).kernel);
    }
  });
  return integrals;
}

double gram_lambda(const SurfelBasis& basis, const TextureFitOptions& options) {
  GramSystem gram = make_gram_system(basis);
  SystemReport report;
  GramFit(gram, options).choose_lambda(report);
  return report.lambda;
}

// SS01 (11), R w = c, in the coefficients x = S^-1 w of kernels scaled to a unit diagonal.
void fit_gram(SurfelCloud& cloud, const SurfelBasis& basis, const Array<double>& integrals,
              const TextureFitOptions& options, TextureFitReport& report) {
  SystemReport& system = report.system.emplace();
  StageTimer timer(report.times);
  GramSystem gram = make_gram_system(basis);
  system.functions = counted_functions(options, basis);
  system.entries = counted_entries(options, basis, gram.matrix);
  system.min_reach = gram.min_reach;
  system.max_reach = gram.max_reach;
  const Array<double> weights = integrals.empty() ? row_sums(gram.matrix) : integrals;
  GramFit fit(gram, options);
  timer.end("assembly");
  tell(options, 0.3);

  fit.choose_lambda(system);
  timer.end("condition");
  tell(options, 0.5);

  Array<Channels> w = coefficients_of(cloud, basis, report.alpha);
  fit.solve(weights, report.alpha ? 4 : 3, w, system);
  store(w, basis, report.alpha, cloud);
  timer.end("solve");
}

// Least squares for SS01 (9).
void fit_render(SurfelCloud& cloud, PointColors colors, const RenderSystemOptions& render_options,
                const TextureFitOptions& options, TextureFitReport& report) {
  SystemReport& system = report.system.emplace();
  StageTimer timer(report.times);
  Quadrature& quadrature = colors.quadrature;
  leave_out_unknown(quadrature, colors.color, colors.known);
  Array<std::uint8_t>().swap(colors.known);
  RenderFit fit{options,
                {.f = std::move(colors.color),
                 .w_0 = coefficients_of(cloud, colors.basis, report.alpha),
                 .channels = report.alpha ? 4 : 3}};
  if (!report.alpha) {
    for (Channels& color : fit.target.f) color[3] = 0;
  }
  if (options.part && options.part->measured) {
    options.part->measured->add(
        measure_render_system(colors.basis, quadrature, render_options,
                              [&](std::size_t i) { return counts(options, colors.basis, i); }));
    return;
  }
  RenderSystemOptions weights = render_options;
  if (options.part) weights.whole = options.part->whole;
  RenderSystem render = assemble_render_system(colors.basis, quadrature, weights);
  system.functions = counted_functions(options, colors.basis);
  count_points(options, colors.basis, render.near, system);
  if (!options.refine_variance) Array<Vec2f>().swap(quadrature.offset);
  system.lambda = render_options.regularization;
  timer.end("assembly");
  tell(options, 0.5);

  const double solved = options.refine_variance ? 0.55 : 1;
  Array<Channels> w = fit.target.w_0;
  Array<Channels> b = fit.right_side(render);
  if (render.mu > 0) {
    // Without a minified term there is nothing that aliasing would spoil from afar.
    fit.hold_unresolved(render, b, w, system);
    for (std::size_t i = 0; i < render.held.size(); ++i) {
      if (render.held[i] > 0 && counts(options, colors.basis, i)) ++system.unresolved;
    }
    timer.end("unresolved");
  }
  InverseFactor factor(render.normal_matrix);
  timer.end("condition");

  if (options.robust) {
    fit.solve_robust(render, w, system);
    timer.end("robust");
  } else {
    fit.solve(render, b, factor, w, system, stage(options, 0.5, solved));
    timer.end("solve");
  }
  if (options.refine_variance) {
    system.error_before = fit.error(render, colors.basis, system, w);
    RenderSolution solution{colors.basis, std::move(render), std::move(w)};
    system.variance = refine_variance(solution, quadrature, fit.target,
                                      [&](const RenderSystem& of, Array<Channels>& x) {
                                        fit.solve(of, fit.right_side(of),
                                                  InverseFactor(of.normal_matrix), x, system);
                                      },
                                      {.cutoff = render_options.cutoff,
                                       .coverage = options.coverage,
                                       .progress = stage(options, solved, 1)});
    store_variances(solution.basis, cloud);
    render = std::move(solution.system);
    w = std::move(solution.w);
    factor = InverseFactor(render.normal_matrix);
    timer.end("variance");
  }

  const Spectrum spectrum = estimate_spectrum(render.normal_matrix, factor, kSpectrumSteps);
  system.eigen_min = spectrum.min;
  system.eigen_max = spectrum.max;
  timer.end("condition");
  system.entries = counted_entries(options, colors.basis, render.normal_matrix);
  count_points(options, colors.basis, render.near, system);
  system.error_ewa = fit.error(render, colors.basis, system, fit.target.w_0);
  system.error = fit.error(render, colors.basis, system, w);
  store(w, colors.basis, report.alpha, cloud);
  cloud.basis_cutoff = render_options.cutoff;
}

}  // namespace surfel
