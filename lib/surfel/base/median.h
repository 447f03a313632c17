#pragma once

#include <algorithm>
#include <vector>

namespace surfel {

/// Median of at least one value, the upper one of an even number; puts the values in another order.
template <class T>
T median(std::vector<T>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace surfel
