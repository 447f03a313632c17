#include <cmath>
#include <cstring>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/texture/variance_fit.h>

#include "fit_support.h"
#include "solve/direct_solve.h"

namespace surfel {
namespace {

using test::direct_solve;
using test::flat_basis;

constexpr double kTau = 0.31;

struct Result : RenderSolution {
  Quadrature points;
  FitTarget target;
  RenderSystem before;
  VarianceFitReport report;

  double objective(const RenderSystem& of) const {
    const Array<Channels> x = direct_solve(of.normal_matrix, of.right_side(target.f, target.w_0));
    return (of.near.residual2(x, target.f) + of.pull2(x, target.w_0)).sum();
  }
};

/// Squares of 5 spacings, or what `constant` says.
Result refine(const SurfelBasis& basis, double cutoff, const Channels* constant = nullptr) {
  Result r;
  r.basis = basis;
  r.points = cover_surface(basis, 6);
  r.target.channels = 3;
  r.target.f.resize(r.points.size());
  for (std::size_t i = 0; i < basis.size(); ++i) {
    for (std::size_t q = r.points.begin[i]; q < r.points.begin[i + 1]; ++q) {
      const Vec2d p = test::place_of(basis, r.points, i, q);
      const bool white = (static_cast<int>(std::floor((p.x() + 100) / 5)) +
                          static_cast<int>(std::floor((p.y() + 100) / 5))) %
                             2 ==
                         0;
      r.target.f[q] = constant ? *constant : Channels(white, white, white, 0);
    }
  }
  r.target.w_0.assign(basis.size(), constant ? *constant : Channels(0.5, 0.5, 0.5, 0));
  r.before = assemble_render_system(r.basis, r.points, {.cutoff = cutoff, .minified = 0});
  r.system = r.before;
  const auto solve = [&](const RenderSystem& of, Array<Channels>& x) {
    x = direct_solve(of.normal_matrix, of.right_side(r.target.f, r.target.w_0));
  };
  solve(r.system, r.w);
  r.report = refine_variance(r, r.points, r.target, solve, {.cutoff = cutoff, .coverage = kTau});
  return r;
}

TEST(VarianceFit, LowersTheObjectiveWithinItsBounds) {
  for (const double cutoff : {1.0, 2.0}) {
    const SurfelBasis start = flat_basis(14, 0.9);
    const Result r = refine(start, cutoff);
    EXPECT_GT(r.report.accepted, 0);
    EXPECT_LT(r.report.objective, 0.9 * r.report.objective_start);
    // What is reported is what the basis that comes out gives.
    EXPECT_NEAR(r.objective(r.before), r.report.objective_start, 1e-9);
    const RenderSystem again = assemble_render_system(
        r.basis, r.points, {.cutoff = cutoff, .minified = 0, .lambda = r.before.lambda});
    EXPECT_NEAR(r.objective(again), r.report.objective, 1e-9);
    EXPECT_LT(r.report.sigma_min, 1);
    EXPECT_GT(r.report.sigma_max, 1);
    for (std::size_t k = 0; k < start.size(); ++k) {
      const SurfelBasis::Function& f = r.basis.function[k];
      const double ratio = std::sqrt(f.variance_u / start.function[k].variance_u);
      EXPECT_GE(ratio, 1 / kMostSigmaChange - 1e-6);
      EXPECT_LE(ratio, kMostSigmaChange + 1e-6);
      EXPECT_EQ(f.area, start.function[k].area);
      EXPECT_EQ(f.variance_u, static_cast<double>(static_cast<float>(f.variance_u)));
    }
  }
}

TEST(VarianceFit, KeepsTheCoverage) {
  // Discs that leave little more than is needed.
  const Result r = refine(flat_basis(14, 0.7), 1);
  EXPECT_GT(r.report.accepted, 0);
  EXPECT_EQ(r.system.near.uncovered, r.before.near.uncovered);
  for (std::size_t q = 0; q < r.points.size(); ++q) {
    const double least = std::min(kTau, static_cast<double>(r.before.near.coverage[q]));
    EXPECT_GE(static_cast<double>(r.system.near.coverage[q]), (1 - 1e-5) * least);
  }
}

TEST(VarianceFit, KeepsAConstantAndItsVariances) {
  const Channels color(0.2, 0.5, 0.9, 0);
  const SurfelBasis start = flat_basis(10, 0.8);
  const Result r = refine(start, 1, &color);
  for (const Channels& w : r.w) EXPECT_LT((w - color).abs().maxCoeff(), 1e-9);
  for (std::size_t k = 0; k < start.size(); ++k) {
    EXPECT_EQ(r.basis.function[k].variance_u, start.function[k].variance_u);
  }
}

TEST(VarianceFit, EllipsesKeepTheirShape) {
  SurfelBasis start = flat_basis(10, 0.8);
  for (SurfelBasis::Function& f : start.function) f.variance_u *= 2;
  const Result r = refine(start, 1);
  EXPECT_GT(r.report.accepted, 0);
  for (const SurfelBasis::Function& f : r.basis.function) {
    EXPECT_NEAR(f.variance_u / f.variance_v, 2, 1e-6);
  }
}

TEST(VarianceFit, OddBasesAreSurvived) {
  EXPECT_EQ(refine({}, 1).report.accepted, 0);
  EXPECT_TRUE(refine(flat_basis(1, 0.7), 1).w[0].allFinite());
  SurfelBasis twins = flat_basis(5, 0.8);
  const std::size_t once = twins.size();
  for (std::size_t k = 0; k < once; ++k) {
    twins.function.push_back(twins.function[k]);
    twins.surfel.push_back(static_cast<std::uint32_t>(once + k));
  }
  for (const Channels& w : refine(twins, 1).w) EXPECT_LT(w.abs().maxCoeff(), 100);
}

TEST(VarianceFit, RefusesAMinifiedTermAndOptionsThatCannotBe) {
  const SurfelBasis basis = flat_basis(3, 0.8);
  const Quadrature points = cover_surface(basis, 2);
  const Array<Channels> zero(basis.size(), Channels::Zero());
  RenderSolution start{basis, assemble_render_system(basis, points), zero};
  const FitTarget target{Array<Channels>(points.size(), Channels::Zero()), zero};
  const auto solve = [](const RenderSystem&, Array<Channels>&) {};
  EXPECT_THROW(refine_variance(start, points, target, solve), Error);
  start.system.mu = 0;
  EXPECT_THROW(refine_variance(start, points, target, solve, {.cutoff = 0}), Error);
  EXPECT_THROW(refine_variance(start, points, target, solve, {.coverage = -1}), Error);
}

TEST(VarianceFit, DoesNotDependOnTheThreads) {
  const auto run = [](int threads) {
    set_thread_count(threads);
    Result r = refine(flat_basis(28, 0.9), 1);
    set_thread_count(0);
    return r;
  };
  const Result one = run(1);
  const Result three = run(3);
  ASSERT_GT(one.points.size(),
            std::size_t{4096});  // More than one of the ranges that are added up.
  EXPECT_EQ(test::largest_difference(one.w, three.w), 0);
  for (std::size_t k = 0; k < one.basis.size(); ++k) {
    ASSERT_EQ(one.basis.function[k].variance_u, three.basis.function[k].variance_u);
  }
}

}  // namespace
}  // namespace surfel
