#pragma once

#include <cstddef>

#include <surfel/base/export.h>

namespace surfel {

/// Matrices that are factorised side by side, one a lane of the SIMD vectors.
constexpr std::size_t kCholeskyBatch = 8;

/// Where the entry (i, j), j <= i, of a batch's first matrix is stored; those of the others follow.
constexpr std::size_t batch_entry(std::size_t i, std::size_t j) {
  return (i * (i + 1) / 2 + j) * kCholeskyBatch;
}

/// For a batch of symmetric matrices A = L L^T of n rows: the last `count` <= n rows of L^-1.
/// Entry j of row n - count + r of the first matrix is rows[(r n + j) kCholeskyBatch]; behind the
/// diagonal rows are undefined. Overwrites the matrices. From where one is not positive definite,
/// the diagonal entries are not finite.
SURFEL_API void last_inverse_rows(std::size_t n, std::size_t count, double* matrices, double* rows);

}  // namespace surfel
