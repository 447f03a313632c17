#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>

namespace surfel {

/// Value of a noise function and its derivative by position.
template <int D>
struct NoiseValue {
  double value = 0;
  Eigen::Matrix<double, D, 1> gradient = Eigen::Matrix<double, D, 1>::Zero();
};

/// Gradient at a lattice point, from which noise is interpolated; components uniform in [-1, 1).
template <int D>
Eigen::Matrix<double, D, 1> lattice_gradient(const Eigen::Matrix<std::int64_t, D, 1>& cell,
                                             std::uint64_t seed) {
  static_assert(D <= 3);
  std::uint64_t hash = seed + 0x9e3779b97f4a7c15ULL;
  for (int k = 0; k < D; ++k) {
    hash = (hash ^ static_cast<std::uint64_t>(cell[k])) * 0xbf58476d1ce4e5b9ULL;
    hash ^= hash >> 29;
  }
  Eigen::Matrix<double, D, 1> gradient;
  for (int k = 0; k < D; ++k) {
    gradient[k] = static_cast<double>((hash >> (21 * k)) & 0x1fffff) * 0x1p-20 - 1;
  }
  return gradient;
}

/// Gradient noise with the quintic fade, twice continuously differentiable, with its analytic
/// derivative (Perlin 2002, "Improving noise"), of the gradients that `gradient_at`(cell) gives to
/// lattice points. Zero at lattice points; about +-0.6 at most where components of gradients are
/// within +-1. Without kDerivative the derivative is left at zero, which takes less time.
template <int D, bool kDerivative = true, class GradientAt>
NoiseValue<D> gradient_noise_of(const Eigen::Matrix<double, D, 1>& p,
                                const GradientAt& gradient_at) {
  Eigen::Matrix<std::int64_t, D, 1> cell;
  double fade[D], fade_slope[D], offset[D];
  for (int k = 0; k < D; ++k) {
    const double floor = std::floor(p[k]);
    const double t = p[k] - floor;
    cell[k] = static_cast<std::int64_t>(floor);
    offset[k] = t;
    fade[k] = t * t * t * (t * (t * 6 - 15) + 10);
    fade_slope[k] = 30 * t * t * (t - 1) * (t - 1);
  }
  NoiseValue<D> noise;
  for (int corner = 0; corner < (1 << D); ++corner) {
    Eigen::Matrix<std::int64_t, D, 1> lattice = cell;
    double weight = 1;
    for (int k = 0; k < D; ++k) {
      const bool far = (corner >> k & 1) != 0;
      lattice[k] += far;
      weight *= far ? fade[k] : 1 - fade[k];
    }
    const Eigen::Matrix<double, D, 1> gradient = gradient_at(lattice);
    double ramp = 0;
    for (int k = 0; k < D; ++k) ramp += gradient[k] * (offset[k] - (corner >> k & 1));
    noise.value += weight * ramp;
    if constexpr (kDerivative) {
      noise.gradient += weight * gradient;
      for (int k = 0; k < D; ++k) {
        double slope = (corner >> k & 1) != 0 ? fade_slope[k] : -fade_slope[k];
        for (int other = 0; other < D; ++other) {
          if (other != k) slope *= (corner >> other & 1) != 0 ? fade[other] : 1 - fade[other];
        }
        noise.gradient[k] += slope * ramp;
      }
    }
  }
  return noise;
}

/// Gradient noise of lattice_gradient().
template <int D, bool kDerivative = true>
NoiseValue<D> gradient_noise(const Eigen::Matrix<double, D, 1>& p, std::uint64_t seed) {
  return gradient_noise_of<D, kDerivative>(p,
                                           [seed](const Eigen::Matrix<std::int64_t, D, 1>& cell) {
                                             return lattice_gradient<D>(cell, seed);
                                           });
}

/// Spectrum of fractal noise.
struct FractalNoise {
  int octaves = 6;
  double frequency = 1;  ///< Lattice cells per unit of the first octave.
  double gain = 0.5;     ///< Amplitude of an octave by the amplitude of the octave before.
};

/// Sum of octaves of gradient_noise, each of twice the frequency of the octave before.
template <int D, bool kDerivative = true>
NoiseValue<D> fractal_noise(const Eigen::Matrix<double, D, 1>& p, const FractalNoise& spectrum,
                            std::uint64_t seed) {
  NoiseValue<D> sum;
  double amplitude = 1;
  double frequency = spectrum.frequency;
  for (int octave = 0; octave < spectrum.octaves; ++octave) {
    const NoiseValue<D> noise = gradient_noise<D, kDerivative>(p * frequency, seed + octave);
    sum.value += amplitude * noise.value;
    if constexpr (kDerivative) sum.gradient += amplitude * frequency * noise.gradient;
    amplitude *= spectrum.gain;
    frequency *= 2;
  }
  return sum;
}

}  // namespace surfel
