#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace surfel::bench {

/// Another library's search for the k nearest of all points x y z, themselves included: index and
/// queries, k values of each point.
struct PeerSearch {
  const char* name;
  void (*search)(const float* xyz, std::size_t points, int k, int threads, std::uint32_t* index,
                 float* distance2);
};

/// Those that are installed. Compiled for this machine (-march=native), as their users would.
std::vector<PeerSearch> peer_searches();

}  // namespace surfel::bench
