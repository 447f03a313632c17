#pragma once

// The coverage of pixels near edges by the sums of rho around them.

#include <array>

#include <surfel/base/export.h>

namespace surfel {

/// As a_k is the area that a surfel stands for, the sum of rho over its mean is the surface's
/// coverage, filtered by the mean kernel: the pixel filter, cut off at beta < c. It is uneven as
/// the samples are. To get the coverage as the pixel's whole Gaussian filters it, the sums are
/// filtered once more, which evens them out, and then sharpened by the ratio k of the widths: where
/// the surface ends at a straight line, each of the filters leaves a normal distribution Phi of the
/// distance, so that the sum S becomes Phi(k Phi^-1(S)). Near corners and in thin parts the
/// backward heat equation S - (k^2 - 1) / 2 Laplace(S), in units of the pixel filter, corrects
/// that; it holds for any shape to first order. Surfels are foreshortened across a silhouette, so
/// that k leaves their own extent out.
class SURFEL_API EdgeFilter {
 public:
  /// The filter's taps on either side of a pixel.
  static constexpr int kTaps = 2;
  /// Pixels on either side whose sums the coverage of a pixel depends on.
  static constexpr int kReach = kTaps + 1;
  static constexpr int kSide = 2 * kReach + 1;
  /// Surfaces end where filtered sums fall below this ...
  static constexpr float kEdgeSum = 0.5F;
  /// ... and surely so where they fall below this: elsewhere uneven sums are no edges.
  static constexpr float kSurelyEdge = 0.3F;

  /// For pictures of a cutoff and of a pixel filter's standard deviation, pixels.
  EdgeFilter(double cutoff, double lowpass);

  /// 1 / the mean sum of rho within a surface.
  float inv_mean() const { return inv_mean_; }
  /// Filters five values.
  float smooth(float a, float b, float middle, float c, float d) const {
    return taps_[0] * middle + (taps_[1] * (b + c) + taps_[2] * (a + d));
  }
  /// The coverage of a pixel by its filtered sum, over the mean, and that sum's Laplacian.
  float sharpened(float sum, float laplacian) const;
  /// The degree, 0 to 1, to which a surface ends that has a filtered sum so low near a pixel.
  static float edge_by(float low);

  /// A surface's sums over their mean, 1 at most, in the pixels around one, row by row.
  using Window = std::array<std::array<float, kSide>, kSide>;
  struct Edge {
    float degree = 0;    ///< To which the pixel is at the edge of its surface, 0 to 1.
    float coverage = 1;  ///< Of the pixel where it is.
  };
  /// How the pixel in the middle of a window is covered by the surface.
  /// \param at  at(column, row) is a value of the window, of which the inner ones are asked for
  ///            near edges alone.
  template <class At>
  Edge edge_of(const At& at) const {
    Window window;
    constexpr int kLast = kSide - 1;
    for (int i = 0; i < kSide; ++i) {
      window[0][i] = at(i, 0);
      window[kLast][i] = at(i, kLast);
    }
    for (int row = 1; row < kLast; ++row) {
      window[row][0] = at(0, row);
      window[row][kLast] = at(kLast, row);
    }
    const float degree = edge_by(least_of_border(window));
    if (degree == 0) return {};
    for (int row = 1; row < kLast; ++row) {
      for (int column = 1; column < kLast; ++column) window[row][column] = at(column, row);
    }
    return {degree, coverage_of(window)};
  }

 private:
  static constexpr int kTable = 512;

  static float least_of_border(const Window& window);
  float coverage_of(const Window& window) const;

  float inv_mean_;
  std::array<float, kTaps + 1> taps_;      ///< Of the filter, by distance.
  float backward_;                         ///< (k^2 - 1) / 2 h_s^2, pixels^2.
  std::array<float, kTable + 1> sharpen_;  ///< Phi(k Phi^-1(i / kTable)).
};

}  // namespace surfel
