#pragma once

#include <functional>
#include <optional>

#include <surfel/solve/sparse_matrix.h>

namespace surfel {

/// What every unknown is kept within.
struct CoefficientBounds {
  double lower = 0;
  double upper = 1;
};

struct SolveOptions {
  /// Of the residual |b - A x|, relative to |b|, in every channel.
  double tolerance = 1e-6;
  int max_iterations = 2000;
  std::optional<CoefficientBounds> bounds;
  /// Called with the share that is done, 0..1, from the calling thread; may be empty.
  std::function<void(double)> progress;
};

struct SolveReport {
  int iterations = 0;
  /// The worst channel's relative residual: with bounds, of the part that a feasible step reduces.
  double residual = 0;
  bool converged = true;
  /// A direction p with p^T A p <= 0 turned up: the solution is that of the step before.
  bool indefinite = false;
  /// Extreme eigenvalues of the preconditioned matrix, estimated from the inside; 0 with bounds, or
  /// where nothing had to be done.
  double eigen_min = 0;
  double eigen_max = 0;
};

}  // namespace surfel
