#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <cmath>

#include <gtest/gtest.h>
#include <surfel/base/random.h>
#include <surfel/base/types.h>
#include <surfel/estimate/plane_fit.h>

namespace surfel {
namespace {

using Eigen::Matrix3d;

/// With these eigenvalues, along axes that `seed` turns any way.
Matrix3d covariance(const Vec3d& lambda, std::uint64_t seed) {
  const auto at = [&](int d) { return 2 * random_uniform(seed, 0, d) - 1; };
  const Matrix3d axes = Eigen::Quaterniond(at(0), at(1), at(2), at(3)).normalized().matrix();
  return axes * lambda.asDiagonal() * axes.transpose();
}

void put(const Matrix3d& c, std::size_t i, PlaneBatch& batch) {
  batch.xx[i] = c(0, 0), batch.xy[i] = c(0, 1), batch.xz[i] = c(0, 2);
  batch.yy[i] = c(1, 1), batch.yz[i] = c(1, 2), batch.zz[i] = c(2, 2);
}

void expect_fits(const Matrix3d& c, std::size_t i, const PlaneBatch& batch) {
  const Eigen::SelfAdjointEigenSolver<Matrix3d> truth(c);
  const Vec3d lambda = truth.eigenvalues();
  const double rounding = 1e-13 * lambda[2];
  for (int k = 0; k < 3; ++k) {
    const double relative = k == 0 ? 1e-12 : 1e-7;
    EXPECT_NEAR(batch.lambda[k][i], lambda[k], rounding + relative * std::abs(lambda[k])) << k;
    EXPECT_GE(batch.lambda[k][i], 0);
  }
  const Vec3d n(batch.normal[0][i], batch.normal[1][i], batch.normal[2][i]);
  EXPECT_NEAR(n.norm(), 1, 1e-12);
  const double gap = lambda[1] - lambda[0];
  EXPECT_LE((c * n - lambda[0] * n).norm(), 2e-9 * gap + 10 * rounding);
}

TEST(PlaneFit, EqualsTheIterativeSolver) {
  const Vec3d shapes[] = {{0, 1, 1},     {0, 1, 2},         {0.01, 1, 3},    {0.5, 1, 1},
                          {0.9, 1, 1.1}, {1, 1, 1},         {1, 1, 5},       {0.999999, 1, 5},
                          {0, 0.04, 1},  {0.001, 0.002, 1}, {0, 1e-6, 1},    {0, 1e-12, 1},
                          {0, 0, 1},     {1e-9, 1e-9, 1},   {1e-16, 1, 1e4}, {0.3, 0.31, 0.32}};
  static_assert(std::size(shapes) == PlaneBatch::kSize);
  for (const double scale : {1.0, 1e-40, 1e30}) {
    for (std::uint64_t seed = 0; seed < 50; ++seed) {
      PlaneBatch batch;
      for (std::size_t i = 0; i < PlaneBatch::kSize; ++i) {
        put(covariance(scale * shapes[i], seed), i, batch);
      }
      fit_planes(PlaneBatch::kSize, batch);
      for (std::size_t i = 0; i < PlaneBatch::kSize; ++i) {
        SCOPED_TRACE(testing::Message() << scale << ' ' << seed << ' ' << i);
        expect_fits(covariance(scale * shapes[i], seed), i, batch);
      }
    }
  }
}

TEST(PlaneFit, DoesNotDependOnWhatElseIsInTheBatch) {
  const Matrix3d c = covariance({0.01, 1, 3}, 1);
  PlaneBatch alone;
  put(c, 0, alone);
  fit_planes(1, alone);
  PlaneBatch many;
  for (std::size_t i = 0; i < 11; ++i) put(i == 9 ? c : covariance({0, 0, 1}, i), i, many);
  fit_planes(11, many);
  for (int k = 0; k < 3; ++k) {
    EXPECT_EQ(alone.normal[k][0], many.normal[k][9]);
    EXPECT_EQ(alone.lambda[k][0], many.lambda[k][9]);
  }
}

}  // namespace
}  // namespace surfel
