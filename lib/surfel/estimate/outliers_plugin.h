#pragma once

#include <cstddef>
#include <cstdint>

namespace surfel {

/// Work that the library hands to the plug-in libsurfel_filters.so. It holds plain numbers only:
/// PCL may be built for another instruction set than this library, and Eigen's types differ then.
struct OutlierWork {
  const float* points = nullptr;  ///< x y z, `count` times.
  std::size_t count = 0;
  int neighbors = 0;
  double deviations = 0;
  std::uint8_t* inlier = nullptr;  ///< `count` values, all 0; set to 1 for points to keep.
};
using RemoveOutliers = bool (*)(OutlierWork& work);

}  // namespace surfel
