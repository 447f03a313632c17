// Hestenes, Stiefel 1952, "Methods of conjugate gradients for solving linear systems".

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <surfel/base/elementary.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/solve/bounded_gradients.h>
#include <surfel/solve/conjugate_gradients.h>
#include <surfel/solve/range_sums.h>
#include <surfel/solve/symmetric_product.h>

namespace surfel {
namespace {

using Mask = Eigen::Array<bool, 4, 1>;

class ConjugateSolver {
 public:
  ConjugateSolver(const SymmetricMatrix& matrix, const Array<Channels>& b,
                  const InverseFactor& factor, Array<Channels>& x, const SolveOptions& options)
      : matrix_(matrix), b_(b), factor_(factor), x_(x), options_(options), count_(b.size()) {}

  SolveReport run() {
    // The residual that is updated drifts from the true one: once it is small, iterations start
    // anew from the true one as long as that gains something.
    constexpr double kLeastGain = 0.5;
    allocate();
    Channels before = Channels::Constant(std::numeric_limits<double>::infinity());
    Channels residual = set_residual();
    while (!report_.indefinite && report_.iterations < options_.max_iterations) {
      const Mask active = residual > options_.tolerance && residual < kLeastGain * before;
      if (!active.any()) break;
      before = residual;
      iterate(active, residual);
      residual = set_residual();
    }
    report_.residual = residual.maxCoeff();
    report_.converged = report_.residual <= options_.tolerance;
    return report_;
  }

 private:
  void allocate() {
    residual_.resize(count_);
    residual_f_.resize(count_);
    half_.resize(count_);
    product_.resize(count_);
    direction_.assign(count_, Channels::Zero());
    const Channels norm2 =
        sum_of(count_, kUnknownGrain, [&](std::size_t i) -> Channels { return b_[i].square(); });
    unit_ = (norm2 == 0).select(Channels::Ones(), norm2.sqrt());
    // Where b is zero the solution is zero, and a relative residual has no meaning.
    parallel_for(count_, kUnknownGrain, [&](std::size_t begin, std::size_t end, int) {
      for (std::size_t i = begin; i < end; ++i) {
        x_[i] = (norm2 == 0).select(Channels::Zero(), x_[i]);
      }
    });
  }

  /// The true residual, in units of |b|. Returns its norm.
  Channels set_residual() {
    matrix_.multiply(x_, product_);
    const Channels squares = sum_of(count_, kUnknownGrain, [&](std::size_t i) -> Channels {
      residual_[i] = (b_[i] - product_[i]) / unit_;
      residual_f_[i] = residual_[i].cast<float>();
      return residual_[i].square();
    });
    return squares.sqrt();
  }

  /// Until the channels of `active` have converged by the residual that is updated.
  void iterate(Mask active, const Channels& residual) {
    const double first = residual.maxCoeff();
    // The first direction is the preconditioned residual: beta is 0.
    Channels rho_before = Channels::Constant(std::numeric_limits<double>::infinity());
    while (active.any() && report_.iterations < options_.max_iterations) {
      const Channels rho = precondition();
      const Channels beta = active.select(rho / rho_before, 0);
      rho_before = (rho > 0).select(rho, 1);
      turn(beta);
      const Channels curvature = multiply();
      active = active && rho > 0;
      if ((active && !(curvature > 0)).any()) {
        report_.indefinite = true;
        break;
      }
      const Channels alpha = active.select(rho / curvature, 0);
      const Channels norm = advance(alpha);
      ++report_.iterations;
      active = active && norm > options_.tolerance;
      tell_decay(options_.progress, first, norm.maxCoeff(), options_.tolerance);
    }
  }

  /// y = G r. Returns y^T y = r^T G^T G r.
  Channels precondition() {
    return sum_ranges<1>(count_, [&](std::size_t begin, std::size_t end) {
      factor_.multiply(begin, end, residual_f_.data(), half_.data() + begin);
      Channels sum = Channels::Zero();
      for (std::size_t i = begin; i < end; ++i) sum += half_[i].cast<double>().square();
      return std::array{sum};
    })[0];
  }

  /// p = G^T y + beta p.
  void turn(const Channels& beta) {
    parallel_for(count_, kUnknownGrain, [&](std::size_t begin, std::size_t end, int) {
      std::array<ChannelsF, kUnknownGrain> gradient;
      factor_.multiply_transposed(begin, end, half_.data(), gradient.data());
      for (std::size_t i = begin; i < end; ++i) {
        direction_[i] = gradient[i - begin].cast<double>() + beta * direction_[i];
      }
    });
  }

  /// q = A p. Returns p^T q.
  Channels multiply() {
    matrix_.multiply(direction_, product_);
    return sum_of(count_, kUnknownGrain,
                  [&](std::size_t i) -> Channels { return direction_[i] * product_[i]; });
  }

  /// x += alpha p, r -= alpha q. Returns the norm of r.
  Channels advance(const Channels& alpha) {
    const Channels scaled = alpha * unit_;
    const Channels squares = sum_of(count_, kUnknownGrain, [&](std::size_t i) -> Channels {
      x_[i] += scaled * direction_[i];
      residual_[i] -= alpha * product_[i];
      residual_f_[i] = residual_[i].cast<float>();
      return residual_[i].square();
    });
    return squares.sqrt();
  }

  SymmetricProduct matrix_;
  const Array<Channels>& b_;
  const InverseFactor& factor_;
  Array<Channels>& x_;
  const SolveOptions& options_;
  const std::size_t count_;
  SolveReport report_;
  Channels unit_;  ///< |b|, or 1 where that is zero.
  Array<Channels> residual_, direction_, product_;
  Array<ChannelsF> residual_f_, half_;  ///< r, and y = G r.
};

}  // namespace

std::vector<std::string> SolveOptions::problems() const {
  std::vector<std::string> found;
  check_option(found, tolerance > 0 && tolerance < 1, "tolerance", tolerance, "in (0, 1)");
  check_option(found, max_iterations >= 0, "max_iterations", max_iterations, ">= 0");
  if (bounds && !(std::isfinite(bounds->lower) && std::isfinite(bounds->upper) &&
                  bounds->lower < bounds->upper)) {
    found.emplace_back("`bounds` must be two numbers, the lower first");
  }
  return found;
}

void tell_decay(const std::function<void(double)>& progress, double first, double now,
                double last) {
  if (!progress || !(now > 0 && first > last)) return;
  progress(std::clamp(portable::log(now / first) / portable::log(last / first), 0.0, 1.0));
}

SolveReport conjugate_gradients(const SymmetricMatrix& matrix, const Array<Channels>& b,
                                const InverseFactor& factor, Array<Channels>& x,
                                const SolveOptions& options) {
  require_usable(options);
  if (options.bounds) return bounded_gradients(matrix, b, factor, x, options);
  return ConjugateSolver(matrix, b, factor, x, options).run();
}

}  // namespace surfel
