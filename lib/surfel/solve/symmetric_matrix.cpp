#include <utility>

#include <surfel/base/group_by_key.h>
#include <surfel/solve/symmetric_matrix.h>

namespace surfel {

double SymmetricMatrix::trace() const {
  double sum = 0;
  for (std::size_t row = 0; row < rows(); ++row) sum += diagonal(row);
  return sum;
}

Array<double> row_sums(const SymmetricMatrix& matrix) {
  Array<double> sums;
  sums.assign(matrix.rows(), 0.0);
  for (std::size_t row = 0; row < matrix.rows(); ++row) {
    const std::uint64_t last = matrix.row_begin[row + 1] - 1;
    double sum = matrix.value[last];
    for (std::uint64_t e = matrix.row_begin[row]; e < last; ++e) {
      sum += matrix.value[e];
      sums[matrix.column[e]] += matrix.value[e];
    }
    sums[row] += sum;
  }
  return sums;
}

SparseMatrix both_triangles(const SymmetricMatrix& matrix) {
  // A row has its own entries, ascending, before the rows below add theirs.
  using Entry = std::pair<std::uint32_t, double>;
  const Grouped<Entry> rows = group_by_key<Entry>(matrix.rows(), [&](const auto& add) {
    for (std::uint32_t row = 0; row < matrix.rows(); ++row) {
      for (std::uint64_t e = matrix.row_begin[row]; e < matrix.row_begin[row + 1]; ++e) {
        const std::uint32_t column = matrix.column[e];
        add(row, Entry(column, matrix.value[e]));
        if (column != row) add(column, Entry(row, matrix.value[e]));
      }
    }
  });
  SparseMatrix result;
  result.columns = matrix.rows();
  result.row_begin = rows.begin;
  for (const auto& [column, value] : rows.item) {
    result.column.push_back(column);
    result.value.push_back(value);
  }
  return result;
}

}  // namespace surfel
