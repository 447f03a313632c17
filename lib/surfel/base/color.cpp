#include <array>
#include <bit>
#include <cmath>
#include <limits>

#include <surfel/base/color.h>
#include <surfel/base/elementary.h>

namespace surfel {
namespace {

double decode(double encoded) {
  return encoded <= 0.04045 ? encoded / 12.92 : portable::pow((encoded + 0.055) / 1.055, 2.4);
}

double encode(double linear) {
  return linear <= 0.0031308 ? linear * 12.92 : 1.055 * portable::pow(linear, 1 / 2.4) - 0.055;
}

/// Encodes to 8 bits without pow(), rounded exactly: floats are looked up by exponent and first 7
/// bits of the mantissa. Floats that share these differ by at most 1/128 of their size, and the
/// curve reaches its next 8-bit value after 1/112 at the earliest: they have two values at most.
class Srgb8Encoder {
 public:
  Srgb8Encoder() noexcept {
    // For every 8-bit value, the least float of linear light that rounds to it.
    std::array<float, 257> threshold{};
    for (int i = 1; i < 256; ++i) {
      const double exact = decode((i - 0.5) / 255);
      threshold[i] = static_cast<float>(exact);
      if (threshold[i] < exact) threshold[i] = std::nextafter(threshold[i], 2.0F);
    }
    threshold[256] = std::numeric_limits<float>::infinity();
    int value = 0;
    for (std::uint32_t i = 0; i < kSteps; ++i) {
      while (std::bit_cast<float>((kFirst + i) << kShift) >= threshold[value + 1]) ++value;
      steps_[i] = {threshold[value + 1], value};
    }
  }

  std::uint8_t operator()(float linear) const noexcept {
    // Also NaN.
    if (!(linear >= std::bit_cast<float>(kFirst << kShift))) return 0;
    if (linear >= 1) return 255;
    const Step& step = steps_[(std::bit_cast<std::uint32_t>(linear) >> kShift) - kFirst];
    return static_cast<std::uint8_t>(step.value + static_cast<int>(linear >= step.next));
  }

 private:
  static constexpr int kShift = 16;  ///< Leaves sign, exponent and 7 bits of the mantissa.
  /// From 2^-13, which is below the first threshold, to 1.
  static constexpr std::uint32_t kFirst = std::bit_cast<std::uint32_t>(0x1p-13F) >> kShift;
  static constexpr std::uint32_t kSteps = (std::bit_cast<std::uint32_t>(1.0F) >> kShift) - kFirst;
  struct Step {
    float next;  ///< Least float that has the value after `value`.
    int value;   ///< Value of the step's first float.
  };
  std::array<Step, kSteps> steps_;
};

}  // namespace

float srgb_to_linear(float encoded) noexcept {
  return static_cast<float>(std::copysign(decode(std::abs(encoded)), encoded));
}

float linear_to_srgb(float linear) noexcept {
  return static_cast<float>(std::copysign(encode(std::abs(linear)), linear));
}

float srgb8_to_linear(std::uint8_t value) noexcept {
  static const std::array<float, 256> table = [] {
    std::array<float, 256> t{};
    for (int i = 0; i < 256; ++i) t[i] = static_cast<float>(decode(i / 255.0));
    return t;
  }();
  return table[value];
}

std::uint8_t linear_to_srgb8(float linear) noexcept {
  static const Srgb8Encoder encoder;
  return encoder(linear);
}

float srgb16_to_linear(std::uint16_t value) noexcept {
  return static_cast<float>(decode(value / 65535.0));
}

std::uint16_t linear_to_srgb16(float linear) noexcept {
  if (!(linear > 0)) return 0;
  if (linear >= 1) return 65535;
  return static_cast<std::uint16_t>(std::lround(encode(linear) * 65535));
}

}  // namespace surfel
