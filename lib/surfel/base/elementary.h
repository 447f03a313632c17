#pragma once

#include <surfel/base/export.h>

/// Elementary functions whose results have the same bits on every processor: the C library's choose
/// their code by the processor and differ in the last bit. They are built of sums, products,
/// quotients and square roots in double precision, which IEEE 754 defines, none of them fused.
///
/// Special values follow the C standard. Errors, of all double arguments: below 0.53 units in
/// the last place for exp, log, log2, log10 and pow, 0.7 for atan, asin, acos and hypot, 0.8 for
/// atan2, sin and cos, 0.9 for tan, 1.5 for expm1, 3 for tanh and 5 for erfc; where results are
/// denormal, half a unit more. Results for floats are results for doubles, rounded.
namespace surfel::portable {

SURFEL_API double exp(double x) noexcept;
/// exp(x) - 1, without cancellation.
SURFEL_API double expm1(double x) noexcept;
SURFEL_API double log(double x) noexcept;
SURFEL_API double log2(double x) noexcept;   ///< Exact for powers of 2.
SURFEL_API double log10(double x) noexcept;  ///< Exact for powers of 10.
SURFEL_API double pow(double x, double y) noexcept;
SURFEL_API double tanh(double x) noexcept;
SURFEL_API double erfc(double x) noexcept;

SURFEL_API double sin(double x) noexcept;
SURFEL_API double cos(double x) noexcept;
SURFEL_API double tan(double x) noexcept;
SURFEL_API double asin(double x) noexcept;
SURFEL_API double acos(double x) noexcept;
SURFEL_API double atan(double x) noexcept;
SURFEL_API double atan2(double y, double x) noexcept;

/// The root of x^2 + y^2 + z^2, without overflow or underflow on the way.
SURFEL_API double hypot(double x, double y, double z = 0) noexcept;

template <class Real>
constexpr Real squared(Real x) noexcept {
  return x * x;
}

inline float exp(float x) noexcept { return static_cast<float>(exp(static_cast<double>(x))); }
inline float log(float x) noexcept { return static_cast<float>(log(static_cast<double>(x))); }
inline float sin(float x) noexcept { return static_cast<float>(sin(static_cast<double>(x))); }
inline float cos(float x) noexcept { return static_cast<float>(cos(static_cast<double>(x))); }
inline float asin(float x) noexcept { return static_cast<float>(asin(static_cast<double>(x))); }
inline float acos(float x) noexcept { return static_cast<float>(acos(static_cast<double>(x))); }
inline float pow(float x, float y) noexcept {
  return static_cast<float>(pow(static_cast<double>(x), static_cast<double>(y)));
}
inline float atan2(float y, float x) noexcept {
  return static_cast<float>(atan2(static_cast<double>(y), static_cast<double>(x)));
}
inline float hypot(float x, float y, float z = 0) noexcept {
  return static_cast<float>(
      hypot(static_cast<double>(x), static_cast<double>(y), static_cast<double>(z)));
}

}  // namespace surfel::portable
