#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>

#include <surfel/base/random.h>
#include <surfel/texture/filtered_noise.h>

namespace surfel {
namespace {

/// Octaves that are damped by more count as their mean: they would cost as much as others, and be
/// wrong by more than their rest, since noise_response() is off by up to 0.06.
constexpr double kLeastResponse = 0.05;

/// Doubles beyond have no fractions left.
constexpr double kLargestCell = 0x1p52;

}  // namespace

NoiseValue<3> independent_noise(const Vec3d& place, std::uint64_t seed) {
  return gradient_noise_of<3>(place, seed,
                              [](std::uint64_t hash, int axis, std::uint64_t coordinate) {
                                const std::uint64_t next = random_step(hash, coordinate);
                                return axis < 2 ? next : random_step(next, 0);
                              });
}

double noise_response(const KernelAxes& axes) {
  const Eigen::Matrix2d gram = axes.transpose() * axes;
  const double determinant =
      (Eigen::Matrix2d::Identity() + kNoiseBandwidth / 1.5 * gram).determinant();
  const double root = std::sqrt(determinant);
  return 1 / (root * std::sqrt(root));
}

FilteredNoise::FilteredNoise(const SolidNoise& noise, const KernelAxes& axes) {
  double power = 0;
  double amplitude = 1;
  for (int k = 0; k < noise.octaves; ++k) {
    power += amplitude * amplitude * kNoiseVariance;
    amplitude *= noise.gain;
  }
  amplitude = 1 / std::sqrt(power);
  Vec3d frequency = noise.frequency;
  for (int k = 0; k < noise.octaves; ++k) {
    const KernelAxes cells = frequency.asDiagonal() * axes;
    double response = noise_response(cells);
    if (response < kLeastResponse) response = 0;
    const double octave_variance = amplitude * amplitude * kNoiseVariance;
    // Variance within the kernel, less the part that the damped gradient explains.
    const double within = 1 - noise_response(std::numbers::sqrt2 * cells) -
                          response * response * kNoiseBandwidth * cells.squaredNorm();
    variance_ += octave_variance * std::max(0.0, within);
    if (response > 0) {
      const auto random = [&](std::uint64_t dimension) {
        return random_uniform(noise.seed, static_cast<std::uint64_t>(k), dimension);
      };
      octave_[used_++] = {frequency, Vec3d(random(0), random(1), random(2)),
                          random_bits(noise.seed, static_cast<std::uint64_t>(k), 3),
                          amplitude * response};
    }
    amplitude *= noise.gain;
    frequency *= 2;
  }
}

NoiseMoments FilteredNoise::at(const Vec3d& point) const {
  NoiseMoments moments;
  moments.variance = variance_;
  for (int k = 0; k < used_; ++k) {
    const Octave& octave = octave_[k];
    const Vec3d cell = octave.frequency.cwiseProduct(point) + octave.shift;
    if (!(cell.cwiseAbs().maxCoeff() < kLargestCell)) continue;
    const NoiseValue<3> noise = independent_noise(cell, octave.seed);
    moments.mean += octave.amplitude * noise.value;
    moments.gradient += octave.amplitude * octave.frequency.cwiseProduct(noise.gradient);
  }
  return moments;
}

}  // namespace surfel
