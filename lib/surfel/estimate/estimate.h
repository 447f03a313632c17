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
  std::optional<OutlierOptions> outliers;  ///< Set: points that it names are removed first.
  SURFEL_API std::vector<std::string> problems() const;
};

struct EstimateReport {
  std::size_t points = 0;                          ///< In the cloud as it came.
  std::size_t nonfinite = 0;                       ///< Removed: a coordinate is NaN or infinite.
  std::size_t outliers = 0;                        ///< Removed.
  std::array<std::size_t, kPointFlags> flagged{};  ///< By PointFlag.
  std::size_t extended = 0;                        ///< Thin neighbourhoods that were enlarged.
  double mean_neighbors = 0;                       ///< Points that a normal is of.
  std::optional<double> search_recall;             ///< neighbor_recall() of an approximate search.
  OrientationReport orientation;
  std::size_t border = 0;  ///< Splats at a border or alone ...
  std::size_t capped = 0;  ///< ... of which cut down, as they were far from all others.
  bool anisotropic = false;
  StageTimes times;
};

/// Makes surfels of a cloud of points as it came (design.md section 6): `normal`, `variance` (or
/// `tangent`, `variance_u`, `variance_v`) and `area` are set, whatever stood there before, and the
/// properties curvature, confidence and flag (of PointFlag) added; all others stay with their
/// points, in the order in which they came. Points that are not finite are removed. A normal that
/// cannot be told is zero, its splat a disc that looks at the eye.
///
/// About 250 bytes a point besides the cloud. The same for any number of threads. Throws
/// Error(kUsage) for bad options, Error(kInput) starting with `name` if no finite point is left.
SURFEL_API SurfelCloud estimate_surfels(const SurfelCloud& cloud, const EstimateOptions& options,
                                        EstimateReport* report = nullptr,
                                        const std::string& name = {});

}  // namespace surfel
