#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/function_ref.h>
#include <surfel/texture/fit_report.h>
#include <surfel/texture/render_system.h>

namespace surfel {

struct SURFEL_API VarianceFitOptions {
  double cutoff = 1;    ///< c of the renderer, > 0; the system must have been made for it.
  double coverage = 0;  ///< tau of the renderer, >= 0: no point's coverage may fall below it.
  std::function<void(double)> progress{};     ///< Called with the share that is done; may be empty.
  std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// Standard deviations stay within this factor of where they started, up and down.
inline constexpr double kMostSigmaChange = 2;

/// A basis, the system that it makes, and the coefficients that solve the system.
struct RenderSolution {
  SurfelBasis basis;
  RenderSystem system;
  Array<Channels> w;
};

/// Minimises |A w - f|^2 + lambda |w - w_0|^2 over the coefficients and one factor for the variance
/// of every function (an ellipse keeps its shape), together. Amplitudes a_k, points and lambda
/// stay. There is no minified term: B, and the filter of w_0, would change with the variances.
/// (Measured on spot, its texture and a checker, 5000 and 20,000 surfels, lambda the same: B under
/// the filter of the first variances costs 0.1 to 0.8 dB from near, 0.4 to 2.6 dB where minified,
/// and up to twice the time.)
///
/// Kernels that end at beta = c make A jump as variances change. So every round minimises a smooth
/// model, by Ceres' L-BFGS, in which kernels fade out over a range of beta about c that is as wide
/// as the points are apart: what the jumps come to on average. The round's variances then stand or
/// fall by the objective proper, with coefficients from `solve`; a round that does not lower it is
/// repeated with half the range for the log-variances. Points at which the kernels' sum would fall
/// below the smaller of tau and what it was hold the variances of the functions about them.
///
/// \param solution  in: the variances to start with, and a system of mu = 0; out: the variances
///                  found, as single precision holds them, and their system and coefficients.
/// \param solve  sets w to the solution of a system, from w on.
///
/// Throws Error(kUsage) where mu is not 0 or the options are not usable.
/// The result does not depend on the number of threads. It takes some 0.5 ms of one core a surfel
/// (12 points, c = 1), almost all of it to evaluate the model 150 times; an interrupt ends it after
/// the next of these.
SURFEL_API VarianceFitReport
refine_variance(RenderSolution& solution, const Quadrature& quadrature, const FitTarget& target,
                FunctionRef<void(const RenderSystem& system, Array<Channels>& w)> solve,
                const VarianceFitOptions& options = {});

}  // namespace surfel
