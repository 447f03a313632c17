#pragma once

#include <array>
#include <cstddef>

#include <surfel/base/parallel.h>
#include <surfel/solve/sparse_matrix.h>

namespace surfel {

/// Unknowns in a range of a parallel loop: their numbers fit into the first-level cache.
constexpr std::size_t kUnknownGrain = 512;

/// Adds up what body(begin, end) returns for the ranges of [0, count), of `grain` numbers each,
/// which run in parallel, in the order of the ranges: the same on every run, for any number of
/// threads.
template <std::size_t kSums, class Body>
std::array<Channels, kSums> sum_ranges(std::size_t count, const Body& body,
                                       std::size_t grain = kUnknownGrain) {
  Array<std::array<Channels, kSums>> partial((count + grain - 1) / grain);
  parallel_for(count, grain, [&](std::size_t begin, std::size_t end, int) {
    partial[begin / grain] = body(begin, end);
  });
  std::array<Channels, kSums> total;
  total.fill(Channels::Zero());
  for (const auto& sums : partial) {
    for (std::size_t i = 0; i < kSums; ++i) total[i] += sums[i];
  }
  return total;
}

/// Adds up what body(i) returns for the numbers i below `count`, range by range as sum_ranges()
/// does.
template <class Body>
Channels sum_of(std::size_t count, std::size_t grain, const Body& body) {
  const auto range = [&](std::size_t begin, std::size_t end) {
    Channels sum = Channels::Zero();
    for (std::size_t i = begin; i < end; ++i) sum += body(i);
    return std::array{sum};
  };
  return sum_ranges<1>(count, range, grain)[0];
}

}  // namespace surfel
