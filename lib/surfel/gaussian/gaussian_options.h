#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/scene/gaussian_cloud.h>

namespace surfel {

/// Whose picture of Gaussians is wanted. Renderers differ in their approximations, and trained
/// files make up for the approximations of the renderer that they were trained with.
enum class GaussianProfile : std::uint8_t {
  /// Kerbl et al. 2023, as published: centres nearer than 0.2 are skipped, affine kernels with a
  /// variance of 0.3 pixels^2 added, squares of 3 standard deviations in tiles of 16 x 16 pixels,
  /// order by the centres' depths, alpha at most 0.99 and not below 1/255, an end where the
  /// transmittance would fall below 1e-4.
  kInria,
  /// gsplat: rectangles of 3.33 standard deviations, or up to where alpha is 1/255, alpha at most
  /// 0.999, centres from 0.01 on.
  kGsplat,
  /// Mip-Splatting (Yu et al. 2024): as kInria, with a variance of 0.1 and compensated opacities.
  kMip,
  /// 2D Gaussian splatting (Huang et al. 2024): rays meet the planes of discs, whose exponent is
  /// not above the one of a filter around the disc's box; the third scale is left out.
  k2dgs,
  /// Kernels along rays in perspective, without affine approximation; a filter that keeps the
  /// kernels' mass; order by pixel, no least and no greatest alpha.
  kExact,
  /// Kernels as with kExact, but as samples of opaque surfaces: the ones that are of one surface by
  /// their depths are divided by their sum, and where they sum up to 1 nothing behind is seen.
  kSurfel,
};

/// Most samples in a pixel along each axis.
inline constexpr int kMostSamples = 4;

/// How a GaussianRenderer draws: profile, filter, order and limits.
struct GaussianOptions {
  GaussianProfile profile = GaussianProfile::kExact;
  /// Standard deviation of the pixel filter of kExact and kSurfel, pixels, 0.1..16. The default
  /// is the filter under which 3D Gaussian splatting trains. Other profiles have their own.
  double lowpass = 0.5477;
  /// Samples in a pixel along each axis of kExact, 1..kMostSamples; 0: 2 for densities, else 1.
  /// Several samples are drawn with a narrow filter each, and the pixel filter is applied to them
  /// when they are blended. One sample filters each kernel by itself instead, which makes opaque
  /// bodies of many faint kernels larger: the transmittance of all kernels is a product, whose
  /// filtered value is not the product of filtered values.
  int samples = 0;
  /// Linear R G B and straight alpha, each >= 0 and alpha at most 1; composited as displays take
  /// it, as the Gaussians are.
  std::array<float, 4> background{0, 0, 0, 0};
  /// With the channels Z, where the transmittance passes one half, and Z.mean, the mean depth by
  /// contributions; infinite where there is nothing.
  bool depth = false;
  /// Colours stay as displays take them (sRGB), premultiplied: what trained renderers give.
  /// Otherwise they are linear.
  bool display = false;

  /// Empty if usable, else one sentence per violated rule.
  SURFEL_API std::vector<std::string> problems() const;
};

/// The profile of the renderer that a file was trained with: kInria where it does not say, kExact
/// for densities, kSurfel for samples of surfaces.
SURFEL_API GaussianProfile profile_of(const GaussianCloud& cloud);

}  // namespace surfel
