#include <gtest/gtest.h>
#include <surfel/solve/spectrum.h>

#include "solve/test_systems.h"

namespace surfel {
namespace {

using namespace surfel::test;

Spectrum estimate(const SymmetricMatrix& matrix) {
  return estimate_spectrum(matrix, InverseFactor(matrix));
}

TEST(Spectrum, EqualsDenseEigenvalues) {
  for (const double sigma : {0.5, 0.7, 1.0}) {
    const System system = gaussian_gram(30, sigma);
    const Eigen::VectorXd truth = eigenvalues(dense(system.matrix));
    const Spectrum spectrum = estimate(system.matrix);
    EXPECT_GE(spectrum.min, 0.999 * truth.minCoeff()) << sigma;
    EXPECT_LE(spectrum.min, 1.5 * truth.minCoeff()) << sigma;
    EXPECT_LE(spectrum.max, 1.001 * truth.maxCoeff()) << sigma;
    EXPECT_GE(spectrum.max, 0.9 * truth.maxCoeff()) << sigma;
  }
}

TEST(Spectrum, FindsNegativeEigenvalues) {
  Eigen::MatrixXd a = dense(gaussian_gram(30, 0.7).matrix);
  const double least = eigenvalues(a).minCoeff();
  a.diagonal().array() -= 2 * least;
  const Spectrum spectrum = estimate(sparse(a));
  EXPECT_LT(spectrum.min, 0);
  EXPECT_GE(spectrum.min, -1.001 * least);
  EXPECT_EQ(spectrum.condition(), std::numeric_limits<double>::infinity());
}

TEST(Spectrum, SmallMatrices) {
  SymmetricMatrix none;
  none.row_begin.push_back(0);
  EXPECT_EQ(estimate(none).max, 0);
  const Spectrum one = estimate(sparse(Eigen::MatrixXd::Constant(1, 1, 3.0)));
  EXPECT_DOUBLE_EQ(one.min, 3);
  EXPECT_DOUBLE_EQ(one.max, 3);
  const Spectrum two = estimate(sparse(Eigen::Vector2d(2, 5).asDiagonal()));
  EXPECT_NEAR(two.min, 2, 1e-6);
  EXPECT_NEAR(two.max, 5, 1e-6);
}

}  // namespace
}  // namespace surfel
