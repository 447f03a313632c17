#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>
#include <limits>
#include <type_traits>
#include <utility>

namespace surfel {

/// What highest_difference() gives for numbers of different signs.
inline constexpr int kSignsDiffer = std::numeric_limits<int>::max();

/// Place of the highest binary digit in which two finite numbers differ, counted from the lowest
/// that their type has, which is the first; digits of negative numbers count as inverted, so that
/// numbers of different signs differ above all digits. -1 where the two are equal.
template <class Real>
int highest_difference(Real a, Real b) {
  if (a == b) return -1;
  using Bits = std::conditional_t<sizeof(Real) == 4, std::uint32_t, std::uint64_t>;
  constexpr int kDigits = std::numeric_limits<Real>::digits - 1;  // Stored in the low bits.
  constexpr int kSign = 8 * sizeof(Real) - 1;
  // A zero with a sign becomes one without.
  const auto u = std::bit_cast<Bits>(a + Real{0});
  const auto v = std::bit_cast<Bits>(b + Real{0});
  if ((u ^ v) >> kSign != 0) return kSignsDiffer;
  const auto exponent = [](Bits bits) {
    return static_cast<int>(bits >> kDigits & ((Bits{1} << (kSign - kDigits)) - 1));
  };
  // Numbers below the least normal one have the exponent 0 and no leading one beside the bits.
  if (exponent(u) != exponent(v)) return std::max(exponent(u), exponent(v)) + kDigits;
  return std::max(exponent(u), 1) + static_cast<int>(std::bit_width(u ^ v)) - 1;
}

/// The axis in which two points differ at the highest digit, the later one where digits are alike,
/// and the place of the digit.
template <class Point>
std::pair<int, int> deciding_axis(const Point& p, const Point& q) {
  int axis = 2;
  int highest = highest_difference(p.z(), q.z());
  for (const int other : {1, 0}) {
    const int place = highest_difference(p[other], q[other]);
    if (place <= highest) continue;
    highest = place;
    axis = other;
  }
  return {axis, highest};
}

}  // namespace surfel
