#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>

namespace surfel {

/// Range that every unknown is kept in; finite, lower < upper.
struct CoefficientBounds {
  double lower = 0;
  double upper = 1;
};

/// When a solver of linear systems ends.
struct SURFEL_API SolveOptions {
  /// Iterations end where the residual |b - A x| of every channel is at most this times its |b|.
  double tolerance = 1e-6;    ///< In (0, 1).
  int max_iterations = 2000;  ///< >= 0.
  std::optional<CoefficientBounds> bounds;
  /// Called with the share that is done, 0..1, from the calling thread; may be empty.
  std::function<void(double)> progress;
  std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// Tells how far a quantity that shrinks by about the same factor each step has come from `first`
/// to `last`: calls progress(share), share 0..1; `progress` may be empty.
SURFEL_API void tell_decay(const std::function<void(double)>& progress, double first, double now,
                           double last);

/// How a solver of linear systems ended.
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
