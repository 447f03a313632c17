#pragma once

#include <cstdint>

namespace surfel {

/// Counter-based random numbers: a value is a function of (seed, index, dimension) alone, so that
/// any thread may make any of them in any order. The mixing is SplitMix64's finaliser (Steele, Lea,
/// Flood 2014, "Fast splittable pseudorandom number generators"), applied twice.
inline std::uint64_t random_bits(std::uint64_t seed, std::uint64_t index,
                                 std::uint64_t dimension = 0) noexcept {
  const auto mix = [](std::uint64_t z) {
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    return z ^ (z >> 31);
  };
  // 2^64 over the golden ratio, SplitMix64's step: its multiples are spread evenly.
  constexpr std::uint64_t kGolden = 0x9e3779b97f4a7c15ULL;
  return mix(mix(seed + kGolden * (index + 1)) + kGolden * (dimension + 1));
}

/// Uniform in [0, 1), a multiple of 2^-53.
inline double random_uniform(std::uint64_t seed, std::uint64_t index,
                             std::uint64_t dimension = 0) noexcept {
  return static_cast<double>(random_bits(seed, index, dimension) >> 11) * 0x1p-53;
}

}  // namespace surfel
