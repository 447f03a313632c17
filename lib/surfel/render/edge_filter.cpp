#include <algorithm>
#include <cmath>
#include <numbers>

#include <surfel/base/elementary.h>
#include <surfel/render/edge_filter.h>

namespace surfel {
namespace {

double normal_distribution(double z) { return portable::erfc(-z / std::numbers::sqrt2) / 2; }

/// Deviations from a straight edge's opacity that uneven sums make, too: of small sums, as of what
/// is smaller than a pixel, a share.
constexpr float kUneven = 0.03F;
constexpr float kUnevenShare = 0.1F;

/// Sums below this that are larger than the sums around them are of something smaller than a pixel:
/// outside of a straight edge sums are smaller than the mean of the sums around.
constexpr float kSmall = 0.3F;

bool is_small(float sum, float laplacian) { return sum < kSmall && laplacian < 0; }

}  // namespace

EdgeFilter::EdgeFilter(double cutoff, double lowpass) {
  const double lost = portable::exp(-cutoff);
  inv_mean_ = static_cast<float>(1 / (1 - lost));
  // As wide as the pixel filter, but no wider than the taps allow.
  const double deviation = std::min(1.0, lowpass);
  double sum = 0;
  double variance = 0;
  std::array<double, kTaps + 1> taps;
  for (int i = 0; i <= kTaps; ++i) {
    taps[i] = portable::exp(-portable::squared(i / deviation) / 2);
    sum += (i == 0 ? 1 : 2) * taps[i];
    variance += 2 * taps[i] * i * i;
  }
  variance /= sum;
  for (int i = 0; i <= kTaps; ++i) taps_[i] = static_cast<float>(taps[i] / sum);
  // The variance along an axis of a unit Gaussian cut off at beta < c is 1 - c e^-c / (1 - e^-c).
  const double of_kernel = 1 - cutoff * lost / (1 - lost);
  const double k2 = of_kernel + variance / (lowpass * lowpass);
  backward_ = static_cast<float>((k2 - 1) / 2 * lowpass * lowpass);
  // The table's places are found as z goes from far outside to far inside.
  const double k = std::sqrt(k2);
  constexpr double kFar = 6;
  constexpr int kSteps = 4096;
  double before = 0;
  double sharp_before = 0;
  int next = 0;
  for (int step = 0; step <= kSteps; ++step) {
    const double z = kFar * (2.0 * step / kSteps - 1);
    const double here = step == kSteps ? 1 : normal_distribution(z);
    const double sharp = step == kSteps ? 1 : normal_distribution(k * z);
    for (; next <= kTable && next <= here * kTable; ++next) {
      const double share = here > before ? (1.0 * next / kTable - before) / (here - before) : 0;
      sharpen_[next] = static_cast<float>(sharp_before + share * (sharp - sharp_before));
    }
    before = here;
    sharp_before = sharp;
  }
}

float EdgeFilter::sharpened(float sum, float laplacian) const {
  const float place = std::clamp(sum, 0.0F, 1.0F) * kTable;
  const int i = std::min(static_cast<int>(place), kTable - 1);
  const float straight =
      sharpen_[i] + (place - static_cast<float>(i)) * (sharpen_[i + 1] - sharpen_[i]);
  const float difference = sum - backward_ * laplacian - straight;
  const float uneven =
      is_small(sum, laplacian) ? 0 : std::min({kUneven, kUnevenShare * sum, sum * sum});
  const float other = difference - std::clamp(difference, -uneven, uneven);
  return std::clamp(straight + other, 0.0F, 1.0F);
}

float EdgeFilter::edge_by(float low) {
  return std::clamp((kEdgeSum - low) / (kEdgeSum - kSurelyEdge), 0.0F, 1.0F);
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

float EdgeFilter::coverage_of(const Window& window) const {
  // By the row of the window and the column from the one left of the middle.
  std::array<std::array<float, 3>, kSide> rows;
  for (int y = 0; y < kSide; ++y) {
    const float* const s = window[y].data();
    for (int x = 0; x < 3; ++x) {
      rows[y][x] = smooth(s[x], s[x + 1], s[x + 2], s[x + 3], s[x + 4]);
    }
  }
  const auto at = [&](int x, int y) {
    return smooth(rows[y][x], rows[y + 1][x], rows[y + 2][x], rows[y + 3][x], rows[y + 4][x]);
  };
  const float sum = at(1, 1);
  const float laplacian = (at(0, 1) + at(2, 1)) + (at(1, 0) + at(1, 2)) - 4 * sum;
  const float coverage = sharpened(sum, laplacian);
  // What is smaller than a pixel would lose what it covers beyond its kernels.
  return is_small(sum, laplacian) ? std::max(coverage, window[kReach][kReach]) : coverage;
}

}  // namespace surfel
