#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>

namespace surfel {

/// Value of a noise function and its derivative by position.
template <int D>
struct NoiseValue {
  double value = 0;
  Eigen::Matrix<double, D, 1> gradient = Eigen::Matrix<double, D, 1>::Zero();
};

/// Hashes of the corners of a lattice cell; bit k of a corner's number says which of both ends it
/// is at along axis k. A corner's hash is made axis by axis, as hash = step(hash, axis,
/// coordinate), so that corners share the steps of the axes that they agree in.
template <int D, class Step>
std::array<std::uint64_t, std::size_t{1} << D> corner_hashes(
    const Eigen::Matrix<std::int64_t, D, 1>& cell, std::uint64_t start, const Step& step) {
  std::array<std::uint64_t, std::size_t{1} << D> hashes{start};
  for (int axis = 0; axis < D; ++axis) {
    const std::size_t known = std::size_t{1} << axis;
    for (std::size_t i = 0; i < known; ++i) {
      hashes[i + known] = step(hashes[i], axis, static_cast<std::uint64_t>(cell[axis] + 1));
      hashes[i] = step(hashes[i], axis, static_cast<std::uint64_t>(cell[axis]));
    }
  }
  return hashes;
}

/// Gradient noise with the quintic fade, twice continuously differentiable, with its analytic
/// derivative (Perlin 2002, "Improving noise"), of gradients that corner_hashes() give to lattice
/// points: components uniform in [-1, 1). Zero at lattice points; about +-0.6 at most. Without
/// kDerivative the derivative is left at zero, which takes less time.
template <int D, bool kDerivative = true, class Step>
NoiseValue<D> gradient_noise_of(const Eigen::Matrix<double, D, 1>& p, std::uint64_t start,
                                const Step& step) {
  static_assert(D <= 3);
  Eigen::Matrix<std::int64_t, D, 1> cell;
  double fade[D], fade_slope[D], offset[D];
  for (int k = 0; k < D; ++k) {
    cell[k] = static_cast<std::int64_t>(p[k]);
    cell[k] -= static_cast<std::int64_t>(p[k] < static_cast<double>(cell[k]));
    const double t = p[k] - static_cast<double>(cell[k]);
    offset[k] = t;
    fade[k] = t * t * t * (t * (t * 6 - 15) + 10);
    fade_slope[k] = 30 * t * t * (t - 1) * (t - 1);
  }
  const auto hashes = corner_hashes<D>(cell, start, step);
  NoiseValue<D> noise;
  for (int corner = 0; corner < (1 << D); ++corner) {
    double weight = 1;
    for (int k = 0; k < D; ++k) weight *= (corner >> k & 1) != 0 ? fade[k] : 1 - fade[k];
    Eigen::Matrix<double, D, 1> gradient;
    double ramp = 0;
    for (int k = 0; k < D; ++k) {
      gradient[k] =
          static_cast<double>(static_cast<std::int64_t>(hashes[corner] >> (21 * k) & 0x1fffff)) *
              0x1p-20 -
          1;
      ramp += gradient[k] * (offset[k] - (corner >> k & 1));
    }
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

/// Gradient noise of a hash that is quickly made.
template <int D, bool kDerivative = true>
NoiseValue<D> gradient_noise(const Eigen::Matrix<double, D, 1>& p, std::uint64_t seed) {
  const auto step = [](std::uint64_t hash, int, std::uint64_t coordinate) {
    hash = (hash ^ coordinate) * 0xbf58476d1ce4e5b9ULL;
    return hash ^ hash >> 29;
  };
  return gradient_noise_of<D, kDerivative>(p, seed + 0x9e3779b97f4a7c15ULL, step);
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
