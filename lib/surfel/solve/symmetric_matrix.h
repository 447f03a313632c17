#pragma once

#include <surfel/base/export.h>
#include <surfel/solve/sparse_matrix.h>

namespace surfel {

/// Symmetric matrix in compressed rows, of which the lower triangle is stored: half the memory, and
/// half the traffic of a product (symmetric_product.h).
struct SymmetricMatrix {
  Array<std::uint64_t> row_begin;  ///< First entry of every row, then the number of entries.
  Array<std::uint32_t> column;     ///< Ascending within a row; the last one is the diagonal.
  Array<double> value;

  std::size_t rows() const { return row_begin.empty() ? 0 : row_begin.size() - 1; }
  /// Number of entries of both triangles.
  std::size_t entries() const { return 2 * column.size() - rows(); }
  double& diagonal(std::size_t row) { return value[row_begin[row + 1] - 1]; }
  double diagonal(std::size_t row) const { return value[row_begin[row + 1] - 1]; }
  /// Sum of the diagonal.
  SURFEL_API double trace() const;
};

/// Sum of every row of the whole matrix: A times a vector of ones.
SURFEL_API Array<double> row_sums(const SymmetricMatrix& matrix);

/// The whole matrix, with both triangles stored.
SURFEL_API SparseMatrix both_triangles(const SymmetricMatrix& matrix);

}  // namespace surfel
