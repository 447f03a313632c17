#pragma once

#include <surfel/base/export.h>
#include <surfel/solve/symmetric_matrix.h>

namespace surfel {

/// Solves A x = b for all channels by the sparse factorisation A = L D L^T: exact up to rounding,
/// but on one thread, and the memory that L takes grows faster than A. Throws Error(kNumeric) if A
/// is not positive definite up to rounding.
SURFEL_API Array<Channels> direct_solve(const SymmetricMatrix& matrix, const Array<Channels>& b);

}  // namespace surfel
