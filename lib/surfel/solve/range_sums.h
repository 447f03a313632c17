#pragma once

#include <array>
#include <cstddef>

#include <surfel/base/parallel.h>
#include <surfel/solve/sparse_matrix.h>

namespace surfel {

/// Unknowns in a range of a parallel loop: their numbers fit into the first-level cache.
constexpr std::size_t kUnknownGrain = 512;

/// Adds up what body(begin, end) returns for the ranges of [0, count), which run in parallel, in
/// the order of the ranges: the same on every run, for any number of threads.
template <std::size_t kSums, class Body>
std::array<Channels, kSums> sum_ranges(std::size_t count, const Body& body) {
  Array<std::array<Channels, kSums>> partial((count + kUnknownGrain - 1) / kUnknownGrain);
  parallel_for(count, kUnknownGrain, [&](std::size_t begin, std::size_t end, int) {
    partial[begin / kUnknownGrain] = body(begin, end);
  });
  std::array<Channels, kSums> total;
  total.fill(Channels::Zero());
  for (const auto& sums : partial) {
    for (std::size_t i = 0; i < kSums; ++i) total[i] += sums[i];
  }
  return total;
}

}  // namespace surfel
