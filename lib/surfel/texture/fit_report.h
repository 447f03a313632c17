#pragma once

#include <cstddef>

namespace surfel {

/// Figures of a robust_fit().
struct RobustReport {
  double scale = 0;               ///< Length of residuals from which on they were outliers.
  int rounds = 0;                 ///< Weighted systems solved, or steps of Ceres.
  std::size_t down_weighted = 0;  ///< Points with residuals beyond the scale.
  double cost = 0;                ///< robust_cost() of the coefficients found.
  /// Iterations of conjugate gradients in all rounds, or steps of Ceres.
  int iterations = 0;
  double residual = 0;  ///< The cost's gradient, by the weighted system's right side.
  bool converged = true;
};

/// Figures of a refine_variance().
struct VarianceFitReport {
  int rounds = 0;              ///< Joint minimisations, the rejected ones included.
  int accepted = 0;            ///< Rounds that lowered the objective.
  int iterations = 0;          ///< Iterations of L-BFGS in all rounds.
  double objective_start = 0;  ///< |A w - f|^2 + lambda |w - w_0|^2 with the variances given.
  double objective = 0;        ///< The objective with the variances found.
  double sigma_min = 1;        ///< Least change of a standard deviation, a factor.
  double sigma_max = 1;        ///< Largest change of a standard deviation, a factor.
  std::size_t held = 0;        ///< Functions whose change was cut back for the sake of coverage.
};

/// Sums over functions that tell how the terms of a render system (render_system.h) are
/// weighted.
struct RenderMeasure {
  std::size_t functions = 0;
  std::size_t points = 0;  ///< Of these functions.
  double near = 0;         ///< Of these functions, the diagonal of A^T A.
  double far = 0;          ///< The same of B^T B.

  void add(const RenderMeasure& more) {
    functions += more.functions;
    points += more.points;
    near += more.near;
    far += more.far;
  }
};

}  // namespace surfel
