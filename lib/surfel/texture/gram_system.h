#pragma once

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/solve/symmetric_matrix.h>
#include <surfel/texture/surfel_basis.h>

namespace surfel {

/// The matrix of SS01 (11) and how it was cut.
struct GramSystem {
  SymmetricMatrix matrix;
  double min_reach = 0;  ///< Least reach of a surfel, standard deviations.
  double max_reach = 0;  ///< Largest reach of a surfel, standard deviations.
  /// The most that the cut takes from a row, relative to its diagonal. A lambda of this size makes
  /// up for the definiteness that the cut costs; pairs that do not couple on a bent surface may
  /// cost more.
  double left_out = 0;
};

/// R_kj = <r_k, r_j> = a_k a_j G_{V_k + V_j}(u_k - u_j) [SS01 (11)]. A pair is measured in the
/// plane normal to n_k + n_j, onto which u_k - u_j and the kernels are projected; a kernel is taken
/// as thick along its normal as along its minor axis, so that an isotropic one keeps its variance
/// however it is tilted.
///
/// Entries are carried to where they cannot matter, not tapered: Wendland's function, which keeps R
/// positive definite at any reach, changes the coefficients by 20 to 100 % at 10 standard
/// deviations; a cut changes them by cond(R) exp(-reach^2 / 2). The condition is estimated from the
/// overlap of the kernels, by surfel, and the reach is far enough for errors of 1e-6 of the largest
/// coefficient where cond(R) is up to 1e6. Surfels across a sharp edge or on another sheet are not
/// coupled.
///
/// Work and memory follow the number of entries, whatever the range of the kernels' sizes; besides
/// the matrix some 160 bytes a surfel are in use.
SURFEL_API GramSystem make_gram_system(const SurfelBasis& basis);

/// Adds lambda times the mean of the diagonal to the diagonal.
SURFEL_API void add_to_diagonal(SymmetricMatrix& matrix, double lambda);

/// Replaces R by S R S, S = diag(R)^-1/2, and returns the diagonal of S: R w = c becomes
/// (S R S) y = S c, w = S y. Then the condition does not suffer from kernels of different area, and
/// lambda is relative to each.
SURFEL_API Array<double> scale_to_unit_diagonal(SymmetricMatrix& matrix);

}  // namespace surfel
