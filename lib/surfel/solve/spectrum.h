#pragma once

#include <limits>

#include <surfel/base/export.h>
#include <surfel/solve/inverse_factor.h>

namespace surfel {

struct Spectrum {
  double min = 0;
  double max = 0;

  double condition() const { return min > 0 ? max / min : std::numeric_limits<double>::infinity(); }
};

/// Estimates the extreme eigenvalues of a symmetric matrix, both from the inside and commonly
/// within a few percent; `min` is negative only if the matrix is indefinite. A step costs about as
/// much as one of conjugate_gradients(); steps end early once the estimates stand still.
/// \param factor  of the matrix: without a good one the smallest eigenvalue is out of reach.
SURFEL_API Spectrum estimate_spectrum(const SymmetricMatrix& matrix, const InverseFactor& factor,
                                      int steps = 60);

}  // namespace surfel
