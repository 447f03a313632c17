#pragma once

#include <initializer_list>
#include <span>

#include <surfel/base/export.h>
#include <surfel/base/function_ref.h>
#include <surfel/solve/ceres_plugin.h>
#include <surfel/solve/solve_report.h>
#include <surfel/solve/symmetric_matrix.h>

namespace surfel {

/// weight sum_q rho(|A_q w - f_q|^2).
struct LeastSquaresTerm {
  const SparseMatrix& A;
  const Array<Channels>& f;  ///< Per row; ignored where A has no entries.
  double weight = 1;         ///< > 0.
  /// From this length of a residual, over its channels, on rho (Huber's) grows by the length and no
  /// longer by its square; 0: squares throughout.
  double huber = 0;
};

/// Minimises the sum of the terms from `w` on in the first `channels` (1..4), by Ceres' (in
/// libsurfel_ceres.so, loaded when first needed) Gauss-Newton steps, each solved by its sparse
/// factorisation (on one thread, for up to some ten thousand unknowns), or by its conjugate
/// gradients where there are more. Without a loss steps refine what rounding left of the one
/// before; they end where they change w by less than the tolerance. Throws Error: kIo where the
/// plug-in is missing, kNumeric where Ceres fails.
SURFEL_API CeresReport ceres_least_squares(std::initializer_list<LeastSquaresTerm> terms,
                                           int channels, double tolerance, Array<Channels>& w);

/// Solves A x = b in the first `channels` as the least squares of its residual, by the same steps:
/// the squared condition is what refinement has to overcome, up to some 1e7.
SURFEL_API CeresReport ceres_solve(const SymmetricMatrix& matrix, const Array<Channels>& b,
                                   int channels, double tolerance, Array<Channels>& x);

/// Minimises a smooth function of `x` by Ceres' L-BFGS.
/// \param evaluate  sets cost and, where not null, the gradient; returns false where the cost is
///                  not finite.
SURFEL_API CeresReport ceres_minimize(
    Array<double>& x, FunctionRef<bool(const double* x, double* cost, double* gradient)> evaluate,
    double tolerance, int max_iterations);

/// Moves rigid bodies so that points of each lie on planes of others: minimises the sum of Cauchy's
/// function of all distances by Ceres' Levenberg-Marquardt steps, on one thread. The first body
/// rests.
/// \param scale  distance from which on matches count less, > 0.
SURFEL_API CeresReport ceres_move_bodies(std::span<const PlaneMatch> matches, double scale,
                                         std::span<BodyMotion> motion);

}  // namespace surfel
