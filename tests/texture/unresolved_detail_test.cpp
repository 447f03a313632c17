#include <Eigen/Cholesky>
#include <cmath>

#include <gtest/gtest.h>
#include <surfel/texture/unresolved_detail.h>

#include "fit_support.h"
#include "solve/direct_solve.h"

namespace surfel {
namespace {

using test::direct_solve;
using test::flat_basis;
using test::place_of;

/// Checkers of that many spacings at the points, whose edges are some half a spacing wide.
Array<Channels> checker(const SurfelBasis& basis, const Quadrature& points, double square) {
  Array<Channels> f(points.size());
  for (std::size_t i = 0; i < basis.size(); ++i) {
    for (std::size_t q = points.begin[i]; q < points.begin[i + 1]; ++q) {
      const Vec2d p = place_of(basis, points, i, q);
      const auto sign = [&](double x) { return std::tanh(6 * std::sin(M_PI * x / square)); };
      f[q] = Channels(0.5 + 0.4 * sign(p.x()) * sign(p.y()), 0.5, 0.3, 0);
    }
  }
  return f;
}

/// Surfels with coefficients fitted to a checker of fine squares in the left half, of coarse ones
/// in the right half.
struct Halves {
  static constexpr int kSide = 32;
  SurfelBasis basis = flat_basis(kSide, 0.9);
  Quadrature points = cover_surface(basis);
  RenderSystem system = assemble_render_system(basis, points, {.cutoff = 2});
  Array<Channels> f = checker(basis, points, 8);
  Array<Channels> w_0;
  Array<Channels> w;

  Halves() {
    const Array<Channels> fine = checker(basis, points, 1.1);
    for (std::size_t k = 0; k < basis.size(); ++k) {
      if (basis.function[k].position.x() > kSide / 2.0) continue;
      std::copy(fine.begin() + points.begin[k], fine.begin() + points.begin[k + 1],
                f.begin() + points.begin[k]);
    }
    // About what ewa gives: the mean under every kernel.
    w_0 = system.near.multiply_transposed(f);
    const Array<Channels> weight =
        system.near.multiply_transposed(Array<Channels>(f.size(), Channels::Ones()));
    for (std::size_t k = 0; k < w_0.size(); ++k) w_0[k] /= weight[k];
    w = solve();
  }

  Array<Channels> solve() const {
    return direct_solve(system.normal_matrix, system.right_side(f, w_0));
  }
  /// In the fine half, or in the coarse one, five spacings from the other and from the border.
  bool left(std::size_t k) const { return inside(k, 0); }
  bool right(std::size_t k) const { return inside(k, kSide / 2); }
  bool inside(std::size_t k, double first_x) const {
    const Vec3d& p = basis.function[k].position;
    return p.x() > first_x + 5 && p.x() < first_x + kSide / 2 - 5 && p.y() > 5 && p.y() < kSide - 5;
  }
};

TEST(UnresolvedDetail, TellsTextureThatSurfelsCannotHoldFromEdges) {
  const Halves h;
  const Array<double> share = unresolved_share(h.system, h.w, h.f);
  int right = 0;
  int high = 0;
  for (std::size_t k = 0; k < share.size(); ++k) {
    if (h.left(k)) {
      EXPECT_GT(share[k], 0.5);
    }
    if (h.right(k)) {
      ++right;
      high += share[k] > 0.3 ? 1 : 0;
    }
  }
  // Inside squares, where the texture is constant, ringing may be all there is.
  EXPECT_LT(high, right / 20);
}

TEST(UnresolvedDetail, HoldsWhatItCannotFitAndLeavesTheRest) {
  Halves h;
  const std::size_t held = hold_unresolved(h.system, h.w, h.f);
  EXPECT_GT(held, 300U);
  EXPECT_LT(held, 700U);  // Half of them, some where the halves meet, and at the border.
  const Array<Channels> w = h.solve();
  double left = 0;
  double left_before = 0;
  double right = 0;
  double right_before = 0;
  for (std::size_t k = 0; k < w.size(); ++k) {
    const double change = (w[k] - h.w_0[k]).square().sum();
    const double change_before = (h.w[k] - h.w_0[k]).square().sum();
    if (h.left(k)) {
      left += change;
      left_before += change_before;
      EXPECT_GT(h.system.pull(k), h.system.lambda);
    }
    if (h.right(k)) {
      right += change;
      right_before += change_before;
    }
  }
  EXPECT_LT(left, 0.01 * left_before);
  EXPECT_NEAR(right / right_before, 1, 0.1);
}

TEST(UnresolvedDetail, HeldSystemsAreThatLeastSquaresProblem) {
  Halves h;
  hold_unresolved(h.system, h.w, h.f);
  const Array<Channels> w = h.solve();
  const auto objective = [&](const Array<Channels>& x) {
    return (h.system.near.residual2(x, h.f) + h.system.pull2(x, h.w_0)).sum();
  };
  const double least = objective(w);
  for (const std::size_t k : {40U, 500U, 990U}) {
    for (const double step : {-1e-3, 1e-3}) {
      Array<Channels> other = w;
      other[k][0] += step;
      EXPECT_GT(objective(other), least);
    }
  }
  Array<double> ones;
  ones.assign(h.points.size(), 1.0);
  const SymmetricMatrix weighted = h.system.weighted_normal_matrix(ones);
  for (std::size_t k = 0; k < w.size(); ++k) {
    EXPECT_NEAR(weighted.diagonal(k) / h.system.normal_matrix.diagonal(k), 1, 1e-12);
  }
}

TEST(UnresolvedDetail, ConstantTexturesAndNoneAreResolved) {
  const SurfelBasis basis = flat_basis(8, 0.9);
  const Quadrature points = cover_surface(basis);
  RenderSystem system = assemble_render_system(basis, points);
  const Array<Channels> f(points.size(), Channels(0.2, 0.4, 0.8, 1));
  const Array<Channels> w(basis.size(), Channels(0.2, 0.4, 0.8, 1));
  EXPECT_EQ(hold_unresolved(system, w, f), 0U);
  EXPECT_TRUE(system.held.empty());
  const SurfelBasis none;
  RenderSystem empty = assemble_render_system(none, cover_surface(none));
  EXPECT_EQ(hold_unresolved(empty, {}, {}), 0U);
}

}  // namespace
}  // namespace surfel
