#include <gtest/gtest.h>
#include <surfel/solve/batch_cholesky.h>
#include <surfel/solve/conjugate_gradients.h>

#include "solve/test_systems.h"

namespace surfel {
namespace {

using namespace surfel::test;

TEST(InverseFactor, IsExactWithWholePattern) {
  const System system = gaussian_gram(9, 0.6);
  const Eigen::MatrixXd a = dense(system.matrix);
  const Eigen::MatrixXd g = dense(InverseFactor(sparse(a.array() + 1e-12), 84));
  const Eigen::MatrixXd preconditioned = product(product(g, a), g.transpose());
  EXPECT_LT((preconditioned - Eigen::MatrixXd::Identity(81, 81)).norm(), 1e-4);
}

TEST(InverseFactor, HasUnitDiagonalAndFewEntries) {
  const System system = gaussian_gram(20, 0.7);
  const InverseFactor factor(system.matrix, 20);
  const Eigen::MatrixXd g = dense(factor);
  const Eigen::MatrixXd a = dense(system.matrix);
  // Kaporin's minimiser scales the preconditioned matrix to a unit diagonal.
  const Eigen::MatrixXd preconditioned = product(product(g, a), g.transpose());
  EXPECT_LT((preconditioned.diagonal().array() - 1).abs().maxCoeff(), 1e-4);
  EXPECT_TRUE(Eigen::MatrixXd(g.triangularView<Eigen::StrictlyUpper>()).isZero(0));
  // Half of a block more or less than the mean.
  EXPECT_LE((g.array() != 0).rowwise().count().maxCoeff(), 24);
}

TEST(InverseFactor, TransposedIsTheTranspose) {
  const System system = gaussian_gram(15, 0.7);
  ASSERT_NE(system.matrix.rows() % kBlockRows, 0U);
  const InverseFactor factor(system.matrix);
  const std::size_t n = factor.rows();
  Array<ChannelsF> x(n), y(n);
  for (std::size_t i = 0; i < n; ++i) {
    for (int c = 0; c < 4; ++c) x[i][c] = static_cast<float>(random_uniform(0, i, c));
  }
  Eigen::MatrixXd dense_x(n, 4);
  for (std::size_t i = 0; i < n; ++i) dense_x.row(i) = x[i].cast<double>().transpose();
  const Eigen::MatrixXd g = dense(factor);
  for (const bool transposed : {false, true}) {
    transposed ? factor.multiply_transposed(0, n, x.data(), y.data())
               : factor.multiply(0, n, x.data(), y.data());
    const Eigen::MatrixXd truth = product(transposed ? g.transpose() : g, dense_x);
    for (std::size_t i = 0; i < n; ++i) {
      EXPECT_LT((y[i].cast<double>().matrix().transpose() - truth.row(i)).norm(),
                1e-4 * truth.norm() / std::sqrt(static_cast<double>(n)));
    }
  }
}

TEST(InverseFactor, ScaleOfTheUnknownsDoesNotMatter) {
  System system = gaussian_gram(30, 0.7);
  std::vector<int> iterations;
  for (const bool scaled : {false, true}) {
    if (scaled) {
      for (std::size_t i = 0; i < system.b.size(); ++i) {
        const auto scale = [](std::size_t k) {
          return std::exp2(-30 - static_cast<double>(k % 7));
        };
        for (std::uint64_t e = system.matrix.row_begin[i]; e < system.matrix.row_begin[i + 1];
             ++e) {
          system.matrix.value[e] *= scale(i) * scale(system.matrix.column[e]);
        }
        system.b[i] *= scale(i);
      }
    }
    const InverseFactor factor(system.matrix);
    Array<Channels> x(system.b.size(), Channels(0, 0, 0, 0));
    const SolveReport report = conjugate_gradients(system.matrix, system.b, factor, x);
    EXPECT_TRUE(report.converged);
    iterations.push_back(report.iterations);
  }
  EXPECT_NEAR(iterations[0], iterations[1], 3);
}

TEST(InverseFactor, StaysFiniteWhereTheMatrixIsIndefinite) {
  Eigen::MatrixXd a = dense(gaussian_gram(10, 0.8).matrix);
  a.diagonal().array() -= 0.9;
  a(3, 3) = 0;
  a(4, 4) = -1;
  const Eigen::MatrixXd g = dense(InverseFactor(sparse(a)));
  EXPECT_TRUE(g.allFinite());
  EXPECT_GT(g.diagonal().minCoeff(), 0);
}

TEST(InverseFactor, FewerIterationsThanBlocksAlone) {
  const System system = gaussian_gram(60, 0.7);
  std::vector<int> iterations;
  for (const std::size_t row_entries : {kBlockRows / 2, std::size_t{0}}) {
    Array<Channels> x(system.b.size(), Channels(0, 0, 0, 0));
    const SolveReport report =
        conjugate_gradients(system.matrix, system.b, InverseFactor(system.matrix, row_entries), x);
    EXPECT_TRUE(report.converged);
    iterations.push_back(report.iterations);
  }
  EXPECT_LT(iterations[1] * 4, iterations[0]);
}

TEST(BatchCholesky, EqualsDense) {
  for (const std::size_t n : {1, 2, 5, 8, 23}) {
    const std::size_t count = std::min<std::size_t>(n, 3);
    Array<double> matrices(batch_entry(n, 0)), rows(count * n * kCholeskyBatch);
    std::vector<Eigen::MatrixXd> truth;
    for (std::size_t lane = 0; lane < kCholeskyBatch; ++lane) {
      Eigen::MatrixXd a = Eigen::MatrixXd::Identity(n, n);
      for (std::size_t i = 0; i < n; ++i) {
        for (std::size_t j = 0; j < i; ++j) {
          a(i, j) = a(j, i) = (random_uniform(lane, i, j) - 0.5) / static_cast<double>(n);
        }
        for (std::size_t j = 0; j <= i; ++j) matrices[batch_entry(i, j) + lane] = a(i, j);
      }
      truth.push_back(a);
    }
    last_inverse_rows(n, count, matrices.data(), rows.data());
    for (std::size_t lane = 0; lane < kCholeskyBatch; ++lane) {
      const Eigen::MatrixXd l = truth[lane].llt().matrixL();
      const Eigen::MatrixXd inverse = l.inverse();
      for (std::size_t r = 0; r < count; ++r) {
        for (std::size_t j = 0; j <= n - count + r; ++j) {
          EXPECT_NEAR(rows[(r * n + j) * kCholeskyBatch + lane], inverse(n - count + r, j), 1e-12);
        }
      }
    }
  }
}

}  // namespace
}  // namespace surfel
