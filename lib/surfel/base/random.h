#pragma once

#include <cstdint>

namespace surfel {

/// A random function of two numbers: the mixing is SplitMix64's finaliser (Steele, Lea, Flood 2014,
/// "Fast splittable pseudorandom number generators").
inline std::uint64_t random_step(std::uint64_t state, std::uint64_t value) noexcept {
  // 2^64 over the golden ratio, SplitMix64's step: its multiples are spread evenly.
  constexpr std::uint64_t kGolden = 0x9e3779b97f4a7c15ULL;
  std::uint64_t z = state + kGolden * (value + 1);
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
  return z ^ (z >> 31);
}

/// Counter-based random numbers: a value is a function of (seed, index, dimension) alone, so that
/// any thread may make any of them in any order.
inline std::uint64_t random_bits(std::uint64_t seed, std::uint64_t index,
                                 std::uint64_t dimension = 0) noexcept {
  return random_step(random_step(seed, index), dimension);
}

/// Uniform in [0, 1), a multiple of 2^-53.
inline double random_uniform(std::uint64_t seed, std::uint64_t index,
                             std::uint64_t dimension = 0) noexcept {
  return static_cast<double>(random_bits(seed, index, dimension) >> 11) * 0x1p-53;
}

}  // namespace surfel
