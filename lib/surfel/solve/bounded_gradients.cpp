// Dostal, Schoeberl 2005, "Minimizing quadratic functions over non-negative cone with the rate of
// convergence and finite termination" (the method, MPRGP).
// Dostal 2009, "Optimal quadratic programming algorithms", 5.8 and 5.10 (preconditioned among the
// free unknowns). Gradients are compared, and gradient steps taken, in variables scaled to a unit
// diagonal.

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <surfel/base/parallel.h>
#include <surfel/solve/bounded_gradients.h>
#include <surfel/solve/range_sums.h>
#include <surfel/solve/symmetric_product.h>

namespace surfel {
namespace {

/// The next step of a channel; every step takes one product with the matrix.
enum class Move {
  kRest,       ///< It has converged.
  kConjugate,  ///< Conjugate gradients among the free unknowns.
  kRelease,    ///< Unknowns leave their bounds along the gradient.
  kExpand,     ///< The gradient is brought up to date after a projected step.
};

/// Conjugate gradients go on while the free gradient is at least this part of the gradient that
/// points inwards at bounds.
constexpr double kProportion = 1;
/// Gradient steps in units of 1 / |A|; convergence needs less than 2.
constexpr double kStep = 1.9;

struct Gradient {
  double free;     ///< Its part where x is between the bounds.
  double chopped;  ///< Its part where x is at a bound and would be moved inwards.
};

class BoundedSolver {
 public:
  BoundedSolver(const SymmetricMatrix& matrix, const Array<Channels>& b,
                const InverseFactor& factor, Array<Channels>& x, const SolveOptions& options)
      : matrix_(matrix),
        product_of_(matrix),
        b_(b),
        factor_(factor),
        x_(x),
        options_(options),
        lower_(options.bounds->lower),
        upper_(options.bounds->upper),
        count_(b.size()) {
    start();
  }

  SolveReport run() {
    // The gradient that is updated drifts from the true one: once it is small, iterations start
    // anew from the true one as long as that gains something.
    constexpr double kLeastGain = 0.5;
    double before = std::numeric_limits<double>::infinity();
    for (;;) {
      set_gradient();
      report_.residual = choose_moves().maxCoeff();
      report_.converged = all_rest();
      const bool gained = report_.residual < kLeastGain * before;
      if (all_rest() || !gained || report_.indefinite || out_of_iterations()) return report_;
      before = report_.residual;
      iterate(before);
    }
  }

 private:
  bool all_rest() const {
    return std::all_of(move_.begin(), move_.end(), [](Move m) { return m == Move::kRest; });
  }
  bool out_of_iterations() const { return report_.iterations >= options_.max_iterations; }

  void iterate(double first) {
    while (!all_rest() && !out_of_iterations()) {
      find_directions();
      multiply();
      if (report_.indefinite) return;
      step();
      ++report_.iterations;
      const Channels norm = choose_moves();
      tell_decay(options_.progress, first, norm.maxCoeff(), options_.tolerance);
    }
  }

  /// Moves x within the bounds.
  void start() {
    gradient_.resize(count_);
    free_f_.resize(count_);
    half_.resize(count_);
    direction_.resize(count_);
    product_.resize(count_);
    inverse_diagonal_.resize(count_);
    const Channels squares = sum_of(count_, kUnknownGrain, [&](std::size_t i) -> Channels {
      x_[i] = x_[i].max(lower_).min(upper_);
      direction_[i].setZero();
      const double diagonal = matrix_.diagonal(i);
      inverse_diagonal_[i] = diagonal > 0 ? 1 / diagonal : 1;
      return b_[i].square();
    });
    unit_ = (squares == 0).select(Channels::Ones(), squares.sqrt());
    const double norm = scaled_norm();
    step_ = norm > 0 ? kStep / norm : 1;
  }

  /// Largest sum of a row's absolute values, scaled to a unit diagonal.
  double scaled_norm() const {
    Array<double> sums;
    sums.assign(count_, 0.0);
    for (std::size_t i = 0; i < count_; ++i) {
      const double scale = std::sqrt(inverse_diagonal_[i]);
      for (std::uint64_t e = matrix_.row_begin[i]; e < matrix_.row_begin[i + 1]; ++e) {
        const std::uint32_t j = matrix_.column[e];
        const double value = scale * std::sqrt(inverse_diagonal_[j]) * std::abs(matrix_.value[e]);
        sums[i] += value;
        if (j != i) sums[j] += value;
      }
    }
    return count_ == 0 ? 1 : *std::max_element(sums.begin(), sums.end());
  }

