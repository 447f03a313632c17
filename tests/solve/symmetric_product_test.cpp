#include <cstring>

#include <gtest/gtest.h>
#include <surfel/base/parallel.h>
#include <surfel/solve/symmetric_product.h>

#include "solve/test_systems.h"

namespace surfel {
namespace {

using namespace surfel::test;

Array<Channels> random_vector(std::size_t count) {
  Array<Channels> x(count);
  for (std::size_t i = 0; i < count; ++i) {
    for (int c = 0; c < 4; ++c) x[i][c] = random_uniform(5, i, c) - 0.5;
  }
  return x;
}

/// A x by the definition, from both triangles.
Array<Channels> product_by_rows(const SymmetricMatrix& matrix, const Array<Channels>& x) {
  const SparseMatrix both = both_triangles(matrix);
  Array<Channels> y(x.size());
  for (std::size_t i = 0; i < both.rows(); ++i) {
    y[i].setZero();
    for (std::uint64_t e = both.row_begin[i]; e < both.row_begin[i + 1]; ++e) {
      y[i] += both.value[e] * x[both.column[e]];
    }
  }
  return y;
}

double largest_error(const Array<Channels>& a, const Array<Channels>& b) {
  double most = 0;
  for (std::size_t i = 0; i < a.size(); ++i) most = std::max(most, (a[i] - b[i]).abs().maxCoeff());
  return most;
}

TEST(SymmetricMatrix, BothTrianglesAreTheMatrix) {
  const SymmetricMatrix matrix = gaussian_gram(12, 0.7).matrix;
  const SparseMatrix both = both_triangles(matrix);
  EXPECT_EQ(both.entries(), matrix.entries());
  Eigen::MatrixXd written = Eigen::MatrixXd::Zero(144, 144);
  for (std::size_t i = 0; i < both.rows(); ++i) {
    for (std::uint64_t e = both.row_begin[i]; e < both.row_begin[i + 1]; ++e) {
      EXPECT_TRUE(e == both.row_begin[i] || both.column[e - 1] < both.column[e]);
      written(static_cast<Eigen::Index>(i), both.column[e]) = both.value[e];
    }
  }
  EXPECT_EQ(written, dense(matrix));
  const Array<double> sums = row_sums(matrix);
  for (std::size_t i = 0; i < sums.size(); ++i) {
    EXPECT_NEAR(sums[i], written.row(static_cast<Eigen::Index>(i)).sum(), 1e-13);
  }
}

TEST(SymmetricProduct, IsThatOfTheWholeMatrix) {
  // Several ranges of rows, and the last of them not full.
  for (const int side : {1, 30, 70}) {
    const SymmetricMatrix matrix = gaussian_gram(side, 0.8).matrix;
    const Array<Channels> x = random_vector(matrix.rows());
    Array<Channels> y(x.size());
    SymmetricProduct product(matrix);
    for (int repeat = 0; repeat < 2; ++repeat) {
      product.multiply(x, y);
      EXPECT_LT(largest_error(y, product_by_rows(matrix, x)), 1e-13);
    }
  }
}

TEST(SymmetricProduct, OfRowsThatReachFarBack) {
  // Every row is coupled with the first rows, and with one that is anywhere.
  constexpr std::size_t kRows = 5000;
  SymmetricMatrix matrix;
  matrix.row_begin.push_back(0);
  for (std::size_t i = 0; i < kRows; ++i) {
    const std::size_t anywhere = i * 2654435761U % (i + 1);
    std::vector<std::size_t> columns{0, 1, anywhere, i};
    std::sort(columns.begin(), columns.end());
    columns.erase(std::unique(columns.begin(), columns.end()), columns.end());
    for (const std::size_t j : columns) {
      if (j > i) continue;
      matrix.column.push_back(static_cast<std::uint32_t>(j));
      matrix.value.push_back(random_uniform(6, i, static_cast<int>(j % 7)));
    }
    matrix.row_begin.push_back(matrix.column.size());
  }
  const Array<Channels> x = random_vector(kRows);
  Array<Channels> y(kRows);
  SymmetricProduct(matrix).multiply(x, y);
  EXPECT_LT(largest_error(y, product_by_rows(matrix, x)), 1e-11);
}

TEST(SymmetricProduct, DoesNotDependOnThreads) {
  const SymmetricMatrix matrix = gaussian_gram(80, 0.6).matrix;
  const Array<Channels> x = random_vector(matrix.rows());
  Array<Channels> first(x.size());
  SymmetricProduct product(matrix);
  product.multiply(x, first);
  // More threads than when the product was made, too.
  for (const int threads : {1, 2, 5}) {
    set_thread_count(threads);
    Array<Channels> y(x.size());
    product.multiply(x, y);
    EXPECT_EQ(std::memcmp(y.data(), first.data(), y.size() * sizeof(Channels)), 0);
  }
  set_thread_count(0);
}

TEST(SymmetricProduct, ResidualIsRelative) {
  const System system = gaussian_gram(20, 0.6);
  Array<Channels> x = random_vector(system.b.size());
  const Eigen::MatrixXd r = dense(system.b) - product(dense(system.matrix), dense(x));
  double expected = 0;
  for (int c = 0; c < 3; ++c) {
    expected = std::max(expected, r.col(c).norm() / dense(system.b).col(c).norm());
  }
  EXPECT_NEAR(relative_residual(system.matrix, system.b, x), expected, 1e-12 * expected);
}

}  // namespace
}  // namespace surfel
