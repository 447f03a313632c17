#pragma once

#include <surfel/base/export.h>
#include <surfel/solve/sparse_matrix.h>

namespace surfel {

/// A preconditioner's numbers need no more than single precision.
using ChannelsF = Eigen::Array4f;

/// Compressed sparse rows in single precision.
struct SparseMatrixF {
  Array<std::uint64_t> row_begin;
  Array<std::uint32_t> column;
  Array<float> value;

  std::size_t rows() const { return row_begin.empty() ? 0 : row_begin.size() - 1; }
};

/// y[i - begin] = row i of the matrix times x, for the rows [begin, end), on the calling thread.
SURFEL_API void multiply_rows(const SparseMatrixF& matrix, std::size_t begin, std::size_t end,
                              const ChannelsF* x, ChannelsF* y);

}  // namespace surfel
