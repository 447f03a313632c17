#pragma once

#include <surfel/base/export.h>
#include <surfel/solve/block_product.h>
#include <surfel/solve/symmetric_matrix.h>

namespace surfel {

/// Factorised sparse approximate inverse of a sparse symmetric positive definite matrix A, a
/// preconditioner: G, sparse and lower triangular, with G^T G close to A^-1. Row i of G minimises
/// Kaporin's condition number of G A G^T over a pattern: i, the rows before i in the block of
/// kBlockRows rows that holds i, and the unknowns before this block that are most strongly coupled
/// to it. Neighbours in space should be neighbours in the order, as they are along a space-filling
/// curve. G^T G is positive definite whatever A is, and both products are parallel. Single
/// precision does: A's diagonal should lie within 1e-24 and 1e24.
class SURFEL_API InverseFactor {
 public:
  /// \param row_entries  Entries in a row of the pattern on average, at most 240; 4 leaves the
  ///                     blocks alone. 0: a third of the matrix' mean, at least 8 and at most 64:
  ///                     the least total time on Gram matrices of Gaussians, whose rows grow with
  ///                     their condition number (56 to 320 entries, 1e2 to 1e7).
  explicit InverseFactor(const SymmetricMatrix& matrix, std::size_t row_entries = 0);

  std::size_t rows() const { return factor_.rows; }
  /// Stored entries of all rows.
  std::size_t entries() const { return factor_.value.size(); }

  /// y[i - begin] = (G x)_i for the rows [begin, end), on the calling thread. `begin` is a multiple
  /// of kBlockRows, and so is `end` or it is rows().
  void multiply(std::size_t begin, std::size_t end, const ChannelsF* x, ChannelsF* y) const {
    multiply_rows(factor_, begin, end, x, y);
  }
  /// y[j - begin] = (G^T x)_j for any rows [begin, end), on the calling thread.
  void multiply_transposed(std::size_t begin, std::size_t end, const ChannelsF* x,
                           ChannelsF* y) const {
    multiply_columns(factor_, begin, end, x, y);
  }

 private:
  BlockMatrixF factor_;
};

}  // namespace surfel
