#include <Eigen/SparseCholesky>
#include <limits>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/solve/direct_solve.h>

namespace surfel {

Array<Channels> direct_solve(const SymmetricMatrix& matrix, const Array<Channels>& b) {
  // Rows of the lower triangle are columns of the upper one.
  using Columns = Eigen::SparseMatrix<double, Eigen::ColMajor, std::int64_t>;
  const auto n = static_cast<Eigen::Index>(matrix.rows());
  Array<Channels> x(b.size());
  if (n == 0) return x;
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
  const bool broken = solver.info() != Eigen::Success;
  // Pivots this small are rounding errors of the diagonal's.
  const double least =
      std::numeric_limits<double>::epsilon() * upper.diagonal().cwiseAbs().maxCoeff();
  const Eigen::Index bad = broken ? 0 : (solver.vectorD().array() <= least).count();
  if (broken || bad > 0) {
    throw Error(
        ErrorKind::kNumeric,
        fmt::format("the matrix is not positive definite: {} pivots of L D L^T are positive; "
                    "cut its entries farther out, or add to its diagonal",
                    broken ? std::string("not all") : fmt::format("{} of {}", n - bad, n)));
  }
  using Rows = Eigen::Matrix<double, Eigen::Dynamic, 4, Eigen::RowMajor>;
  const Eigen::MatrixXd rhs = Eigen::Map<const Rows>(b.front().data(), n, 4);
  Eigen::Map<Rows>(x.front().data(), n, 4) = solver.solve(rhs);
  return x;
}

}  // namespace surfel
