#include <array>
#include <cmath>

#include <surfel/base/color.h>

namespace surfel {
namespace {

double decode(double encoded) {
  return encoded <= 0.04045 ? encoded / 12.92 : std::pow((encoded + 0.055) / 1.055, 2.4);
}

double encode(double linear) {
  return linear <= 0.0031308 ? linear * 12.92 : 1.055 * std::pow(linear, 1 / 2.4) - 0.055;
}

/// For every 8-bit value, the least float of linear light that rounds to it. Encoding by a search
/// in it costs no pow() and rounds exactly.
const std::array<float, 256>& thresholds() {
  static const std::array<float, 256> table = [] {
    std::array<float, 256> t{};
    for (int i = 1; i < 256; ++i) {
      const double threshold = decode((i - 0.5) / 255);
      t[i] = static_cast<float>(threshold);
      if (t[i] < threshold) t[i] = std::nextafter(t[i], 2.0F);
    }
    return t;
  }();
  return table;
}

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
  if (!(linear > 0)) return 0;
  const auto& t = thresholds();
  int value = 0;
  for (int step = 128; step > 0; step /= 2) {
    if (linear >= t[value + step]) value += step;
  }
  return static_cast<std::uint8_t>(value);
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
