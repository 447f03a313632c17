#pragma once

#include <surfel/base/export.h>
#include <surfel/solve/inverse_factor.h>
#include <surfel/solve/solve_report.h>

namespace surfel {

/// Solves A x = b for all channels at once by preconditioned conjugate gradients, or, where the
/// options have bounds, minimises x^T A x / 2 - b^T x within them; see bounded_gradients.h. The
/// result does not depend on the number of threads.
/// Throws Error(kUsage) where the options are not usable.
/// \param matrix  positive definite.
/// \param factor  of the matrix, or of one close to it.
/// \param x  in: where to start, out: the solution.
SURFEL_API SolveReport conjugate_gradients(const SymmetricMatrix& matrix, const Array<Channels>& b,
                                           const InverseFactor& factor, Array<Channels>& x,
                                           const SolveOptions& options = {});

}  // namespace surfel
