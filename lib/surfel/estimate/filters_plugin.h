#pragma once

#include <cstddef>
#include <cstdint>

namespace surfel {

// Work that the library hands to the plug-in libsurfel_filters.so. It holds plain numbers only: PCL
// may be built for another instruction set than this library, and Eigen's types differ then.

struct OutlierWork {
  const float* points = nullptr;  ///< x y z, `count` times.
  std::size_t count = 0;
  int neighbors = 0;
  double deviations = 0;
  std::uint8_t* inlier = nullptr;  ///< `count` values, all 0; set to 1 for points to keep.
};
using RemoveOutliers = bool(OutlierWork& work);
inline constexpr char kRemoveOutliersSymbol[] = "surfel_remove_outliers";

/// Points projected onto the polynomials that fit their neighbourhoods.
struct SmoothingWork {
  /// Handles one point: `neighbor` are the `count` points nearest to it, itself included, the last
  /// of them at the distance `radius`. Several threads may call it.
  using Visit = void (*)(const void* context, std::size_t point, const std::uint32_t* neighbor,
                         std::size_t count, double radius);

  const float* points = nullptr;  ///< x y z, `count` times.
  std::size_t count = 0;
  int order = 0;  ///< Of the polynomials.
  /// Calls visit(context, ...) for every point.
  void (*for_each)(void* self, Visit visit, const void* context) = nullptr;
  void* self = nullptr;
  float* position = nullptr;  ///< x y z, `count` times; NaN where there is no fit.
  float* normal = nullptr;    ///< Unit normals of the polynomials, of any side.
};
using SmoothPoints = void(SmoothingWork& work);
inline constexpr char kSmoothPointsSymbol[] = "surfel_smooth_points";

}  // namespace surfel
