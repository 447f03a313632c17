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
#include <surfel/estimate/scan_borders.h>
#include <surfel/estimate/scan_creases.h>
#include <surfel/estimate/smoothing.h>
#include <surfel/estimate/splat_size.h>
#include <surfel/estimate/voxel_grid.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Options of all steps of estimate_surfels().
struct EstimateOptions {
  SearchMethod search = SearchMethod::kExact;
  NormalOptions normals;  ///< Its `sensor`, world coordinates; unset: the origin is tried.
  OrientationOptions orientation;
  SplatSizeOptions size;
  std::optional<CreaseOptions> edges;      ///< Set: surfels end at borders and at creases.
  std::optional<OutlierOptions> outliers;  ///< Set: outliers are removed first.
  std::optional<VoxelOptions> voxels;      ///< Set: points are averaged in the cells of a grid.
  std::optional<SmoothingOptions>
      smoothing;  ///< Set: points are moved onto a smooth surface, last.
  SURFEL_API std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// What estimate_surfels() has done and found, step by step.
struct EstimateReport {
  std::size_t points = 0;           ///< Points of the cloud as it came.
  std::size_t nonfinite = 0;        ///< Points removed: NaN or infinite coordinates.
  std::size_t unusable_colors = 0;  ///< Finite points whose colour is not finite.
  /// Points with kAlign whose given normal is zero or not finite: their side is the surface's.
  std::size_t without_normal = 0;
  std::size_t outliers = 0;  ///< Points removed as outliers.
  double voxel_edge = 0;     ///< Cells that were averaged, scene units.
  std::size_t averaged = 0;  ///< Points fewer by averaging.
  bool smoothed = false;     ///< Points were moved.
  std::size_t stayed = 0;    ///< Points that could not be smoothed.
  double mean_shift = 0;     ///< Of smoothed points, scene units.
  double largest_shift = 0;
  std::array<std::size_t, kPointFlags> flagged{};  ///< Points by PointFlag.
  std::size_t extended = 0;                        ///< Thin neighbourhoods that were enlarged.
  double mean_neighbors = 0;                       ///< Mean number of points to a normal.
  std::size_t remade = 0;                          ///< Normals made anew because of noise.
  double noise = 0;                                ///< Median standard deviation of that noise.
  std::optional<double> search_recall;             ///< neighbor_recall() of an approximate search.
  OrientationReport orientation;
  double side_confidence = 0;  ///< Mean of the points'; 0 if sides were not looked for.
  std::size_t border = 0;      ///< Splats at a border or alone.
  std::size_t capped = 0;      ///< Splats alone, cut down as they were far from all others.
  bool anisotropic = false;    ///< Splats are ellipses.
  CreaseReport creases;
  BorderReport borders;
  StageTimes times;
};

/// Makes surfels of a cloud of points: `normal`, `variance` (or `tangent`, `variance_u`,
/// `variance_v`) and `area` are set, whatever stood there before, as are half-planes where surfels
/// end at borders and creases (`clip1`, `clip2`), if that is asked for, and the properties
/// curvature, confidence, flag (a PointFlag) and, unless sides are left as they are,
/// side_confidence (see orient_normals()) are added; all other columns stay with their points, in
/// the order in which the points came. Points that are not finite are removed. Smoothing moves
/// points and averaging makes fewer of them; neither is done unless asked for. A normal that cannot
/// be told is zero, its splat a disc that looks at the eye.
///
/// The work takes about 250 bytes a point besides the cloud; its result does not depend on the
/// number of threads. Throws Error(kUsage) for bad options and for kViewpoint where neither they
/// nor the cloud tell a viewpoint, Error(kInput) starting with `name` if no finite point is left,
/// or their box is beyond require_float_extent().
SURFEL_API SurfelCloud estimate_surfels(const SurfelCloud& cloud, const EstimateOptions& options,
                                        EstimateReport* report = nullptr,
                                        const std::string& name = {});

}  // namespace surfel
