#include <cstring>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/solve/conjugate_gradients.h>

#include "solve/test_systems.h"

namespace surfel {
namespace {

using namespace surfel::test;

Array<Channels> zeros(std::size_t count) { return Array<Channels>(count, Channels(0, 0, 0, 0)); }

SolveOptions precise(double tolerance = 1e-10) {
  SolveOptions options;
  options.tolerance = tolerance;
  return options;
}

/// By the entries in a row of the factor: its blocks alone, and as many as it chooses.
class ConjugateGradients : public testing::TestWithParam<std::size_t> {};
INSTANTIATE_TEST_SUITE_P(Factors, ConjugateGradients,
                         testing::Values(kBlockRows / 2, std::size_t{0}));

TEST_P(ConjugateGradients, EqualsDenseFactorisation) {
  for (const double sigma : {0.5, 0.7}) {
    const System system = gaussian_gram(25, sigma);
    const Eigen::MatrixXd truth = solve_definite(dense(system.matrix), dense(system.b));
    Array<Channels> x = zeros(system.b.size());
    const SolveReport report = conjugate_gradients(
        system.matrix, system.b, InverseFactor(system.matrix, GetParam()), x, precise(1e-12));
    EXPECT_TRUE(report.converged) << report.residual;
    EXPECT_FALSE(report.indefinite);
    EXPECT_LT((dense(x) - truth).norm(), 1e-7 * truth.norm()) << sigma;
  }
}

TEST_P(ConjugateGradients, StartsWhereTold) {
  const System system = gaussian_gram(20, 0.6);
  const InverseFactor factor(system.matrix, GetParam());
  Array<Channels> x = zeros(system.b.size());
  conjugate_gradients(system.matrix, system.b, factor, x, precise(1e-10));
  const Array<Channels> before = x;
  const SolveReport report = conjugate_gradients(system.matrix, system.b, factor, x, precise(1e-9));
  EXPECT_EQ(report.iterations, 0);
  EXPECT_TRUE(report.converged);
  EXPECT_EQ(dense(x), dense(before));
}

TEST_P(ConjugateGradients, DoesNotDependOnThreads) {
  const System system = gaussian_gram(70, 0.7);
  std::vector<Array<Channels>> solutions;
  for (const int threads : {1, 2, 5}) {
    set_thread_count(threads);
    Array<Channels> x = zeros(system.b.size());
    const InverseFactor factor(system.matrix, GetParam());
    conjugate_gradients(system.matrix, system.b, factor, x, precise(1e-8));
    solutions.push_back(x);
    SolveOptions options = precise(1e-4);
    options.bounds = CoefficientBounds{0.1, 0.9};
    options.max_iterations = 100;
    conjugate_gradients(system.matrix, system.b, factor, x, options);
    solutions.push_back(x);
  }
  set_thread_count(0);
  for (std::size_t i = 2; i < solutions.size(); ++i) {
    EXPECT_EQ(std::memcmp(solutions[i].data(), solutions[i % 2].data(),
                          solutions[i].size() * sizeof(Channels)),
              0);
  }
}

TEST_P(ConjugateGradients, ZeroRightHandSide) {
  System system = gaussian_gram(12, 0.6);
  for (Channels& b : system.b) b = {0, b[1], 0, 0};
  Array<Channels> x(system.b.size(), Channels(1, 2, 3, 4));
  const SolveReport report =
      conjugate_gradients(system.matrix, system.b, InverseFactor(system.matrix, GetParam()), x);
  EXPECT_TRUE(report.converged);
  EXPECT_EQ(dense(x).col(0).norm(), 0);
  EXPECT_EQ(dense(x).col(3).norm(), 0);
  EXPECT_TRUE(dense(x).allFinite());
  EXPECT_GT(dense(x).col(1).norm(), 0);
}

TEST_P(ConjugateGradients, NoneAndOneUnknown) {
  SymmetricMatrix none;
  none.row_begin.push_back(0);
  Array<Channels> x;
  EXPECT_TRUE(conjugate_gradients(none, {}, InverseFactor(none, GetParam()), x).converged);

  const SymmetricMatrix one = sparse(Eigen::MatrixXd::Constant(1, 1, 4.0));
  const Array<Channels> b(1, Channels(8, 0, -4, 1));
  x = zeros(1);
  EXPECT_TRUE(conjugate_gradients(one, b, InverseFactor(one, GetParam()), x, precise()).converged);
  EXPECT_TRUE(x[0].isApprox(Channels(2, 0, -1, 0.25), 1e-12));
}

TEST_P(ConjugateGradients, ReportsIndefiniteMatrices) {
  Eigen::MatrixXd matrix = dense(gaussian_gram(10, 0.7).matrix);
  matrix.diagonal().array() -= 0.5;
  const SymmetricMatrix indefinite = sparse(matrix);
  Array<Channels> b(100);
  for (std::size_t i = 0; i < b.size(); ++i) b[i].setConstant(random_uniform(3, i) - 0.5);
  for (const bool bounded : {false, true}) {
    Array<Channels> x = zeros(100);
    SolveOptions options = precise();
    if (bounded) options.bounds = CoefficientBounds{-1e3, 1e3};
    const SolveReport report =
        conjugate_gradients(indefinite, b, InverseFactor(indefinite, GetParam()), x, options);
    EXPECT_TRUE(report.indefinite);
    EXPECT_FALSE(report.converged);
    EXPECT_TRUE(dense(x).allFinite());
    EXPECT_TRUE(std::isfinite(report.residual));
  }
}

TEST_P(ConjugateGradients, ReportsProgress) {
  const System system = gaussian_gram(20, 0.6);
  double last = 0;
  SolveOptions options;
  options.progress = [&](double share) { last = share; };
  Array<Channels> x = zeros(system.b.size());
  conjugate_gradients(system.matrix, system.b, InverseFactor(system.matrix, GetParam()), x,
                      options);
  EXPECT_EQ(last, 1);
}

/// The minimum within bounds, by trying out which unknowns are at which bound.
Eigen::VectorXd exhaustive_minimum(const Eigen::MatrixXd& a, const Eigen::VectorXd& b,
                                   const CoefficientBounds& bounds) {
  const auto n = static_cast<int>(b.size());
  int states = 1;
  for (int i = 0; i < n; ++i) states *= 3;
  Eigen::VectorXd best;
  double least = std::numeric_limits<double>::infinity();
  for (int state = 0; state < states; ++state) {
    Eigen::MatrixXd m = a;
    Eigen::VectorXd rhs = b;
    for (int i = 0, rest = state; i < n; ++i, rest /= 3) {
      if (rest % 3 == 0) continue;
      m.row(i).setZero();
      m(i, i) = 1;
      rhs[i] = rest % 3 == 1 ? bounds.lower : bounds.upper;
    }
    const Eigen::VectorXd x = solve(m, rhs);
    if (x.minCoeff() < bounds.lower - 1e-12 || x.maxCoeff() > bounds.upper + 1e-12) continue;
    const double energy = x.dot(product(a, x).col(0)) / 2 - b.dot(x);
    if (energy < least) {
      least = energy;
      best = x;
    }
  }
  return best;
}

TEST_P(ConjugateGradients, BoundedMinimumOfSmallProblems) {
  constexpr int kSize = 6;
  const CoefficientBounds bounds{-0.2, 0.5};
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    Eigen::MatrixXd root(kSize, kSize);
    Eigen::MatrixXd rhs(kSize, 4);
    for (int i = 0; i < kSize; ++i) {
      for (int j = 0; j < kSize; ++j) root(i, j) = random_uniform(seed, i, j) - 0.5;
      for (int c = 0; c < 4; ++c) rhs(i, c) = (random_uniform(seed, i, 100 + c) - 0.5) * (c + 1);
    }
    const Eigen::MatrixXd a =
        product(root, root.transpose()) + 0.01 * Eigen::MatrixXd::Identity(kSize, kSize);
    const SymmetricMatrix matrix = sparse(a);
    Array<Channels> b(kSize);
    for (int i = 0; i < kSize; ++i) b[i] = rhs.row(i).transpose();
    Array<Channels> x = zeros(kSize);
    SolveOptions options = precise();
    options.bounds = bounds;
    const SolveReport report =
        conjugate_gradients(matrix, b, InverseFactor(matrix, GetParam()), x, options);
    EXPECT_TRUE(report.converged) << seed << ' ' << report.residual;
    for (int c = 0; c < 4; ++c) {
      const Eigen::VectorXd truth = exhaustive_minimum(a, rhs.col(c), bounds);
      EXPECT_LT((dense(x).col(c) - truth).norm(), 1e-6) << seed << ' ' << c;
    }
  }
}

TEST_P(ConjugateGradients, BoundedSolutionSatisfiesKarushKuhnTucker) {
  const System system = gaussian_gram(40, 0.7);
  const CoefficientBounds bounds{0.2, 0.8};
  SolveOptions options = precise(1e-8);
  options.bounds = bounds;
  options.max_iterations = 20000;
  Array<Channels> x = zeros(system.b.size());
  const SolveReport report = conjugate_gradients(
      system.matrix, system.b, InverseFactor(system.matrix, GetParam()), x, options);
  EXPECT_TRUE(report.converged) << report.residual;
  const Eigen::MatrixXd gradient = product(dense(system.matrix), dense(x)) - dense(system.b);
  const double slack = 1e-8 * dense(system.b).norm();
  int bound = 0;
  for (Eigen::Index i = 0; i < gradient.rows(); ++i) {
    for (int c = 0; c < 3; ++c) {
      const double value = x[i][c];
      ASSERT_GE(value, bounds.lower);
      ASSERT_LE(value, bounds.upper);
      EXPECT_TRUE(value == bounds.lower || gradient(i, c) <= slack);
      EXPECT_TRUE(value == bounds.upper || gradient(i, c) >= -slack);
      bound += value == bounds.lower || value == bounds.upper;
    }
  }
  EXPECT_GT(bound, 100);
}

TEST(ConjugateGradients, RefuseOptionsThatCannotBe) {
  const System system = gaussian_gram(3, 0.6);
  const InverseFactor factor(system.matrix);
  Array<Channels> x = zeros(system.b.size());
  SolveOptions no_tolerance;
  no_tolerance.tolerance = 0;
  SolveOptions no_iterations;
  no_iterations.max_iterations = -1;
  SolveOptions equal_bounds;
  equal_bounds.bounds = CoefficientBounds{1, 1};
  for (const SolveOptions& bad : {no_tolerance, no_iterations, equal_bounds}) {
    EXPECT_EQ(bad.problems().size(), 1U);
    EXPECT_THROW(conjugate_gradients(system.matrix, system.b, factor, x, bad), Error);
  }
}

TEST(BoundedGradients, WideBoundsChangeNothing) {
  const System system = gaussian_gram(25, 0.6);
  const InverseFactor factor(system.matrix);
  Array<Channels> free = zeros(system.b.size());
  Array<Channels> bounded = free;
  SolveOptions options = precise();
  const SolveReport plain = conjugate_gradients(system.matrix, system.b, factor, free, options);
  options.bounds = CoefficientBounds{-1e6, 1e6};
  const SolveReport report = conjugate_gradients(system.matrix, system.b, factor, bounded, options);
  EXPECT_TRUE(report.converged);
  EXPECT_LE(report.iterations, plain.iterations + 2);
  EXPECT_LT((dense(free) - dense(bounded)).norm(), 1e-8 * dense(free).norm());
}

}  // namespace
}  // namespace surfel
