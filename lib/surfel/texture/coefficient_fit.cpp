// Zwicker, Pfister, van Baar, Gross 2001, "Surface Splatting", section 5 and appendix A.

#include <algorithm>
#include <cmath>
#include <utility>

#include <surfel/base/timing.h>
#include <surfel/solve/conjugate_gradients.h>
#include <surfel/solve/direct_solve.h>
#include <surfel/solve/spectrum.h>
#include <surfel/texture/coefficient_fit.h>
#include <surfel/texture/gram_system.h>

namespace surfel {
namespace {

/// Gram matrices are regularised down to this condition: beyond it, coefficients are some thousand
/// times as large as the colours, and single precision does not hold them.
constexpr double kMostCondition = 1e6;

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

/// Solves matrix x = b, from x on. `share` of the work is done when it starts.
void solve(const SparseMatrix& matrix, const Array<Channels>& b, const InverseFactor& factor,
           const TextureFitOptions& options, const std::optional<CoefficientBounds>& bounds,
           double share, Array<Channels>& x, SystemReport& report) {
  if (options.solver == FitSolver::kLdlt) {
    x = direct_solve(matrix, b);
    return;
  }
  SolveOptions solve_options;
  solve_options.tolerance = options.tolerance;
  solve_options.bounds = bounds;
  if (options.progress) {
    solve_options.progress = [&](double done) { options.progress(share + (1 - share) * done); };
  }
  const SolveReport solved = conjugate_gradients(matrix, b, factor, x, solve_options);
  report.iterations = solved.iterations;
  report.residual = solved.residual;
  report.converged = solved.converged && !solved.indefinite;
}

void tell(const TextureFitOptions& options, double done) {
  if (options.progress) options.progress(done);
}

/// Replaces R by S R S with S = mean(diag(R))^-1/2 I, whose diagonal it returns.
Array<double> scale_by_mean_diagonal(SparseMatrix& matrix) {
  double sum = 0;
  for (std::size_t row = 0; row < matrix.rows(); ++row) {
    for (std::uint64_t e = matrix.row_begin[row]; e < matrix.row_begin[row + 1]; ++e) {
      if (matrix.column[e] == row) sum += matrix.value[e];
    }
  }
  const double mean = sum / static_cast<double>(matrix.rows());
  for (double& value : matrix.value) value /= mean;
  return Array<double>(matrix.rows(), 1 / std::sqrt(mean));
}

/// Takes out the points without colour.
void leave_out_unknown(Quadrature& quadrature, Array<Channels>& color,
                       const Array<std::uint8_t>& known) {
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

}  // namespace

void fit_gram(SurfelCloud& cloud, const SurfelBasis& basis, bool alpha,
              const TextureFitOptions& options, TextureFitReport& report) {
  SystemReport& system = report.system.emplace();
  Timer timer;
  GramSystem gram = make_gram_system(basis);
  system.functions = basis.size();
  system.entries = gram.matrix.entries();
  system.min_reach = gram.min_reach;
  system.max_reach = gram.max_reach;
  const Array<Channels> w_ewa = coefficients_of(cloud, basis, alpha);
  const Array<double> sums = row_sums(gram.matrix);
  // (S R S + lambda I) S^-1 w = S c + lambda S^-1 w_ewa, with a diagonal of 1; bounded unknowns
  // must all be scaled alike.
  std::optional<CoefficientBounds> bounds = options.bounds;
  Array<double> scale;
  if (bounds && basis.size() > 0) {
    scale = scale_by_mean_diagonal(gram.matrix);
    bounds = {bounds->lower / scale.front(), bounds->upper / scale.front()};
  } else {
    scale = scale_to_unit_diagonal(gram.matrix);
  }
  report.times.add("assembly", timer.milliseconds());
  tell(options, 0.3);

  timer.restart();
  InverseFactor factor(gram.matrix, Preconditioner::kSparseInverse);
  Spectrum spectrum = estimate_spectrum(gram.matrix, factor);
  system.lambda = options.lambda.value_or(
      spectrum.condition() <= kMostCondition
          ? 0
          : std::max(0.0, spectrum.max / kMostCondition - spectrum.min) + gram.left_out);
  if (system.lambda > 0) {
    add_to_diagonal(gram.matrix, system.lambda);
    factor = InverseFactor(gram.matrix, Preconditioner::kSparseInverse);
  }
  system.eigen_min = spectrum.min + system.lambda;
  system.eigen_max = spectrum.max + system.lambda;
  report.times.add("condition", timer.milliseconds());
  tell(options, 0.5);

  timer.restart();
  Array<Channels> x(basis.size());
  Array<Channels> b(basis.size());
  for (std::size_t i = 0; i < basis.size(); ++i) {
    x[i] = w_ewa[i] / scale[i];
    b[i] = (scale[i] * sums[i]) * w_ewa[i] + system.lambda * x[i];
  }
  solve(gram.matrix, b, factor, options, bounds, 0.5, x, system);
  for (std::size_t i = 0; i < basis.size(); ++i) x[i] *= scale[i];
  store(x, basis, alpha, cloud);
  report.times.add("solve", timer.milliseconds());
}

void fit_render(SurfelCloud& cloud, PointColors colors, const RenderSystemOptions& render_options,
                bool alpha, const TextureFitOptions& options, TextureFitReport& report) {
  SystemReport& system = report.system.emplace();
  Timer timer;
  const SurfelBasis& basis = colors.basis;
  Quadrature quadrature = colors.quadrature;
  leave_out_unknown(quadrature, colors.color, colors.known);
  const RenderSystem render = assemble_render_system(basis, quadrature, render_options);
  const Array<Channels> w_ewa = coefficients_of(cloud, basis, alpha);
  const Array<Channels> b = render.right_side(colors.color, w_ewa);
  system.functions = basis.size();
  system.entries = render.normal_matrix.entries();
  system.points = quadrature.size();
  system.uncovered = render.near.uncovered;
  system.lambda = render_options.regularization;
  report.times.add("assembly", timer.milliseconds());
  tell(options, 0.5);

  timer.restart();
  const InverseFactor factor(render.normal_matrix, Preconditioner::kSparseInverse);
  const Spectrum spectrum = estimate_spectrum(render.normal_matrix, factor);
  system.eigen_min = spectrum.min;
  system.eigen_max = spectrum.max;
  report.times.add("condition", timer.milliseconds());

  timer.restart();
  Array<Channels> w = w_ewa;
  solve(render.normal_matrix, b, factor, options, options.bounds, 0.6, w, system);
  report.times.add("solve", timer.milliseconds());
  if (system.points > system.uncovered) {
    const auto count = static_cast<double>(system.points - system.uncovered) * (alpha ? 4 : 3);
    const auto error = [&](const Array<Channels>& of) {
      const Channels squares = render.residual2(of, colors.color);
      return std::sqrt((alpha ? squares.sum() : squares.head<3>().sum()) / count);
    };
    system.error_ewa = error(w_ewa);
    system.error = error(w);
  }
  store(w, basis, alpha, cloud);
  cloud.basis_cutoff = render_options.cutoff;
}

}  // namespace surfel
