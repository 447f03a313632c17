#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <vector>

#include <surfel/base/bounds.h>
#include <surfel/base/export.h>
#include <surfel/measure/cloud_statistics.h>
#include <surfel/measure/histogram.h>
#include <surfel/scene/gaussian_cloud.h>

namespace surfel {

/// How many Gaussians pictures of a whole scene need.
struct PictureNeed {
  int rows = 0;  ///< Of the picture, which the longest side of the scene fills.
  /// Cubes with an edge of kGaussianLodError pixels in which the centre of a visible Gaussian lies.
  /// Where they are far fewer than the Gaussians, levels of detail or a simplified file look the
  /// same.
  std::size_t gaussians = 0;
};

/// Counts and measures of Gaussians in space. Lengths are in scene units; a scale is the largest
/// standard deviation of a Gaussian.
struct GaussianStatistics {
  std::size_t count = 0;
  Bounds bounds;           ///< Of the centres, world coordinates.
  Distribution amplitude;  ///< Opacities, or densities.
  Distribution scale;
  /// Largest standard deviation by the middle one: 1 for discs and spheres, large for needles. Of
  /// the Gaussians whose middle one is not zero.
  std::optional<Distribution> elongation;
  /// Smallest standard deviation by the middle one: 0 for discs, 1 for spheres and needles.
  std::optional<Distribution> flatness;
  Histogram amplitudes;  ///< Ten equal parts of 0..1, or of 0 to the largest density.
  Histogram scales;      ///< By powers of ten; scales of zero are in the lowest part.
  /// Opacity below 1 / 255: no renderer of splats draws these.
  std::size_t invisible = 0;
  /// Far from others: the seventh nearest one is ten times as far as in the median, and out of
  /// reach (three standard deviations). Most are remains of training.
  std::size_t isolated = 0;
  /// Larger than 20 times the median scale, and of an opacity below 0.1: veils before the scene.
  std::size_t veils = 0;
  std::array<PictureNeed, 4> needs{};  ///< Of 128, 256, 512 and 1024 rows.
};

/// Measures all Gaussians. Results do not depend on the number of threads. The cloud is not empty,
/// as a cloud that was read never is.
SURFEL_API GaussianStatistics gaussian_statistics(const GaussianCloud& cloud);

}  // namespace surfel