  /// The true gradient, in units of |b|.
  void set_gradient() {
    product_of_.multiply(x_, product_);
    parallel_for(count_, kUnknownGrain, [&](std::size_t begin, std::size_t end, int) {
      for (std::size_t i = begin; i < end; ++i) gradient_[i] = (product_[i] - b_[i]) / unit_;
    });
    move_.fill(Move::kConjugate);
    anew_.fill(true);
  }

  Gradient split(double x, double gradient) const {
    const bool at_lower = x <= lower_;
    const bool at_upper = x >= upper_;
    if (at_lower && at_upper) return {0, 0};
    if (at_lower) return {0, std::min(gradient, 0.0)};
    if (at_upper) return {0, std::max(gradient, 0.0)};
    return {gradient, 0};
  }

  /// The free gradient, of which a gradient step's projection keeps only what leads to the bound.
  double reduced(double x, double free, double step) const {
    return free > 0 ? std::min(free, (x - lower_) / step) : std::max(free, (x - upper_) / step);
  }

  /// Returns the norm of the gradient's parts that are not zero at the solution.
  Channels choose_moves() {
    const auto [squares, reduced_free, chopped] =
        sum_ranges<3>(count_, [&](std::size_t begin, std::size_t end) {
          std::array<Channels, 3> sums;
          sums.fill(Channels::Zero());
          for (std::size_t i = begin; i < end; ++i) {
            const double w = inverse_diagonal_[i];
            for (int c = 0; c < 4; ++c) {
              const double x = x_[i][c];
              const Gradient g = split(x, gradient_[i][c]);
              sums[0][c] += g.free * g.free + g.chopped * g.chopped;
              sums[1][c] += w * g.free * reduced(x, g.free, step_ * w * unit_[c]);
              sums[2][c] += w * g.chopped * g.chopped;
              free_f_[i][c] = static_cast<float>(g.free);
            }
          }
          return sums;
        });
    Channels norm = squares.sqrt();
    for (int c = 0; c < 4; ++c) {
      if (move_[c] == Move::kExpand) continue;
      if (norm[c] <= options_.tolerance) {
        move_[c] = Move::kRest;
      } else if (chopped[c] > kProportion * kProportion * reduced_free[c]) {
        move_[c] = Move::kRelease;
      } else {
        if (move_[c] != Move::kConjugate) anew_[c] = true;
        move_[c] = Move::kConjugate;
      }
    }
    return norm;
  }

  /// Sets every channel's direction, down which x is moved, and how far it may be.
  void find_directions() {
    const Channels rho = sum_ranges<1>(count_, [&](std::size_t begin, std::size_t end) {
      factor_.multiply(begin, end, free_f_.data(), half_.data() + begin);
      Channels sum = Channels::Zero();
      for (std::size_t i = begin; i < end; ++i) sum += half_[i].cast<double>().square();
      return std::array{sum};
    })[0];
    Channels beta = Channels::Zero();
    for (int c = 0; c < 4; ++c) {
      if (move_[c] == Move::kConjugate && !anew_[c] && rho_[c] > 0) beta[c] = rho[c] / rho_[c];
    }
    rho_ = rho;
    Array<Channels> nearest((count_ + kUnknownGrain - 1) / kUnknownGrain);
    parallel_for(count_, kUnknownGrain, [&](std::size_t begin, std::size_t end, int) {
      std::array<ChannelsF, kUnknownGrain> preconditioned;
      factor_.multiply_transposed(begin, end, half_.data(), preconditioned.data());
      Channels reach = Channels::Constant(std::numeric_limits<double>::infinity());
      for (std::size_t i = begin; i < end; ++i) {
        for (int c = 0; c < 4; ++c) {
          if (move_[c] == Move::kExpand) continue;
          const double x = x_[i][c];
          const bool free = x > lower_ && x < upper_;
          double& p = direction_[i][c];
          if (move_[c] == Move::kConjugate) {
            p = free ? static_cast<double>(preconditioned[i - begin][c]) + beta[c] * p : 0;
          } else if (move_[c] == Move::kRelease) {
            p = inverse_diagonal_[i] * split(x, gradient_[i][c]).chopped;
          } else {
            p = 0;
          }
          if (p > 0) reach[c] = std::min(reach[c], (x - lower_) / (p * unit_[c]));
          if (p < 0) reach[c] = std::min(reach[c], (x - upper_) / (p * unit_[c]));
        }
      }
      nearest[begin / kUnknownGrain] = reach;
    });
    reach_.setConstant(std::numeric_limits<double>::infinity());
    for (const Channels& reach : nearest) reach_ = reach_.min(reach);
  }

