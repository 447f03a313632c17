#pragma once

// Gaussians in space that stand for several: what levels of detail and simplification have in
// common.

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/gaussian_cloud.h>

namespace surfel {

/// Gaussians on the way to be merged, as columns. They keep moments, of which opacities and sizes
/// are made at the end, so that merging in steps gives the Gaussian that merging at once does.
struct SURFEL_API MergeGaussians {
  /// `source` of Gaussians that are merged.
  static constexpr std::uint32_t kMerged = UINT32_MAX;

  AmplitudeRule rule = AmplitudeRule::kOpacity;
  std::size_t stride = 3;  ///< Numbers in `harmonics` for each Gaussian.
  Array<Vec3f> position;
  Array<std::array<float, 6>> covariance;  ///< xx xy xz yy yz zz, scene unit^2.
  /// Opacity times mean_projection(); of densities the integral over space.
  Array<float> mass;
  /// Integral of the optical depth over a picture plane in the mean over all directions; of
  /// densities the mass.
  Array<float> depth;
  Array<std::uint32_t> source;  ///< The Gaussian of the cloud that this one is, or kMerged.
  Array<float> harmonics;

  std::size_t size() const { return position.size(); }
  void resize(std::size_t size);
  float* harmonics_of(std::size_t i) { return harmonics.data() + i * stride; }
  const float* harmonics_of(std::size_t i) const { return harmonics.data() + i * stride; }
  /// Gaussian `to` becomes Gaussian i of others.
  void assign(std::size_t to, const MergeGaussians& others, std::size_t i);
  /// Gaussian i becomes the sum of itself and Gaussian j: masses and depths are added; mean,
  /// covariance (within and between the two) and harmonics are weighted by mass.
  void merge(std::size_t i, std::size_t j);
};

/// Is a Gaussian of a cloud worth merging: can a trained renderer show it at all? Not with an
/// opacity below 1/255, which none of them blends, not without a mass (points and lines), and not
/// further away than kLargestExtent.
SURFEL_API bool has_mass(const GaussianCloud& cloud, std::size_t i);

/// Takes the Gaussians without has_mass() out of an order, and returns how many. Throws
/// Error(kInput), starting with `name`, where none is left, and where sums of masses or squares of
/// lengths would overflow.
SURFEL_API std::size_t without_massless(const GaussianCloud& cloud, Array<std::uint32_t>& order,
                                        const std::string& name);

/// Gaussians of a cloud, in the order of `which`.
SURFEL_API MergeGaussians merge_gaussians(const GaussianCloud& cloud,
                                          std::span<const std::uint32_t> which);

/// The Gaussians to be drawn, in the same order. The ones that were not merged are as they are in
/// `cloud`, of which the result also has what it says of all Gaussians.
///
/// A merged density has the mass. A merged opacity is the one that hides as much through the middle
/// as the members do, one behind the other, so that haze stays haze. Where members overlap it has
/// less than the members' mass: the Gaussian is then enlarged, as far as it, with its neighbours,
/// would be clearer than the members; so a wall of overlapping opaque Gaussians stays closed,
/// although merged ones with just the members' covariance leave gaps. Clearness is the optical
/// depth across the Gaussian's flat side, as full clouds have it where Gaussians are smaller than
/// pixels: the sum of opacities, spread by the pixel filter.
SURFEL_API GaussianCloud drawn_gaussians(const MergeGaussians& gaussians,
                                         const GaussianCloud& cloud);

}  // namespace surfel
