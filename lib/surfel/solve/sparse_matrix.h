#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>

#include <surfel/base/types.h>

namespace surfel {

/// One unknown in all its colour channels, which are solved for together: R, G, B and a fourth
/// (alpha or nothing), so that a vector register holds them.
using Channels = Eigen::Array4d;

/// Compressed sparse rows.
struct SparseMatrix {
  Array<std::uint64_t> row_begin;  ///< First entry of every row, then the number of entries.
  Array<std::uint32_t> column;     ///< Ascending within a row.
  Array<double> value;
  std::size_t columns = 0;

  std::size_t rows() const { return row_begin.empty() ? 0 : row_begin.size() - 1; }
  std::size_t entries() const { return column.size(); }
};

}  // namespace surfel
