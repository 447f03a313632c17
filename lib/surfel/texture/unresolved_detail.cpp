#include <algorithm>

#include <surfel/base/parallel.h>
#include <surfel/texture/unresolved_detail.h>

namespace surfel {
namespace {

constexpr std::size_t kColumnGrain = 1 << 11;
/// Share from which on functions are held, and from which on entirely. Measured on checkers, c = 1
/// to 4, sigma = 0.5 to 1 h: squares of 1.1 h leave 0.75 to 1, of 1.6 h 0.2 to 0.9, of 2.2 h up to
/// 0.3, larger ones less. At 2.2 h there is up to 8 dB to be gained, at 1.6 h more to be lost.
constexpr double kFirstShare = 0.2;
constexpr double kFullShare = 0.3;
/// Weight of |w - w_0|^2 by the mean diagonal where a function is held entirely: it leaves some
/// hundredth of w - w_0.
constexpr double kFullHold = 100;
/// Variance of a texture that counts as constant: a hundredth of the range of colours, squared.
constexpr double kNoVariance = 1e-4;

/// Sums over each function's own points of what body(q, sums) adds for each, covered ones only.
template <class Body>
Array<Channels> sum_points(const EvaluatedBasis& basis, const Body& body) {
  Array<Channels> sums(basis.A.columns, Channels::Zero());
  parallel_for(sums.size(), kColumnGrain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t k = begin; k < end; ++k) {
      for (std::size_t q = basis.point_begin[k]; q < basis.point_begin[k + 1]; ++q) {
        if (basis.A.row_begin[q] < basis.A.row_begin[q + 1]) body(q, sums[k]);
      }
    }
  });
  return sums;
}

}  // namespace

Array<double> unresolved_share(const RenderSystem& system, const Array<Channels>& w,
                               const Array<Channels>& f) {
  const EvaluatedBasis& near = system.near;
  Array<Channels> mean = sum_points(near, [&](std::size_t q, Channels& sum) { sum += f[q]; });
  // Squares of residuals and of the texture, and the number of points.
  Array<Channels> squares = sum_points(near, [&](std::size_t q, Channels& sum) {
    sum += Channels(near.residual(q, w, f).square().sum(), f[q].square().sum(), 1, 0);
  });
  // Weighed twice, which reaches as far as ringing does: inside the squares of a checker ringing
  // must not be taken for detail.
  const Array<Channels> none(mean.size(), Channels::Zero());
  for (Array<Channels>* sums : {&mean, &squares}) {
    *sums = system.far.residuals(system.far.residuals(*sums, none), none);
  }
  Array<double> share(mean.size());
  for (std::size_t k = 0; k < share.size(); ++k) {
    const double points = squares[k][2];
    share[k] = 0;
    if (points == 0) continue;
    const double variance = squares[k][1] / points - (mean[k] / points).square().sum();
    share[k] = squares[k][0] / points / (std::max(0.0, variance) + kNoVariance);
  }
  return share;
}

std::size_t hold_unresolved(RenderSystem& system, const Array<Channels>& w,
                            const Array<Channels>& f) {
  SymmetricMatrix& matrix = system.normal_matrix;
  const Array<double> share = unresolved_share(system, w, f);
  const double full = kFullHold * (system.mean_diagonal + system.lambda);
  system.held.assign(share.size(), 0.0);
  std::size_t held = 0;
  for (std::size_t k = 0; k < share.size(); ++k) {
    const double ramp = std::clamp((share[k] - kFirstShare) / (kFullShare - kFirstShare), 0.0, 1.0);
    if (ramp == 0) continue;
    ++held;
    system.held[k] = full * ramp * ramp;
    matrix.diagonal(k) += system.held[k];
  }
  if (held == 0) system.held.clear();
  return held;
}

}  // namespace surfel
