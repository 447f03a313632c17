#pragma once

// Kernels of surfels that end at lines: at the border of a surface, or at a crease, where another
// surface begins.

#include <surfel/base/export.h>
#include <surfel/render/ewa_kernel.h>
#include <surfel/render/splat.h>

namespace surfel {

/// What a half-plane leaves of a resampling kernel. The Gaussian of variance V, cut by n . u <= d
/// and then blurred by the pixel filter, is the kernel (6) times
///
///   Phi((d - n . m(x)) / s),   m(x) = V J^T Sigma^-1 (x - x_k),   s^2 = n^T (V - V J^T Sigma^-1 J
///   V) n:
///
/// m is the mean place on the surfel of what is seen at x, and s its deviation along n. That is
/// exact. Two half-planes leave a and b, and both together c(a, b):
///
///   (1 - w) a b + w min(a, b), or where w < 0 (1 + w) a b - w max(0, a + b - 1),
///
/// with w = 2 / pi asin(r), r being the correlation of the places along their directions, given x.
/// That is exact where the two are independent (the product), for parallel lines, and at the point
/// of a wedge, and off by less than 0.035 in between.
struct ClipShare {
  double at_center = 0;            ///< The argument of Phi at the kernel's centre ...
  Eigen::Vector2d gradient{0, 0};  ///< ... and what it gains with every pixel.

  /// Phi at a pixel coordinate.
  /// \param center  EwaKernel::center.
  SURFEL_API double at(const Eigen::Vector2d& x, const Eigen::Vector2d& center) const;
};

/// The share of an affine kernel. No part of it cancels, at grazing angles or otherwise.
SURFEL_API ClipShare clip_share(const SurfelInCamera& surfel, const Camera& camera, double lowpass,
                                const ClipLine& line);

/// w of two lines of an affine kernel.
SURFEL_API double joint_share(const SurfelInCamera& surfel, const Camera& camera, double lowpass);
/// c of the shares of two lines.
SURFEL_API double joined(double a, double b, double w);

/// Unit vector across the projected line, away from the part of the surfel that stays. It is the
/// line's own, not its place on the surfel's: surfels on both sides of a crease have opposite
/// vectors. Zero where the eye lies on the line.
SURFEL_API Eigen::Vector2d outward_on_screen(const SurfelInCamera& surfel, const Camera& camera,
                                             const ClipLine& line);

/// A pixel at which a line leaves the share a of a surface has sums of rho with and without the
/// line whose ratio should be a. But beyond the line there are mirror images of the surfels alone
/// whose own kernels reach it (mirror_images()), while the pixel filter sees further: what lines
/// cut off stands for more than it is, by the factor
///
///   1 + q^2 (beyond_growth(c) + kBeyondSmall q^6),
///
/// where q = s^2 / n^T V n is the part of the surfel's variance along n that is left at a pixel: 0
/// where the surfel is large beside the filter, 1 where it is small. The formula is fitted to what
/// leaves the edge of evenly strewn surfels where it is, at cutoffs c from 1 to 4.
float beyond_growth(double cutoff);

/// The half-planes of a surfel whose kernel is exact, as rasterisers take them; set_up_splats() has
/// them of affine kernels.
SplatClip make_exact_clip(const SurfelInCamera& surfel, const Camera& camera);

}  // namespace surfel
