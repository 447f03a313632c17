#include <algorithm>
#include <cmath>
#include <numbers>

#include <surfel/base/elementary.h>
#include <surfel/render/edge_filter.h>

namespace surfel {
namespace {

constexpr int kTaps = EdgeFilter::kTaps;

/// Samples of a Gaussian of a variance, pixels^2, that add up to 1.
std::array<double, kTaps + 1> gaussian(double variance) {
  std::array<double, kTaps + 1> taps;
  double sum = 0;
  for (int i = 0; i <= kTaps; ++i) {
    taps[i] = portable::exp(-i * i / (2 * variance));
    sum += (i == 0 ? 1 : 2) * taps[i];
  }
  for (double& tap : taps) tap /= sum;
  return taps;
}

std::array<float, kTaps + 1> rounded(const std::array<double, kTaps + 1>& taps) {
  return {static_cast<float>(taps[0]), static_cast<float>(taps[1]), static_cast<float>(taps[2])};
}

double variance_of(const std::array<double, kTaps + 1>& taps) {
  return 2 * (taps[1] + 4 * taps[2]);
}

/// Taps whose own variance is this one, as far as there are taps for it.
std::array<double, kTaps + 1> of_variance(double variance) {
  // Samples of narrow Gaussians have less variance than these.
  constexpr double kNarrow = 0.4;
  if (variance < kNarrow) return {1 - variance, variance / 2, 0};
  double low = 0;
  double high = 16;
  for (int i = 0; i < 60; ++i) {
    const double middle = (low + high) / 2;
    (variance_of(gaussian(middle)) < variance ? low : high) = middle;
  }
  return gaussian(high);
}

}  // namespace

EdgeFilter::EdgeFilter(double cutoff, double lowpass) {
  const double lost = portable::exp(-cutoff);
  inv_mean_ = static_cast<float>(1 / (1 - lost));
  inv_lowpass_ = static_cast<float>(1 / lowpass);
  // As wide as the pixel filter, but no wider than the taps allow.
  const auto even = gaussian(portable::squared(std::min(1.0, lowpass)));
  even_ = rounded(even);
  // The variance along an axis of a unit Gaussian cut off at beta < c is 1 - c e^-c / (1 - e^-c).
  const double lacking = cutoff * lost / (1 - lost);
  const double filter = lowpass * lowpass;
  // From this step on all is evened out.
  constexpr double kUneven = 2.5;
  for (int step = 0; step < kSpacingSteps; ++step) {
    const double share = std::min(1.0, step / kUneven);
    const auto taps =
        of_variance(lacking * filter + share * std::max(0.0, variance_of(even) - lacking * filter));
    const double k = std::sqrt(std::max(1.0, 1 - lacking + variance_of(taps) / filter));
    completing_[step] = {rounded(taps), static_cast<float>(k - 1)};
  }
}

float EdgeFilter::half_plane(float distance) const {
  // Polya's approximation of Phi, off by 0.003 at most.
  const float d = distance * inv_lowpass_;
  const double fall = portable::exp(-2 / std::numbers::pi * static_cast<double>(d * d));
  return 0.5F + 0.5F * std::copysign(static_cast<float>(std::sqrt(1 - fall)), d);
}

float EdgeFilter::mean_of_middle(const Window& window) {
  float sum = 0;
  for (int y = kReach - 1; y <= kReach + 1; ++y) {
    for (int x = kReach - 1; x <= kReach + 1; ++x) sum += window[y][x];
  }
  return sum / 9;
}

/// The least of means over parts of the window's border.
float EdgeFilter::least_of_border(const Window& window) {
  constexpr int kLast = kSide - 1;
  float low = 1;
  for (int i = 1; i < kLast; i += 2) {
    const auto mean = [&](int x0, int y0, int x1, int y1, int x2, int y2) {
      return (window[y0][x0] + window[y1][x1] + window[y2][x2]) / 3;
    };
    low = std::min({low, mean(i - 1, 0, i, 0, i + 1, 0), mean(i - 1, kLast, i, kLast, i + 1, kLast),
                    mean(0, i - 1, 0, i, 0, i + 1), mean(kLast, i - 1, kLast, i, kLast, i + 1)});
  }
  return low;
}

float EdgeFilter::completed(const Window& window, int step) const {
  std::array<float, 2 * kTaps + 1> rows;
  for (int y = 0; y <= 2 * kTaps; ++y) {
    const float* const s = window[y + kReach - kTaps].data() + kReach - kTaps;
    rows[y] = complete(step, s[0], s[1], s[2], s[3], s[4]);
  }
  // The mean kernel has so much of the pixel filter. Beyond it no more is covered than all.
  constexpr float kUneven = 0.05F;
  const float own = window[kReach][kReach];
  const float most = own / inv_mean_ + (1 - 1 / inv_mean_) + kUneven;
  const float sum = std::min(most, complete(step, rows[0], rows[1], rows[2], rows[3], rows[4]));
  // What is smaller than a pixel would lose what it covers beyond its kernels.
  constexpr float kSmall = 0.3F;
  return sum < kSmall ? std::max(sum, own) : sum;
}

}  // namespace surfel
