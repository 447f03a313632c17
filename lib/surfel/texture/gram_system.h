#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/solve/symmetric_matrix.h>
#include <surfel/texture/surfel_basis.h>

namespace surfel {

/// Which inner products of the surfels' functions are kept.
struct SURFEL_API GramOptions {
  /// Largest distance of a coupled pair, in standard deviations of G_{V_k + V_j}, 3 to 8.5. Unset:
  /// from the local overlap, far enough for `accuracy` where cond(R) is up to 1e6.
  std::optional<double> reach;
  /// Error of the coefficients, relative to the largest, that the entries left out may cause, 1e-9
  /// to 1e-1; without meaning where `reach` is set.
  double accuracy = 1e-6;
  /// Surfels whose normals are further apart than this cosine are not coupled (a sharp edge, the
  /// other side of a sheet), 0.1 to 0.99.
  double min_cosine = 0.5;
  /// Surfels further apart along their mean normal than this many standard deviations, of the
  /// kernels' minor axes (root mean square of the two), are not coupled (another sheet), 0.01 to
  /// 100.
  double thickness = 1;
  std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// The matrix of SS01 (11) and how it was cut.
struct GramSystem {
  SymmetricMatrix matrix;
  double min_reach = 0;  ///< Of all surfels, standard deviations.
  double max_reach = 0;
  /// What the cut takes from a row, at most, relative to its diagonal. So much lambda restores what
  /// it costs of definiteness; pairs that do not couple on a bent surface may cost more.
  double left_out = 0;
};

/// R_kj = <r_k, r_j> = a_k a_j G_{V_k + V_j}(u_k - u_j) [SS01 (11)]. Metric of a pair: that of the
/// plane normal to n_k + n_j, onto which u_k - u_j and the kernels are projected; for that, a
/// kernel is as thick along its normal as along its minor axis, so that an isotropic one keeps its
/// variance however it is tilted.
///
/// Entries are carried to where they cannot matter, not tapered: Wendland's function, which keeps R
/// positive definite at any reach, changes the coefficients by 20 to 100 % at 10 standard
/// deviations; a cut changes them by cond(R) exp(-reach^2 / 2). The condition is estimated from the
/// overlap of the kernels, by surfel.
///
/// Work and memory follow the number of entries, whatever the range of the kernels' sizes; besides
/// the matrix some 160 bytes a surfel are in use. Throws Error(kUsage) where the options are not
/// usable.
SURFEL_API GramSystem make_gram_system(const SurfelBasis& basis, const GramOptions& options = {});

/// Adds lambda times the mean of the diagonal to it.
SURFEL_API void add_to_diagonal(SymmetricMatrix& matrix, double lambda);

/// Replaces R by S R S, S = diag(R)^-1/2, and returns the diagonal of S: R w = c becomes
/// (S R S) y = S c, w = S y. Then the condition does not suffer from kernels of different area, and
/// lambda is relative to each.
SURFEL_API Array<double> scale_to_unit_diagonal(SymmetricMatrix& matrix);

}  // namespace surfel
