#pragma once

#include <surfel/base/export.h>
#include <surfel/solve/block_product.h>
#include <surfel/solve/symmetric_matrix.h>

namespace surfel {

enum class Preconditioner {
  kJacobi,         ///< The diagonal alone.
  kSparseInverse,  ///< Factorised sparse approximate inverse.
};

/// Preconditioner of a sparse symmetric positive definite matrix A in factors: G, sparse, with
/// G^T G close to A^-1. G^T G is positive definite whatever A is, and both products are parallel.
/// Single precision does: A's diagonal should lie within 1e-24 and 1e24.
class SURFEL_API InverseFactor {
 public:
  InverseFactor(const SymmetricMatrix& matrix, Preconditioner kind);

  /// G = diag(A)^-1/2.
  static InverseFactor jacobi(const SymmetricMatrix& matrix);

  /// G is lower triangular. Its row i minimises Kaporin's condition number of G A G^T over a
  /// pattern: i, the rows before it in its block of kBlockRows, and those unknowns before the block
  /// that are most strongly coupled to it. Neighbours in space should be neighbours in the order:
  /// that of a space-filling curve does. \param row_entries  of the pattern, on average, at most
  /// 240; 0: default_row_entries().
  static InverseFactor sparse_inverse(const SymmetricMatrix& matrix, std::size_t row_entries = 0);

  /// A third of the matrix' mean, at least 8 and at most 64: the least total time on Gram matrices
  /// of Gaussians, whose rows grow with their condition number (56 to 320 entries, 1e2 to 1e7).
  static std::size_t default_row_entries(const SymmetricMatrix& matrix);

  std::size_t rows() const { return factor_.rows; }
  /// Stored, of all rows.
  std::size_t entries() const { return factor_.value.size(); }

  /// y[i - begin] = (G x)_i for the rows [begin, end), on the calling thread. `begin` is a multiple
  /// of kBlockRows, and so is `end` or it is rows().
  void multiply(std::size_t begin, std::size_t end, const ChannelsF* x, ChannelsF* y) const {
    multiply_rows(factor_, begin, end, x, y);
  }
  /// The same for G^T, and any rows.
  void multiply_transposed(std::size_t begin, std::size_t end, const ChannelsF* x,
                           ChannelsF* y) const {
    multiply_columns(factor_, begin, end, x, y);
  }

 private:
  explicit InverseFactor(BlockMatrixF factor);

  BlockMatrixF factor_;
};

}  // namespace surfel