  /// q = A p, and how long the step is.
  void multiply() {
    product_of_.multiply(direction_, product_);
    const auto [curvature, slope] = sum_ranges<2>(count_, [&](std::size_t begin, std::size_t end) {
      std::array<Channels, 2> sums{Channels::Zero(), Channels::Zero()};
      for (std::size_t i = begin; i < end; ++i) {
        sums[0] += direction_[i] * product_[i];
        sums[1] += direction_[i] * gradient_[i];
      }
      return sums;
    });
    for (int c = 0; c < 4; ++c) {
      if (move_[c] == Move::kRest) {
        alpha_[c] = 0;
      } else if (move_[c] == Move::kExpand) {
        alpha_[c] = 1;
      } else {
        report_.indefinite = report_.indefinite || !(curvature[c] > 0);
        alpha_[c] = slope[c] / curvature[c];
      }
    }
  }

  void step() {
    std::array<bool, 4> expand{};
    for (int c = 0; c < 4; ++c) {
      expand[c] = move_[c] == Move::kConjugate && alpha_[c] > reach_[c];
      if (move_[c] != Move::kExpand) alpha_[c] = std::min(alpha_[c], reach_[c]);
    }
    parallel_for(count_, kUnknownGrain, [&](std::size_t begin, std::size_t end, int) {
      for (std::size_t i = begin; i < end; ++i) {
        gradient_[i] -= alpha_ * product_[i];
        for (int c = 0; c < 4; ++c) {
          if (move_[c] == Move::kRest || move_[c] == Move::kExpand) continue;
          double& x = x_[i][c];
          x = std::clamp(x - alpha_[c] * unit_[c] * direction_[i][c], lower_, upper_);
          if (!expand[c]) continue;
          const double before = x;
          const double free = split(x, gradient_[i][c]).free;
          x = std::clamp(x - step_ * inverse_diagonal_[i] * unit_[c] * free, lower_, upper_);
          direction_[i][c] = (before - x) / unit_[c];
        }
      }
    });
    for (int c = 0; c < 4; ++c) {
      anew_[c] = move_[c] != Move::kConjugate;
      if (move_[c] == Move::kExpand) move_[c] = Move::kRelease;  // Not conjugate: these start anew.
      if (expand[c]) move_[c] = Move::kExpand;
    }
  }

  const SymmetricMatrix& matrix_;
  SymmetricProduct product_of_;
  const Array<Channels>& b_;
  const InverseFactor& factor_;
  Array<Channels>& x_;
  const SolveOptions& options_;
  const double lower_;
  const double upper_;
  const std::size_t count_;
  SolveReport report_;
  double step_ = 1;  ///< Length of the steps of projected gradients, in the scaled variables.
  Channels unit_;    ///< |b|, or 1 where that is zero.
  Channels rho_ = Channels::Zero();
  Channels alpha_;
  Channels reach_;  ///< The longest step along the direction that stays within the bounds.
  std::array<Move, 4> move_;
  std::array<bool, 4> anew_;  ///< The next conjugate step follows the gradient alone.
  Array<double> inverse_diagonal_;
  Array<Channels> gradient_, direction_, product_;
  Array<ChannelsF> free_f_, half_;
};

}  // namespace

SolveReport bounded_gradients(const SymmetricMatrix& matrix, const Array<Channels>& b,
                              const InverseFactor& factor, Array<Channels>& x,
                              const SolveOptions& options) {
  return BoundedSolver(matrix, b, factor, x, options).run();
}

}  // namespace surfel
