#pragma once

#include <bit>
#include <cstdint>

namespace surfel {

/// The value of a number of half precision (IEEE 754 binary16), exact. Internal to the io module.
inline float float_of_half(std::uint16_t half) {
  const std::uint32_t sign = (half & 0x8000U) << 16;
  const std::uint32_t exponent = (half >> 10) & 0x1FU;
  const std::uint32_t mantissa = half & 0x3FFU;
  if (exponent == 0) {
    // A multiple of 2^-24, or zero.
    const float value = static_cast<float>(mantissa) * 0x1p-24F;
    return sign != 0 ? -value : value;
  }
  constexpr std::uint32_t kBiasShift = 127 - 15;
  const std::uint32_t wide = exponent == 0x1F ? 0xFFU : exponent + kBiasShift;
  return std::bit_cast<float>(sign | (wide << 23) | (mantissa << 13));
}

}  // namespace surfel
