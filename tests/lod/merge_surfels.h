#pragma once

#include <cstdint>
#include <vector>

#include <surfel/lod/surfel_merge.h>

namespace surfel::test {

/// The surfels of a cloud as they are merged.
inline std::vector<MergeSurfel> merge_surfels(const SurfelCloud& cloud) {
  std::vector<MergeSurfel> surfels;
  for (std::uint32_t i = 0; i < cloud.size(); ++i) surfels.push_back(merge_surfel(cloud, i));
  return surfels;
}

}  // namespace surfel::test
