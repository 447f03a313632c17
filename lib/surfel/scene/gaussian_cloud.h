#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/cluster_tree.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// What the amplitude of a Gaussian in space stands for, and what becomes of it on screen.
enum class AmplitudeRule : std::uint8_t {
  /// A sample of a surface: kernels are divided by their sum (SS01 (6), (9)).
  kSurfel,
  /// The opacity at the kernel's centre, whatever the pixel filter adds to its size (3D Gaussian
  /// splatting).
  kOpacity,
  /// The opacity, reduced as the pixel filter spreads the kernel: times sqrt(|S| / |S + filter|),
  /// with S the kernel's variance on screen (Mip-Splatting).
  kCompensated,
  /// The density of a medium at the kernel's centre, optical depth per scene unit, which a ray
  /// integrates.
  kDensity,
};

/// Which renderer a file of trained Gaussians was trained with, as far as the file says.
enum class TrainedWith : std::uint8_t { kUnknown, kInria, kMip, k2dgs };

/// Gaussians in space with colours by direction: trained splats, or volumes. Columns are as long as
/// `position`.
struct SURFEL_API GaussianCloud {
  /// Highest degree of spherical harmonics.
  static constexpr int kMostDegree = 4;
  /// The spherical harmonic of degree 0, 1 / sqrt(4 pi): a colour that does not depend on the
  /// direction is 0.5 + kHarmonic0 * coefficient.
  static constexpr double kHarmonic0 = 0.28209479177387814;

  Vec3d origin{0, 0, 0};  ///< Added to positions: world coordinates, scene units.
  Array<Vec3f> position;
  Array<Vec3f> scale;  ///< Standard deviations along the axes, scene units, >= 0.
  /// Unit quaternions w, x, y, z: their matrices have the axes as columns.
  Array<std::array<float, 4>> rotation;
  Array<float> amplitude;  ///< As `rule` says: an opacity, 0..1, or a density, >= 0.
  int degree = 0;          ///< Of the spherical harmonics, 0..kMostDegree.
  /// Coefficients of the spherical harmonics, (degree + 1)^2 for each Gaussian, each with red,
  /// green and blue, in the order and with the signs of 3D Gaussian splatting. A colour is
  /// 0.5 + sum(coefficient * basis(direction from the eye)), clamped at 0, as displays take it
  /// (sRGB).
  Array<float> harmonics;
  AmplitudeRule rule = AmplitudeRule::kOpacity;
  TrainedWith trained_with = TrainedWith::kUnknown;
  /// Upward direction where the file or its format says it.
  std::optional<Vec3d> up{};
  /// Gaussians that the file holds and that were left out because one of their values is not
  /// finite, or a scale too large for float arithmetic (kLargestExtent).
  std::size_t unusable_skipped = 0;
  /// Gaussians of coarser levels of detail that the file holds and that were not read.
  std::size_t coarser_skipped = 0;
  /// Levels of detail; empty: there are none, and all Gaussians are drawn.
  ClusterTree tree{};

  std::size_t size() const { return position.size(); }
  /// Numbers in `harmonics` for each Gaussian.
  std::size_t harmonics_stride() const {
    return static_cast<std::size_t>(3 * (degree + 1) * (degree + 1));
  }
  /// Makes all columns so long; the degree is set before.
  void resize(std::size_t size);
  /// Gaussian `to` becomes Gaussian i of a cloud with the same origin and degree.
  void assign(std::size_t to, const GaussianCloud& other, std::size_t i);
  /// What is said of all Gaussians together, without any of them and without levels.
  GaussianCloud without_gaussians() const;
};

}  // namespace surfel
