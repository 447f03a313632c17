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

/// Means of the points of each cell of a grid.
struct VoxelWork {
  const float* values = nullptr;  ///< `columns` a point, x y z >= 0 first, `count` times.
  std::size_t count = 0;
  std::size_t columns = 3;
  float edge = 0;          ///< Of a cell; the grid has less than 2^31.
  float* means = nullptr;  ///< Place for `count` rows as in `values`: one a cell that has points.
  std::size_t cells = 0;   ///< Rows written to `means`.
  std::uint32_t* cell_of = nullptr;  ///< `count` values: the row of each point's cell.
};
using AverageVoxels = bool(VoxelWork& work);
inline constexpr char kAverageVoxelsSymbol[] = "surfel_average_voxels";

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
