// Knyazev 2001, "Toward the optimal preconditioned eigensolver: locally optimal block
// preconditioned conjugate gradient method" (here without blocks: two vectors for either end of the
// spectrum).

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>

#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/solve/range_sums.h>
#include <surfel/solve/spectrum.h>
#include <surfel/solve/symmetric_product.h>

namespace surfel {
namespace {

constexpr int kMinChannels = 2;  ///< The first channels seek the smallest eigenvalue.

/// Matrix of the Ritz problem in the span of the vector x, the gradient w and the last step p.
using Matrix3 = Eigen::Matrix3d;

/// The combination of x, w and p of extreme Rayleigh quotient. \param gram, energy  the products
/// of the vectors with one another, and with A in between.
Eigen::Vector3d extreme_combination(const Matrix3& gram, const Matrix3& energy, bool smallest) {
  // Directions that are nearly dependent would only add rounding errors.
  constexpr double kLeastShare = 1e-10;
  Eigen::Vector3d scale;
  for (int i = 0; i < 3; ++i) scale[i] = gram(i, i) > 0 ? 1 / std::sqrt(gram(i, i)) : 0;
  const Matrix3 unit = scale.asDiagonal() * gram * scale.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Matrix3> span(unit);
  Matrix3 basis = scale.asDiagonal() * span.eigenvectors();
  for (int i = 0; i < 3; ++i) {
    const double share = span.eigenvalues()[i];
    basis.col(i) *= share > kLeastShare ? 1 / std::sqrt(share) : 0;
  }
  Matrix3 reduced = basis.transpose() * energy * basis;
  // Directions that were left out get an eigenvalue at the other end of the spectrum.
  const double far = (smallest ? 2 : -2) * reduced.norm();
  for (int i = 0; i < 3; ++i) {
    if (!(span.eigenvalues()[i] > kLeastShare)) reduced(i, i) = far;
  }
  const Eigen::SelfAdjointEigenSolver<Matrix3> ritz(reduced);
  return basis * ritz.eigenvectors().col(smallest ? 0 : 2);
}

class Seeker {
 public:
  Seeker(const SymmetricMatrix& matrix, const InverseFactor& factor)
      : matrix_(matrix), factor_(factor), count_(matrix.rows()) {
    for (Array<Channels>* vectors : {&x_, &w_, &p_, &ax_, &aw_, &ap_}) {
      vectors->assign(count_, Channels::Zero());
    }
    gradient_.resize(count_);
    half_.resize(count_);
    for (std::size_t i = 0; i < count_; ++i) {
      for (int c = 0; c < 4; ++c) w_[i][c] = random_uniform(0, i, c) - 0.5;
    }
  }

  Spectrum run(int steps) {
    Spectrum spectrum;
    int standing = 0;
    for (int i = 0; i <= steps && standing < 3; ++i) {
      if (i > 0) find_gradient();
      combine();
      const Spectrum before = spectrum;
      spectrum.min = value_.head<kMinChannels>().minCoeff();
      spectrum.max = value_.tail<4 - kMinChannels>().maxCoeff();
      constexpr double kStanding = 0.005;  // Estimates are good to a few percent.
      const bool stands =
          std::abs(spectrum.min - before.min) <= kStanding * std::abs(spectrum.min) &&
          spectrum.max - before.max <= kStanding * spectrum.max;
      standing = stands ? standing + 1 : 0;
    }
    return spectrum;
  }

 private:
  /// w = the gradient of the Rayleigh quotient, preconditioned for the smallest eigenvalue.
  void find_gradient() {
    parallel_for(count_, kUnknownGrain, [&](std::size_t begin, std::size_t end, int) {
      for (std::size_t i = begin; i < end; ++i) {
        w_[i] = ax_[i] - value_ * x_[i];
        gradient_[i] = w_[i].cast<float>();
      }
    });
    parallel_for(count_, kUnknownGrain, [&](std::size_t begin, std::size_t end, int) {
      factor_.multiply(begin, end, gradient_.data(), half_.data() + begin);
    });
    parallel_for(count_, kUnknownGrain, [&](std::size_t begin, std::size_t end, int) {
      std::array<ChannelsF, kUnknownGrain> preconditioned;
      factor_.multiply_transposed(begin, end, half_.data(), preconditioned.data());
      for (std::size_t i = begin; i < end; ++i) {
        w_[i].head<kMinChannels>() = preconditioned[i - begin].head<kMinChannels>().cast<double>();
      }
    });
  }

  /// x = the best combination of x, w and p, with p the part of it that is not x.
  void combine() {
    matrix_.multiply(w_, aw_);
    const auto sums = sum_ranges<12>(count_, [&](std::size_t begin, std::size_t end) {
      std::array<Channels, 12> s;
      s.fill(Channels::Zero());
      for (std::size_t i = begin; i < end; ++i) {
        const std::array<const Channels*, 3> v{&x_[i], &w_[i], &p_[i]};
        const std::array<const Channels*, 3> av{&ax_[i], &aw_[i], &ap_[i]};
        std::size_t slot = 0;
        for (std::size_t a = 0; a < 3; ++a) {
          for (std::size_t b = 0; b <= a; ++b, ++slot) {
            s[slot] += *v[a] * *v[b];
            s[slot + 6] += *v[a] * *av[b];
          }
        }
      }
      return s;
    });
    std::array<Channels, 3> factor;
    for (int c = 0; c < 4; ++c) {
      Matrix3 gram, energy;
      std::size_t slot = 0;
      for (int a = 0; a < 3; ++a) {
        for (int b = 0; b <= a; ++b, ++slot) {
          gram(a, b) = gram(b, a) = sums[slot][c];
          energy(a, b) = energy(b, a) = sums[slot + 6][c];
        }
      }
      const Eigen::Vector3d best = extreme_combination(gram, energy, c < kMinChannels);
      for (std::size_t a = 0; a < 3; ++a) factor[a][c] = best[static_cast<Eigen::Index>(a)];
    }
    const auto [norms, energies] = sum_ranges<2>(count_, [&](std::size_t begin, std::size_t end) {
      std::array<Channels, 2> s{Channels::Zero(), Channels::Zero()};
      for (std::size_t i = begin; i < end; ++i) {
        p_[i] = factor[1] * w_[i] + factor[2] * p_[i];
        ap_[i] = factor[1] * aw_[i] + factor[2] * ap_[i];
        x_[i] = factor[0] * x_[i] + p_[i];
        ax_[i] = factor[0] * ax_[i] + ap_[i];
        s[0] += x_[i].square();
        s[1] += x_[i] * ax_[i];
      }
      return s;
    });
    value_ = (norms > 0).select(energies / norms, 0);
  }

  SymmetricProduct matrix_;
  const InverseFactor& factor_;
  const std::size_t count_;
  Channels value_ = Channels::Zero();  ///< Rayleigh quotients of x.
  Array<Channels> x_, w_, p_, ax_, aw_, ap_;
  Array<ChannelsF> gradient_, half_;
};

}  // namespace

Spectrum estimate_spectrum(const SymmetricMatrix& matrix, const InverseFactor& factor, int steps) {
  return Seeker(matrix, factor).run(steps);
}

}  // namespace surfel
