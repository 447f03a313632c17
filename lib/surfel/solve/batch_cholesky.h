#pragma once

#include <cstddef>

#include <surfel/base/export.h>

namespace surfel {

/// Number of matrices that are factorised side by side, each in a lane of the SIMD vectors: eight
/// doubles fill the widest ones.
constexpr std::size_t kCholeskyBatch = 8;

/// Where the entry (i, j), j <= i, of a batch's first matrix is stored; the same entry of the other
/// matrices follows.
constexpr std::size_t batch_entry(std::size_t i, std::size_t j) {
  return (i * (i + 1) / 2 + j) * kCholeskyBatch;
}

/// For a batch of symmetric matrices A = L L^T of n rows: the last `count` <= n rows of L^-1.
/// Entry j of row n - count + r of the first matrix is rows[(r n + j) kCholeskyBatch]; behind the
/// diagonal rows are undefined. Overwrites the matrices. In a matrix that is not positive definite,
/// the diagonal entries are not finite from the first bad pivot on.
SURFEL_API void last_inverse_rows(std::size_t n, std::size_t count, double* matrices, double* rows);

}  // namespace surfel
