#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <numeric>

#include <surfel/base/types.h>

namespace surfel {

/// Disjoint sets of the numbers below a count, with path halving (Tarjan and van Leeuwen 1984).
/// The root of a set is its smallest number, in whatever order sets are united.
class DisjointSets {
 public:
  explicit DisjointSets(std::size_t count) : parent_(count) {
    std::iota(parent_.begin(), parent_.end(), 0U);
  }
  std::uint32_t root(std::uint32_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  /// Makes the sets of a and b one; returns whether they were two.
  bool unite(std::uint32_t a, std::uint32_t b) {
    a = root(a);
    b = root(b);
    parent_[std::max(a, b)] = std::min(a, b);
    return a != b;
  }

 private:
  Array<std::uint32_t> parent_;
};

}  // namespace surfel
