#pragma once

#include <surfel/base/export.h>
#include <surfel/base/types.h>

namespace surfel {

/// The integral over a picture plane of the projection of a Gaussian of peak 1, in the mean over
/// all directions of projection, scene unit^2: 2 pi s^2 for a ball of standard deviation s, pi s^2
/// for a disc. It is half of the surface of the ellipsoid of the standard deviations (Cauchy's
/// theorem, each projection's integral being twice the area of the ellipse).
/// \param scale  standard deviations along the axes, >= 0, in any order.
SURFEL_API double mean_projection(const Vec3d& scale);

/// The dilogarithm, the sum of x^k / k^2, of 0 <= x < 1. A kernel of opacity x / exp(-r^2 / 2) has
/// the optical depth -log(1 - x exp(-r^2 / 2)), whose integral is dilogarithm(x) by the integral
/// of exp(-r^2 / 2).
SURFEL_API double dilogarithm(double x);

/// The opacity in 0..most whose dilogarithm is `value`, or is nearest to it.
SURFEL_API double opacity_of_dilogarithm(double value, double most);

}  // namespace surfel
