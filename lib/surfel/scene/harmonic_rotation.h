#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>

#include <surfel/base/export.h>
#include <surfel/scene/gaussian_cloud.h>

namespace surfel {

/// Numbers of a colour's spherical harmonics up to the highest degree.
inline constexpr int kMostHarmonics =
    (GaussianCloud::kMostDegree + 1) * (GaussianCloud::kMostDegree + 1);

/// The spherical harmonics of a unit direction, in the order and with the signs of 3D Gaussian
/// splatting, which a colour's coefficients are multiplied by. Internal to the library.
SURFEL_API std::array<double, kMostHarmonics> harmonics_of(const Vec3d& direction);

/// Turns functions on the sphere that are sums of spherical harmonics. Internal to the library.
class HarmonicRotation {
 public:
  HarmonicRotation(const Eigen::Matrix3d& rotation, int degree);

  /// Turns the coefficients of one Gaussian, red, green and blue of each harmonic together.
  void turn(float* harmonics) const;

 private:
  std::size_t degree_;
  /// Takes a function's coefficients to the turned function's; zero where degrees differ.
  std::array<std::array<double, kMostHarmonics>, kMostHarmonics> matrix_{};
};

}  // namespace surfel
