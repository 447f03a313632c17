#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/timing.h>
#include <surfel/estimate/normals.h>
#include <surfel/estimate/orientation.h>
#include <surfel/estimate/outliers.h>
#include <surfel/estimate/splat_size.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

struct EstimateOptions {
  SearchMethod search = SearchMethod::kExact;
  NormalOptions normals;
  OrientationOptions orientation;
  SplatSizeOptions size;
  std::optional<OutlierOptions> outliers;                ///< Set: outliers are removed first.
  SURFEL_API std::vector<std::string> problems() const;  ///< Empty if usable.
};

struct EstimateReport {
  std::size_t points = 0;                          ///< Points of the cloud as it came.
  std::size_t nonfinite = 0;                       ///< Points removed: NaN or infinite coordinates.
  std::size_t outliers = 0;                        ///< Points removed as outliers.
  std::array<std::size_t, kPointFlags> flagged{};  ///< Points by PointFlag.
  std::size_t extended = 0;                        ///< Thin neighbourhoods that were enlarged.
  double mean_neighbors = 0;                       ///< Mean number of points to a normal.
  std::optional<double> search_recall;             ///< neighbor_recall() of an approximate search.
  OrientationReport orientation;
  std::size_t border = 0;    ///< Splats at a border or alone.
  std::size_t capped = 0;    ///< Splats alone, cut down as they were far from all others.
  bool anisotropic = false;  ///< Splats are ellipses.
  StageTimes times;
};

/// Makes surfels of a cloud of points: `normal`, `variance` (or `tangent`, `variance_u`,
/// `variance_v`) and `area` are set, whatever stood there before, and the properties curvature,
/// confidence and flag (a PointFlag) are added; all other columns stay with their points, in the
/// order in which the points came. Points that are not finite are removed. A normal that cannot be
/// told is zero, its splat a disc that looks at the eye.
///
/// The work takes about 250 bytes a point besides the cloud; its result does not depend on the
/// number of threads. Throws Error(kUsage) for bad options, Error(kInput) starting with `name` if
/// no finite point is left.
SURFEL_API SurfelCloud estimate_surfels(const SurfelCloud& cloud, const EstimateOptions& options,
                                        EstimateReport* report = nullptr,
                                        const std::string& name = {});

}  // namespace surfel
