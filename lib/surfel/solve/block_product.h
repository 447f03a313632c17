#pragma once

#include <algorithm>

#include <surfel/base/export.h>
#include <surfel/solve/sparse_matrix.h>

namespace surfel {

/// A preconditioner's numbers need no more than single precision.
using ChannelsF = Eigen::Array4f;

/// Number of rows that share their columns: there are that many times fewer indices and loads.
constexpr std::size_t kBlockRows = 8;

/// Sparse square matrix in single precision, in blocks of kBlockRows consecutive rows.
struct BlockMatrixF {
  /// An entry of a column's list: column number `slot` of a block.
  struct Place {
    std::uint32_t block;
    std::uint32_t slot;
  };

  std::size_t rows = 0;
  Array<std::uint64_t> block_begin;  ///< First column of every block, then the number of columns.
  Array<std::uint32_t> column;       ///< Ascending within a block.
  Array<float> value;                ///< kBlockRows values a column, one for each row of the block.
  Array<std::uint64_t> column_begin;  ///< First place of every column, then the number of places.
  Array<Place> place;                 ///< Ascending within a column.

  std::size_t blocks() const { return (rows + kBlockRows - 1) / kBlockRows; }
  std::size_t rows_of(std::size_t block) const {
    return std::min(kBlockRows, rows - block * kBlockRows);
  }
  /// Sets column_begin and place from the blocks' columns.
  SURFEL_API void list_places();
};

/// y[i - begin] = row i of the matrix times x, for the rows [begin, end), on the calling thread.
/// `begin` is a multiple of kBlockRows, and so is `end` or it is the number of rows.
SURFEL_API void multiply_rows(const BlockMatrixF& matrix, std::size_t begin, std::size_t end,
                              const ChannelsF* x, ChannelsF* y);

/// y[j - begin] = column j of the matrix times x, for any columns [begin, end).
SURFEL_API void multiply_columns(const BlockMatrixF& matrix, std::size_t begin, std::size_t end,
                                 const ChannelsF* x, ChannelsF* y);

}  // namespace surfel
