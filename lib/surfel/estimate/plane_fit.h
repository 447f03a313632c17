#pragma once

#include <cstddef>

#include <surfel/base/export.h>

namespace surfel {

/// Covariances of up to kSize neighbourhoods, and the planes that fit the neighbourhoods best.
struct PlaneBatch {
  static constexpr std::size_t kSize = 16;  ///< Two of the widest vectors.
  using Column = double[kSize];

  alignas(64) Column xx = {}, xy = {}, xz = {}, yy = {}, yz = {}, zz = {};  ///< Set by the caller.
  alignas(64) Column normal[3] = {};  ///< Unit; of arbitrary side.
  alignas(64) Column lambda[3] = {};  ///< Eigenvalues, ascending, >= 0; the larger two
                                      ///< to 1e-7 of themselves where they are close.
};

/// Normals (eigenvectors of the smallest eigenvalue) and eigenvalues of the first `count`
/// covariances, which are positive semi-definite and not zero. With SIMD: the smallest root of the
/// characteristic polynomial by Newton's method from zero, which approaches it from below; the
/// normal is the largest cross product of two rows of C - lambda_0 I. The residual |C n - lambda n|
/// bounds the error of the normal; where it is above 1e-9 of the gap to the next eigenvalue (two
/// eigenvalues are nearly equal) Eigen's iterative solver takes over.
SURFEL_API void fit_planes(std::size_t count, PlaneBatch& batch);

}  // namespace surfel
