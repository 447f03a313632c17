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
  const std::size_t n = matrix.rows();
  SparseMatrix result;
  result.columns = n;
  result.row_begin.assign(n + 1, 0);
  const auto for_each = [&](const auto& body) {
    for (std::size_t row = 0; row < n; ++row) {
      for (std::uint64_t e = matrix.row_begin[row]; e < matrix.row_begin[row + 1]; ++e) {
        const std::uint32_t column = matrix.column[e];
        body(row, column, matrix.value[e]);
        if (column != row) body(column, static_cast<std::uint32_t>(row), matrix.value[e]);
      }
    }
  };
  for_each([&](std::size_t row, std::uint32_t, double) { ++result.row_begin[row + 1]; });
  for (std::size_t row = 0; row < n; ++row) result.row_begin[row + 1] += result.row_begin[row];
  result.column.resize(result.row_begin.back());
  result.value.resize(result.column.size());
  // A row has its own entries, ascending, before the rows below add theirs.
  Array<std::uint64_t> next = result.row_begin;
  for_each([&](std::size_t row, std::uint32_t column, double value) {
    result.column[next[row]] = column;
    result.value[next[row]++] = value;
  });
  return result;
}

}  // namespace surfel
