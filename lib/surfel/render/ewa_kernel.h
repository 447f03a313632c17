#pragma once

// Zwicker, Pfister, van Baar, Gross, "Surface Splatting", SIGGRAPH 2001 (SS01), sections 3 and 4.
//
// The plain scalar form of splat_setup.cpp, in double: the truth that the fast path is tested
// against, and the place to read the mathematics.

#include <Eigen/Core>
#include <optional>

#include <surfel/base/export.h>
#include <surfel/scene/camera.h>

namespace surfel {

/// A half-plane that a surfel is cut by: nothing is left beyond `distance` along `direction`.
struct ClipLine {
  Eigen::Vector3d direction{0, 0, 0};  ///< In camera space: unit, in the surfel's plane; or zero.
  double distance = 0;                 ///< From the surfel's centre, scene units.

  bool cuts() const { return !direction.isZero(0); }
};

/// Surfel in camera space, as the kernel sees it.
struct SurfelInCamera {
  Eigen::Vector3d position;  ///< Scene units, z forward.
  Eigen::Vector3d normal;    ///< Unit.
  Eigen::Vector3d tangent;   ///< Unit, perpendicular to the normal.
  double variance_u = 1;     ///< V = diag(variance_u, variance_v) in (tangent, normal x
  double variance_v = 1;     ///< tangent), unit^2.
  double area = 1;           ///< Amplitude a_k of the basis function, unit^2.
  ClipLine clip[2];          ///< Half-planes that it is cut by.
};

/// J: derivative of pixel coordinates by tangent plane coordinates at the surfel's centre. Its
/// column for a tangent vector t is f / p.z * (t.xy - p.xy / p.z * t.z): no inverse is taken, so J
/// stays finite at grazing angles, where SS01's J^-1 (section 4) does not exist.
SURFEL_API Eigen::Matrix2d screen_from_tangent_jacobian(const SurfelInCamera& surfel,
                                                        const Camera& camera);

/// Resampling kernel rho_k of one surfel [SS01 (6)], an elliptical Gaussian on screen:
/// Sigma = J V J^T + h_s^2 I, rho_k(x) = a_k |det J| G_Sigma(x - x_k).
struct EwaKernel {
  Eigen::Vector2d center;  ///< x_k, pixels.
  Eigen::Matrix2d Sigma;   ///< Pixels^2.
  double determinant = 1;  ///< |Sigma|, by a sum of positive terms.
  double amplitude = 0;    ///< rho_k(x_k).

  /// Exponent: beta(x) = 1/2 (x - x_k)^T Sigma^-1 (x - x_k); rho is cut off where beta >= cutoff.
  SURFEL_API double beta(const Eigen::Vector2d& x) const;
  /// Value at a pixel coordinate, not cut off.
  SURFEL_API double rho(const Eigen::Vector2d& x) const;
};

/// The kernel with a low-pass filter of standard deviation `lowpass` pixels (> 0). A surfel seen
/// edge-on is valid (its amplitude is 0). Nothing is returned for a centre at or behind the eye
/// plane.
SURFEL_API std::optional<EwaKernel> make_ewa_kernel(const SurfelInCamera& surfel,
                                                    const Camera& camera, double lowpass);

/// Inverse depth of the tangent plane, 1 / z, which is affine in pixel coordinates: its value at
/// the surfel's centre and its gradient per pixel. Orthographic: of -z, so that larger is always
/// nearer.
struct DepthPlane {
  double value = 0;
  Eigen::Vector2d gradient{0, 0};
};
SURFEL_API DepthPlane depth_plane(const SurfelInCamera& surfel, const Camera& camera);

}  // namespace surfel
