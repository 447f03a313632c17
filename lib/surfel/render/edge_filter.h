#pragma once

// The coverage of pixels near edges by the sums of rho around them.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <utility>

#include <surfel/base/export.h>
#include <surfel/render/splat.h>

namespace surfel {

/// As a_k is the area that a surfel stands for, the sum of rho over its mean, S, is the surface's
/// coverage, filtered by the mean kernel: the pixel filter, cut off at beta < c. A further filter
/// of the variance that the cut-off kernel lacks makes that the coverage which the pixel's whole
/// Gaussian sees, whatever the shape is: straight edges, corners, bars, and gaps that are narrower
/// than a pixel.
///
/// Sums are uneven, as the samples are, the more so the further the surfels are apart. What is an
/// edge or a gap, and what is unevenness, is told by sums that are evened out by a filter as wide
/// as a pixel, and by the distance of the surfels. The further they are apart, the wider is the
/// filter of the coverage, too, which is sharpened again as a straight edge asks for.
class SURFEL_API EdgeFilter {
 public:
  /// The filters' taps on either side of a pixel.
  static constexpr int kTaps = 2;
  /// Pixels on either side whose sums the coverage of a pixel depends on.
  static constexpr int kReach = kTaps + 1;
  static constexpr int kSide = 2 * kReach + 1;

  /// For pictures of a cutoff and of a pixel filter's standard deviation, pixels.
  EdgeFilter(double cutoff, double lowpass);

  /// 1 / the mean sum of rho within a surface.
  float inv_mean() const { return inv_mean_; }
  /// Evens out five values.
  float smooth(float a, float b, float middle, float c, float d) const {
    return filtered(even_, a, b, middle, c, d);
  }
  /// Completes five values of a surface of a spacing_step().
  float complete(int step, float a, float b, float middle, float c, float d) const {
    return filtered(completing_[step].taps, a, b, middle, c, d);
  }
  /// Surfaces of splats of a spacing_step() end near pixels where the evened out sums, over the
  /// mean, fall below this: of random samples fewer than one in 10,000 such sums do.
  static constexpr float least_inside(int step) {
    return std::max(0.5F, 0.93F - 0.2F * static_cast<float>(step));
  }
  /// The coverage by a completed sum over the mean.
  float coverage(float sum, int step) const {
    // Where k is the ratio of the widths, a straight edge's Phi(d) is Phi(k Phi^-1(sum)), of which
    // the derivative by k is nearly this at k = 1.
    const float share = std::clamp(sum, 0.0F, 1.0F);
    const float sharper = 1.94F * (share - 0.5F) * std::sqrt(share * (1 - share));
    return std::clamp(share + completing_[step].sharpening * sharper, 0.0F, 1.0F);
  }
  /// What a sum over the mean has beyond the least one inside.
  static float slack(float sum, int step) { return sum - least_inside(step); }
  /// The degree, 0 to 1, to which a surface ends that has so little of evened out slack near a
  /// pixel. The larger splats are the less steep sums end, which asks for a longer ramp.
  static float edge_by(float slack, int step) {
    const float ramp = std::min(0.2F, 0.06F + 0.04F * static_cast<float>(step));
    return std::clamp(-slack / ramp, 0.0F, 1.0F);
  }

  /// What the pixel filter has of a half-plane, whose border is so many pixels away.
  float half_plane(float distance) const;

  /// A surface's sum over its mean in a pixel.
  struct Sample {
    float sum;
    int step;  ///< spacing_step() of the splats.
  };
  struct Edge {
    float degree = 0;    ///< To which the pixel is at the edge of its surface, 0 to 1.
    float coverage = 1;  ///< Of the pixel where it is.
  };
  /// How a pixel is covered by a surface.
  /// \param at    at(column, row) is the Sample of one of the kSide x kSide pixels around it, of
  ///              which some are asked for near edges alone.
  /// \param step  the spacing_step() of the surface's splats in the pixel.
  template <class At>
  Edge edge_of(const At& at, int step) const {
    Window sums;
    Window slacks;
    const auto fetch_square = [&](int around) {
      for (int row = kReach - around; row <= kReach + around; ++row) {
        for (int column = kReach - around; column <= kReach + around; ++column) {
          const int ring = std::max(std::abs(row - kReach), std::abs(column - kReach));
          if (ring < around && around > 1) continue;
          const Sample sample = at(column, row);
          sums[row][column] = sample.sum;
          slacks[row][column] = slack(sample.sum, sample.step);
        }
      }
    };
    if (goes_on(at)) return {};
    fetch_square(1);
    float degree = edge_by(mean_of_middle(slacks), step);
    if (degree < 1) {
      fetch_square(kReach);
      degree = std::max(degree, edge_by(least_of_border(slacks), step));
      if (degree == 0) return {};
    }
    fetch_square(kTaps);
    return {degree, coverage(completed(sums, step), step)};
  }

 private:
  /// Whether a surface has whole sums in a pixel and on all sides of it, so that it ends nowhere
  /// near: most pixels of most surfaces that others lie behind.
  template <class At>
  static bool goes_on(const At& at) {
    constexpr int kFar = 2;
    for (const auto& [x, y] :
         {std::pair(0, 0), std::pair(1, 0), std::pair(0, 1), std::pair(-1, 0), std::pair(0, -1),
          std::pair(1, 1), std::pair(-1, 1), std::pair(1, -1), std::pair(-1, -1)}) {
      const Sample sample = at(kReach + kFar * x, kReach + kFar * y);
      if (slack(sample.sum, sample.step) < 0) return false;
    }
    return true;
  }

  using Taps = std::array<float, kTaps + 1>;                   // By distance.
  using Window = std::array<std::array<float, kSide>, kSide>;  // Row by row.

  static float filtered(const Taps& taps, float a, float b, float middle, float c, float d) {
    return taps[0] * middle + (taps[1] * (b + c) + taps[2] * (a + d));
  }
  static float mean_of_middle(const Window& window);
  static float least_of_border(const Window& window);
  float completed(const Window& window, int step) const;

  struct Completing {
    Taps taps;
    float sharpening;  ///< k - 1.
  };

  float inv_mean_;
  float inv_lowpass_;
  Taps even_;
  std::array<Completing, kSpacingSteps> completing_;
};

}  // namespace surfel
