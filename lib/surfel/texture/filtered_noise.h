#pragma once

#include <array>
#include <cstdint>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/sample/noise.h>
#include <surfel/texture/kernel_axes.h>

namespace surfel {

/// The most octaves that SolidNoise has.
inline constexpr int kMostOctaves = 16;

/// Gradient noise whose lattice points have independent gradients, of components uniform in
/// [-1, 1). The gradients of gradient_noise(), which cost less, depend on their neighbours': the
/// mean square of its values is a tenth higher.
///
/// \param place  in lattice cells, each coordinate below 2^52.
SURFEL_API NoiseValue<3> independent_noise(const Vec3d& place, std::uint64_t seed);

/// Mean square of independent_noise() over all places and seeds: the integral of the squared
/// influence of a lattice point, (1/3) of 3 B A^2 with A and B the integrals over [-1, 1] of the
/// squares of q(t) and t q(t), q = 1 - fade(|t|).
inline constexpr double kNoiseVariance = 0.036459;

/// Mean square of a component of its gradient, divided by kNoiseVariance.
inline constexpr double kNoiseBandwidth = 6.8048;

/// Share of independent_noise() that is left where a Gaussian averages it: the slope of the
/// regression of the averaged noise on the noise, det(I + c / m D D^T)^(-m / 2) with
/// c = kNoiseBandwidth and m = 1.5. Exact to second order in D. Against the expectation of the
/// noise's autocorrelation under the Gaussian, within 0.012 where both axes are equal and within
/// 0.06 where one is zero, whatever the plane. The mean square of the averaged noise is the noise's
/// times noise_response(sqrt(2) D).
///
/// \param axes  D, in lattice cells.
SURFEL_API double noise_response(const KernelAxes& axes);

/// Octaves of independent_noise(), each on a lattice moved by a shift of its own, with a mean
/// square of 1 in all.
struct SolidNoise {
  int octaves = 8;           ///< 1..kMostOctaves.
  double gain = 0.5;         ///< Amplitude of an octave by the amplitude of the octave before, > 0.
  Vec3d frequency{1, 1, 1};  ///< Lattice cells of the first octave per unit, by axis.
  std::uint64_t seed = 1;
};

/// A noise's distribution over a Gaussian: its mean, the mean's gradient, and the variance that
/// moving the mean along the gradient does not explain.
struct NoiseMoments {
  double mean = 0;
  Vec3d gradient{0, 0, 0};  ///< Per unit of the position.
  double variance = 0;
};

/// Noise averaged over Gaussians of one shape by octave clamping (Norton, Rockwood, Skolmoski 1982,
/// "Clamping: a method of antialiasing textured surfaces by bandwidth limiting in object space"):
/// every octave is damped by noise_response(); octaves of which next to nothing would be left are
/// replaced by their mean, which is 0, and are not evaluated.
class SURFEL_API FilteredNoise {
 public:
  FilteredNoise() = default;
  /// \param axes  of the Gaussians; all zero: values at points.
  FilteredNoise(const SolidNoise& noise, const KernelAxes& axes);
  /// About a point, whose coordinates should stay below 2^52 cells of the finest octave: an octave
  /// that doubles cannot resolve counts as its mean.
  NoiseMoments at(const Vec3d& point) const;

 private:
  struct Octave {
    Vec3d frequency;
    Vec3d shift;
    std::uint64_t seed = 0;
    double amplitude = 0;  ///< Damped.
  };
  std::array<Octave, kMostOctaves> octave_;
  int used_ = 0;
  double variance_ = 0;
};

}  // namespace surfel
