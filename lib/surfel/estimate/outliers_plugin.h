#pragma once

#include <cstddef>
#include <cstdint>

namespace surfel {

/// What the library hands to the plug-in libsurfel_filters.so; raw numbers only, as PCL is built
/// for another instruction set than the code that includes Eigen here may be.
struct OutlierWork {
  const float* points = nullptr;  ///< x y z, `count` times.
  std::size_t count = 0;
  int neighbors = 0;
  double deviations = 0;
  std::uint8_t* inlier = nullptr;  ///< `count` values, all 0; set to 1 for points to keep.
};
using RemoveOutliers = bool (*)(OutlierWork& work);

}  // namespace surfel
