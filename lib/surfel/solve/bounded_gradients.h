#pragma once

#include <surfel/base/export.h>
#include <surfel/solve/inverse_factor.h>
#include <surfel/solve/solve_report.h>

namespace surfel {

/// Minimises x^T A x / 2 - b^T x within the options' bounds, which must be set, by modified
/// proportioning with reduced gradient projections (MPRGP): conjugate gradients among the unknowns
/// that are free, steps of projected gradients where these meet a bound, and steps that release
/// unknowns from bounds where that promises more. Parameters as conjugate_gradients().
SURFEL_API SolveReport bounded_gradients(const SymmetricMatrix& matrix, const Array<Channels>& b,
                                         const InverseFactor& factor, Array<Channels>& x,
                                         const SolveOptions& options);

}  // namespace surfel
