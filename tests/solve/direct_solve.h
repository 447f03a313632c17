#pragma once

#include <Eigen/SparseCholesky>
#include <cstdint>

#include <gtest/gtest.h>
#include <surfel/solve/symmetric_matrix.h>

namespace surfel::test {

/// Solves A x = b for all channels by Eigen's sparse factorisation: exact up to rounding.
inline Array<Channels> direct_solve(const SymmetricMatrix& matrix, const Array<Channels>& b) {
  // Rows of the lower triangle are columns of the upper one.
  using Columns = Eigen::SparseMatrix<double, Eigen::ColMajor, std::int64_t>;
  const auto n = static_cast<Eigen::Index>(matrix.rows());
  Columns upper(n, n);
  upper.reserve(static_cast<Eigen::Index>(matrix.column.size()));
  for (Eigen::Index i = 0; i < n; ++i) {
    upper.startVec(i);
    for (std::uint64_t entry = matrix.row_begin[i]; entry < matrix.row_begin[i + 1]; ++entry) {
      upper.insertBack(matrix.column[entry], i) = matrix.value[entry];
    }
  }
  upper.finalize();
  const Eigen::SimplicialLDLT<Columns, Eigen::Upper, Eigen::AMDOrdering<std::int64_t>> solver(
      upper);
  EXPECT_EQ(solver.info(), Eigen::Success);
  using Rows = Eigen::Matrix<double, Eigen::Dynamic, 4, Eigen::RowMajor>;
  const Eigen::MatrixXd rhs = Eigen::Map<const Rows>(b.front().data(), n, 4);
  Array<Channels> x(b.size());
  Eigen::Map<Rows>(x.front().data(), n, 4) = solver.solve(rhs);
  return x;
}

}  // namespace surfel::test
