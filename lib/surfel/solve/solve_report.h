#pragma once

#include <functional>
#include <optional>

namespace surfel {

/// Every unknown is kept within these.
struct CoefficientBounds {
  double lower = 0;
  double upper = 1;
};

struct SolveOptions {
  /// Iterations end where the residual |b - A x| of every channel is at most this times its |b|.
  double tolerance = 1e-6;
  int max_iterations = 2000;
  std::optional<CoefficientBounds> bounds;
  /// Called with the share that is done, 0..1, from the calling thread; may be empty.
  std::function<void(double)> progress;
};

struct SolveReport {
  int iterations = 0;
  /// The worst channel's relative residual; with bounds, only its part that a feasible step
  /// reduces.
  double residual = 0;
  bool converged = true;
  /// A direction p with p^T A p <= 0 turned up: the solution is the iterate before that step.
  bool indefinite = false;
};

}  // namespace surfel
