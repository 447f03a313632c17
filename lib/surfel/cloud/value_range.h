#pragma once

#include <algorithm>
#include <cstddef>
#include <limits>

namespace surfel {

/// Values taken side by side, so that the compiler makes vector instructions of a minimum, maximum
/// or sum whose order it must not change.
inline constexpr std::size_t kLanes = 8;

/// Calls visit(i, lane) for i in [begin, end); lane is below kLanes.
template <class Visit>
void visit_lanes(std::size_t begin, std::size_t end, Visit&& visit) {
  std::size_t i = begin;
  for (; i + kLanes <= end; i += kLanes) {
    for (std::size_t lane = 0; lane < kLanes; ++lane) visit(i + lane, lane);
  }
  for (; i < end; ++i) visit(i, 0);
}

struct ValueRange {
  float min, max;
};

/// Least and largest of value(i), i in [begin, end), but for those that are NaN; infinity and minus
/// infinity if there is none.
template <class Value>
ValueRange value_range(std::size_t begin, std::size_t end, const Value& value) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  float lo[kLanes];
  float hi[kLanes];
  std::fill_n(lo, kLanes, kInfinity);
  std::fill_n(hi, kLanes, -kInfinity);
  visit_lanes(begin, end, [&](std::size_t i, std::size_t lane) {
    const float v = value(i);
    lo[lane] = v < lo[lane] ? v : lo[lane];
    hi[lane] = v > hi[lane] ? v : hi[lane];
  });
  return {*std::min_element(lo, lo + kLanes), *std::max_element(hi, hi + kLanes)};
}

}  // namespace surfel
