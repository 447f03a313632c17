#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Variance, along each axis of an image, of the triangle by which bilinear lookup interpolates.
inline constexpr double kBilinearVariance = 1.0 / 6;

/// Gaussian over an image. Texel units: x to the right, y down, texel (i, j) has its centre at
/// (i + 1/2, j + 1/2).
struct TexelKernel {
  Vec2d center{0, 0};
  Mat2d variance = Mat2d::Identity();  ///< Texel^2, positive definite.
  /// The kernel averages a bilinear lookup, whose kBilinearVariance is a part of its variance.
  bool bilinear = false;

  /// Is the kernel so narrow that the triangle of its bilinear lookup is seen? A wider one differs
  /// from a Gaussian by less than 1 percent of the image's finest waves.
  bool interpolates() const;
};

/// Eigenvalues of a symmetric positive semi-definite 2x2 matrix; `minor` does not cancel when the
/// ellipse is a sliver.
struct PrincipalVariances {
  double major = 0;
  double minor = 0;
};
SURFEL_API PrincipalVariances principal_variances(const Mat2d& variance);

/// The image's texel coordinates at (u, v); v = 0 is the bottom edge of the image.
inline Vec2d texel_position(const Vec2f& uv, int width, int height) {
  return {static_cast<double>(uv.x()) * width, (1 - static_cast<double>(uv.y())) * height};
}

/// A surfel's Gaussian seen from texture space, T^-1 V T^-T [SS01 section 5], with T the Jacobian
/// of the map from texels to the surface, 2x2, scene units per texel. The frame of T lies in the
/// plane of dpdu and dpdv; an anisotropic surfel's tangent is projected into it, so that a smooth
/// normal that leans away from its face does not shorten the kernel. Mirrored frames are fine.
/// \param cloud          Surfels with sizes and texture coordinates.
/// \param surfel         Number of the surfel, below cloud.size().
/// \param width, height  Of the image, texels.
/// \return texel^2; nullopt where there is none: derivatives that are zero, parallel (uv without
///         area) or not finite, or a variance that is negative or not finite.
///
/// The cloud must have the columns dpdu, dpdv and variance or (tangent, variance_u, variance_v).
SURFEL_API std::optional<Mat2d> texture_space_variance(const SurfelCloud& cloud, std::size_t surfel,
                                                       int width, int height);

/// T^-1 as a map from scene units to texels: a step d along the surface at the surfel moves
/// texel_position() by the product with it, and an isotropic Gaussian of variance 1 there becomes
/// the Gaussian of L L^T in the image. Nullopt where there is none, as above.
SURFEL_API std::optional<Eigen::Matrix<double, 2, 3>> texels_per_unit(const SurfelCloud& cloud,
                                                                      std::size_t surfel, int width,
                                                                      int height);
/// The same of a surface with these derivatives by the image's sides.
SURFEL_API std::optional<Eigen::Matrix<double, 2, 3>> texels_per_unit(const Vec3d& dpdu,
                                                                      const Vec3d& dpdv, int width,
                                                                      int height);

/// Longest axis of a kernel over its shortest up to which kernels commonly stay as they are: a
/// kernel's cost grows with this ratio.
inline constexpr double kMaxAspect = 128;

/// Widens a kernel whose longest axis is more than `max_aspect` >= 1 times its shortest until it is
/// that, which blurs but does not alias (Heckbert 1989). A kernel of a standard deviation above
/// 2^24 texels is shrunk to that first: no image is larger, and indices of texels fit into an int.
/// \return whether the kernel was widened.
SURFEL_API bool limit_kernel(Mat2d& variance, double max_aspect);

/// Sum over the texels of an unbounded image of the kernel, whose integral is 1, by Poisson's
/// summation formula, to 1e-8. It is 1 where both standard deviations are at least a texel; a
/// narrower kernel gains on a texel's centre and loses between texels, unless it interpolates().
/// \param kernel  both standard deviations at least 0.25 texels (time grows with 1 / variance).
SURFEL_API double lattice_sum(const TexelKernel& kernel);

}  // namespace surfel
