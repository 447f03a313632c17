#pragma once

#include <surfel/base/export.h>
#include <surfel/base/function_ref.h>
#include <surfel/solve/ceres_plugin.h>
#include <surfel/solve/solve_report.h>

namespace surfel {

/// Least squares for which Ceres is asked (in libsurfel_ceres.so, loaded when first needed).
struct RobustLeastSquares {
  const SparseMatrix& A;
  const Array<Channels>& f;    ///< Per row; ignored where A has no entries.
  const Array<Channels>& w_0;  ///< Per column.
  double lambda = 0;           ///< Weight of the pull towards w_0, >= 0.
  /// From this length of a residual, over its channels, on Huber's loss grows by the length and no
  /// longer by its square; 0: squares throughout.
  double huber = 0;
  int channels = 4;  ///< That count, the first 1..4.
};

/// Minimises sum_q rho(|A_q w - f_q|^2) + lambda sum_k rho(|w_k - w_0k|^2) from `w` on, by Ceres'
/// Gauss-Newton steps, each solved by its sparse factorisation (on one thread, for up to some ten
/// thousand unknowns), or by its conjugate gradients where there are more. Without a loss steps
/// refine what rounding left of the one before; they end where they change w by less than the
/// tolerance. The report's residual is that change's bound. Throws Error: kIo where the plug-in is
/// missing, kNumeric where Ceres fails.
SURFEL_API CeresReport ceres_least_squares(const RobustLeastSquares& problem, double tolerance,
                                           Array<Channels>& w);

/// Solves A x = b in the first `channels` as the least squares of its residual, by the same steps:
/// the squared condition is what refinement has to overcome, up to some 1e7.
SURFEL_API CeresReport ceres_solve(const SparseMatrix& matrix, const Array<Channels>& b,
                                   int channels, double tolerance, Array<Channels>& x);

/// Minimises a smooth function of `x` by Ceres' L-BFGS. \param evaluate  sets cost and, where not
/// null, the gradient; returns false where the cost is not finite.
SURFEL_API CeresReport ceres_minimize(
    Array<double>& x, FunctionRef<bool(const double* x, double* cost, double* gradient)> evaluate,
    double tolerance, int max_iterations);

}  // namespace surfel
