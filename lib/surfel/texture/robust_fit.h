#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/solve/ceres_plugin.h>
#include <surfel/texture/fit_report.h>
#include <surfel/texture/render_system.h>

namespace surfel {

struct SURFEL_API RobustOptions {
  /// Length of a residual over its channels, linear colour, from which on it counts as an outlier,
  /// > 0. Unset: twice the median length, which is re-estimated after the first two rounds and at
  /// least kLeastRobustScale. (Gaussian noise in three channels: 2 % of the points are beyond.)
  std::optional<double> scale{};
  /// Rounds end where they change w by less, relative to |w|.
  double tolerance = 1e-5;                    ///< In (0, 1).
  std::function<void(double)> progress{};     ///< Called with the share that is done; may be empty.
  std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// A quarter of a step of 8-bit colours: rounding is no outlier.
inline constexpr double kLeastRobustScale = 1e-3;

/// Huber's function of a residual's squared length: squares up to `scale`, then lines,
/// 2 scale |r| - scale^2 [Huber 1964]. It is convex, so that there is one minimum, wherever one
/// starts; a loss that levels out (Cauchy's) has several.
///
/// The cost is sum_q rho(|A_q w - f_q|^2) + mu |B w - w_0|^2 + lambda |w - w_0|^2, a point's
/// channels together. Only the points are under the loss: w_0 is filtered, and outliers change it
/// by less than they are.
SURFEL_API double robust_cost(const RenderSystem& system, const FitTarget& target,
                              const Array<Channels>& w, double scale);

/// Minimises robust_cost() by iteratively reweighted least squares [Holland, Welsch 1977]: with
/// weights D = min(1, scale / |r|) of the last round, conjugate gradients on
/// A^T D A + mu B^T B + lambda I. No round raises the cost. The result does not depend on the
/// number of threads. Throws Error(kUsage) where the options are not usable.
/// \param w  in: where to start, best w_0: a fit without a loss follows outliers, which makes the
///           estimated scale larger; out: the minimum.
SURFEL_API RobustReport robust_fit(const RenderSystem& system, const FitTarget& target,
                                   Array<Channels>& w, const RobustOptions& options = {});

/// Minimises robust_cost() by Ceres (ceres_solver.h), with the scale that robust_fit() would
/// estimate: the reference, for small systems.
SURFEL_API RobustReport robust_fit_ceres(const RenderSystem& system, const FitTarget& target,
                                         Array<Channels>& w, const RobustOptions& options = {});

/// Minimises the system's objective (scale = 0), or robust_cost() of a scale > 0, by Ceres, from w
/// on.
SURFEL_API CeresReport ceres_fit(const RenderSystem& system, const FitTarget& target, double scale,
                                 double tolerance, Array<Channels>& w);

/// Winsorised colour samples, towards which robust fits to samples are pulled: a sample further
/// than `scale` (unset: estimated as RobustOptions::scale is) from the median of its
/// neighbourhood's samples is moved towards the median, to that distance.
SURFEL_API Array<Channels> winsorized(const SurfelBasis& basis, const Array<Channels>& sample,
                                      std::optional<double> scale = {});

}  // namespace surfel
