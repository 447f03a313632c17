#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>

namespace surfel {

/// Which points inliers() takes for outliers.
struct OutlierOptions {
  int neighbors = 16;     ///< Neighbours whose mean distance from a point is looked at, 1..1024.
  double deviations = 3;  ///< A point is an outlier where this mean distance is above the average
                          ///< over all points by more than this many standard deviations, > 0.
  SURFEL_API std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// 1 for every point to keep, 0 for outliers: PCL's StatisticalOutlierRemoval [Rusu et al. 2008].
/// `points` are finite. Clouds of no more than `neighbors` points have no outliers. Throws
/// Error(kUsage) for bad options, Error(kIo) if the plug-in cannot be loaded.
SURFEL_API Array<std::uint8_t> inliers(const Array<Vec3f>& points,
                                       const OutlierOptions& options = {});

}  // namespace surfel
