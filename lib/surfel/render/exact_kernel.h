#pragma once

// Zwicker, Pfister, van Baar, Gross, "Surface Splatting", SIGGRAPH 2001 (SS01), equation (8), and
// Zwicker, Rasanen, Botsch, Dachsbacher, Pauly, "Perspective Accurate Splatting", 2004, on why.

#include <optional>

#include <surfel/base/export.h>
#include <surfel/render/ewa_kernel.h>
#include <surfel/render/splat.h>

namespace surfel {

/// Rectangle of the picture that is drawn, pixels, and the pixel filter.
struct ExactKernelView {
  double cutoff = 1;   ///< c of beta < c.
  double lowpass = 1;  ///< Standard deviation h_s of the low-pass filter, pixels.
  double margin = 0;   ///< The kernel's box reaches so many pixels further.
  double x0 = 0, y0 = 0, x1 = 0, y1 = 0;  ///< At most kMostBlockSize pixels a side.
  /// The rectangle begins at the first column or row of the picture's part that is drawn.
  bool first_column = true, first_row = true;
};

/// A splat's box and its exact kernel.
struct ExactKernel {
  Splat splat;  ///< Its box, depth, kExactKernel and tag; no colour.
  ExactSplat exact;
  bool first;  ///< The first pixel of its box in the picture is in the rectangle.
};

/// The perspective-exact resampling kernel, for splats that are so large on screen that the affine
/// approximation (4) displaces and deforms them: the projection is linearised anew in every pixel,
/// where its ray meets the tangent plane, instead of once at the surfel's centre. With u the hit in
/// standard deviations and J_x^-1 = du/dx there,
///
///   rho_k(x) = r_k(0) / |M|^(1/2) exp(-1/2 u^T M^-1 u),  M = I + h_s^2 J_x^-1 J_x^-T,   (8)
///
/// which is r_k(u) under magnification and agrees with (6) for small splats. In homogenous
/// coordinates u z^-1 and z^-1 are affine in x, so that nothing is singular on the way, for discs
/// that reach behind the eye included.
///
/// The box holds the disc's projection, clipped in camera space at the near plane, plus the reach
/// of the filter. (Beyond it, towards the plane's horizon, the linearised filter would reach
/// further and further: the part that is cut off there is below 3 % of the kernel's peak for a disc
/// that the eye looks along, and usually nothing.) Nothing is returned for a disc that is not seen:
/// outside of the rectangle, behind the near plane, or edge-on. Perspective projection only.
SURFEL_API std::optional<ExactKernel> make_exact_kernel(const SurfelInCamera& surfel,
                                                        const Camera& camera,
                                                        const ExactKernelView& view);

}  // namespace surfel
