#include <cmath>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/solve/ceres_solver.h>
#include <surfel/texture/gram_system.h>
#include <surfel/texture/robust_fit.h>

#include "fit_support.h"
#include "solve/direct_solve.h"

namespace surfel {
namespace {

using test::direct_solve;
using test::flat_basis;
using test::largest_difference;
using test::smooth_colors;

struct Case {
  explicit Case(double minified = 1)
      : system(assemble_render_system(basis, points, {.minified = minified})) {}

  SurfelBasis basis = flat_basis(10, 0.8);
  Quadrature points = cover_surface(basis, 6);
  RenderSystem system;
  FitTarget target{smooth_colors(basis, points),
                   Array<Channels>(basis.size(), Channels(0.5, 0.5, 0.5, 0)), 3};

  /// Paints over one point in twenty.
  void add_outliers() {
    for (std::size_t q = 0; q < target.f.size(); ++q) {
      if (random_uniform(3, q, 0) < 0.05) target.f[q] = Channels(4, 0, 4, 0);
    }
  }
  Array<Channels> plain() const {
    return direct_solve(system.normal_matrix, system.right_side(target.f, target.w_0));
  }
  Array<Channels> robust(const RobustOptions& options = {}) const {
    Array<Channels> w = plain();
    robust_fit(system, target, w, options);
    return w;
  }
};

double rms(const Array<Channels>& a, const Array<Channels>& b) {
  double sum = 0;
  for (std::size_t k = 0; k < a.size(); ++k) sum += (a[k] - b[k]).square().sum();
  return std::sqrt(sum / static_cast<double>(3 * a.size()));
}

TEST(RobustFit, RefusesOptionsThatCannotBe) {
  const Case c;
  Array<Channels> w = c.target.w_0;
  for (const RobustOptions& bad : {RobustOptions{.scale = 0}, RobustOptions{.scale = HUGE_VAL},
                                   RobustOptions{.tolerance = 0}, RobustOptions{.tolerance = 2}}) {
    EXPECT_EQ(bad.problems().size(), 1U);
    EXPECT_THROW(robust_fit(c.system, c.target, w, bad), Error);
    EXPECT_THROW(robust_fit_ceres(c.system, c.target, w, bad), Error);
  }
}

TEST(CeresSolver, LeastSquaresAreTheFactorisations) {
  const Case c;
  const Array<Channels> expected = c.plain();
  Array<Channels> w = c.target.w_0;
  const CeresReport report = ceres_fit(c.system, c.target, 0, 1e-12, w);
  EXPECT_TRUE(report.converged);
  EXPECT_LT(largest_difference(w, expected), 1e-8);
}

TEST(CeresSolver, SystemsOfEquationsAreTheFactorisations) {
  const SurfelBasis basis = flat_basis(9, 0.8);
  GramSystem gram = make_gram_system(basis);
  add_to_diagonal(gram.matrix, 1e-5);
  Array<Channels> b(basis.size());
  for (std::size_t k = 0; k < b.size(); ++k) {
    b[k] = Channels(random_uniform(1, k, 0), random_uniform(1, k, 1), 1, 0);
  }
  const Array<Channels> expected = direct_solve(gram.matrix, b);
  Array<Channels> x(b.size(), Channels::Zero());
  ceres_solve(gram.matrix, b, 3, 1e-13, x);
  double largest = 0;
  for (const Channels& value : expected) largest = std::max(largest, value.abs().maxCoeff());
  EXPECT_LT(largest_difference(x, expected), 1e-8 * largest);
}

TEST(CeresSolver, MinimisesASmoothFunction) {
  // Rosenbrock's valley.
  Array<double> x(2, -1.0);
  const auto valley = [](const double* at, double* cost, double* gradient) {
    const double a = 1 - at[0];
    const double b = at[1] - at[0] * at[0];
    *cost = a * a + 100 * b * b;
    if (gradient) {
      gradient[0] = -2 * a - 400 * b * at[0];
      gradient[1] = 200 * b;
    }
    return true;
  };
  const CeresReport report = ceres_minimize(x, valley, 1e-14, 200);
  EXPECT_NEAR(x[0], 1, 1e-5);
  EXPECT_NEAR(x[1], 1, 1e-5);
  EXPECT_LT(report.cost, 1e-10);
}

TEST(RobustFit, IsTheMinimumThatCeresFinds) {
  Case c;
  c.add_outliers();
  RobustOptions options{.scale = 0.05, .tolerance = 1e-10};
  Array<Channels> w = c.plain();
  const double before = robust_cost(c.system, c.target, w, 0.05);
  const RobustReport report = robust_fit(c.system, c.target, w, options);
  EXPECT_TRUE(report.converged);
  EXPECT_LT(report.cost, 0.9 * before);
  Array<Channels> reference = c.plain();
  options.tolerance = 1e-9;
  const RobustReport ceres = robust_fit_ceres(c.system, c.target, reference, options);
  EXPECT_TRUE(ceres.converged);
  EXPECT_NEAR(report.cost / ceres.cost, 1, 1e-8);
  EXPECT_EQ(report.down_weighted, ceres.down_weighted);
  EXPECT_LT(largest_difference(w, reference), 1e-4);
}

TEST(RobustFit, OutliersHardlyMatter) {
  Case clean(0);
  Case dirty(0);
  dirty.add_outliers();
  const Array<Channels> expected = clean.plain();
  const double plain = rms(dirty.plain(), expected);
  const double robust = rms(dirty.robust(), expected);
  EXPECT_GT(plain, 0.1);
  EXPECT_LT(robust, 0.1 * plain);
}

TEST(RobustFit, IsThePlainFitWhereNothingIsBeyondTheScale) {
  const Case c;
  EXPECT_LT(largest_difference(c.robust({.scale = 100, .tolerance = 1e-12}), c.plain()), 1e-9);
}

TEST(RobustFit, ScaleIsEstimatedFromTheResidualsAndNeverZero) {
  Case c;
  Array<Channels> w = c.plain();
  const RobustReport report = robust_fit(c.system, c.target, w);
  EXPECT_GE(report.scale, kLeastRobustScale);
  EXPECT_LT(report.down_weighted, c.target.f.size() / 2);
  c.target.f.assign(c.target.f.size(), Channels(0.5, 0.5, 0.5, 0));
  w = c.plain();
  EXPECT_EQ(robust_fit(c.system, c.target, w).scale, kLeastRobustScale);
  for (const Channels& value : w) EXPECT_LT((value - c.target.w_0[0]).abs().maxCoeff(), 1e-9);
}

TEST(RobustFit, DoesNotDependOnTheThreads) {
  Case c;
  c.add_outliers();
  set_thread_count(1);
  const Array<Channels> one = c.robust();
  set_thread_count(3);
  EXPECT_EQ(largest_difference(one, c.robust()), 0);
  set_thread_count(0);
}

}  // namespace
}  // namespace surfel
