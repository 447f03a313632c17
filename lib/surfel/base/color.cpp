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

/// Encodes to 16 bits without pow() but for a few floats, rounded exactly: a cubic polynomial for
/// each exponent and first 5 bits of the mantissa is off by less than kError, and where that could
/// change the rounding, the curve itself decides.
class Srgb16Encoder {
 public:
  Srgb16Encoder() noexcept {
    // The polynomial that has the curve's values at the Chebyshev nodes of [-1, 1].
    constexpr double kInner = 0.38268343236508977;  // cos(3 pi / 8)
    constexpr double kOuter = 0.9238795325112867;   // cos(pi / 8)
    for (std::uint32_t i = 0; i < kSegments; ++i) {
      const double begin = std::bit_cast<float>((kFirst + i) << kShift);
      const double end = std::bit_cast<float>((kFirst + i + 1) << kShift);
      const double middle = (begin + end) / 2;
      const double half = (end - begin) / 2;
      const auto at = [&](double t) { return exact(middle + half * t); };
      const double even_near = (at(kInner) + at(-kInner)) / 2;
      const double even_far = (at(kOuter) + at(-kOuter)) / 2;
      const double odd_near = (at(kInner) - at(-kInner)) / (2 * kInner);
      const double odd_far = (at(kOuter) - at(-kOuter)) / (2 * kOuter);
      constexpr double kBetween = kOuter * kOuter - kInner * kInner;
      const double c2 = (even_far - even_near) / kBetween;
      const double c3 = (odd_far - odd_near) / kBetween;
      segments_[i] = {middle,
                      1 / half,
                      {even_near - c2 * kInner * kInner, odd_near - c3 * kInner * kInner, c2, c3}};
    }
  }

  /// \param linear  in (0, 1)
  std::uint16_t operator()(float linear) const noexcept {
    if (linear >= std::bit_cast<float>(kFirst << kShift)) {
      const Segment& s = segments_[(std::bit_cast<std::uint32_t>(linear) >> kShift) - kFirst];
      const double t = (linear - s.middle) * s.scale;
      const double raised = s.c[0] + t * (s.c[1] + t * (s.c[2] + t * s.c[3])) + 0.5;
      const auto code = static_cast<std::uint16_t>(raised);
      const double above = raised - code;
      if (above > kError && above < 1 - kError) return code;
    }
    return static_cast<std::uint16_t>(exact(linear) + 0.5);
  }

 private:
  static double exact(double linear) { return encode(linear) * 65535; }

  static constexpr double kError = 1e-4;  ///< Six times the largest error, in 16-bit steps.
  static constexpr int kShift = 18;       ///< Leaves sign, exponent and 5 bits of the mantissa.
  /// From 2^-8, which is above the linear part of the curve, to 1.
  static constexpr std::uint32_t kFirst = std::bit_cast<std::uint32_t>(0x1p-8F) >> kShift;
  static constexpr std::uint32_t kSegments =
      (std::bit_cast<std::uint32_t>(1.0F) >> kShift) - kFirst;
  struct Segment {
    double middle;
    double scale;             ///< Times a distance from the middle: in [-1, 1].
    std::array<double, 4> c;  ///< Coefficients, lowest first.
  };
  std::array<Segment, kSegments> segments_;
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
  static const Srgb16Encoder encoder;
  return encoder(linear);
}

}  // namespace surfel
