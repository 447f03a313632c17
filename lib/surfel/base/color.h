#pragma once

#include <cstdint>

#include <surfel/base/export.h>

namespace surfel {

/// sRGB transfer function (IEC 61966-2-1), exact: encoded value in [0, 1] to linear light. Values
/// outside [0, 1] are mirrored at 0 and extended above 1, NaN stays NaN.
SURFEL_API float srgb_to_linear(float encoded) noexcept;

/// Linear light to the encoded value: the inverse of srgb_to_linear().
SURFEL_API float linear_to_srgb(float linear) noexcept;

/// Decodes an 8-bit sRGB value by table; equal to srgb_to_linear(value / 255).
SURFEL_API float srgb8_to_linear(std::uint8_t value) noexcept;

/// Encodes to 8 bits, rounded to nearest, clamped to [0, 255]; NaN becomes 0. Exact inverse of
/// srgb8_to_linear for all 256 values.
SURFEL_API std::uint8_t linear_to_srgb8(float linear) noexcept;

/// Decodes a 16-bit sRGB value; equal to srgb_to_linear(value / 65535).
SURFEL_API float srgb16_to_linear(std::uint16_t value) noexcept;

/// Encodes to 16 bits, rounded to nearest, clamped to [0, 65535]; NaN becomes 0.
SURFEL_API std::uint16_t linear_to_srgb16(float linear) noexcept;

}  // namespace surfel
