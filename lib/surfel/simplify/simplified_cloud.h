#pragma once

#include <cstddef>

#include <surfel/base/timing.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/simplify/edges.h>
#include <surfel/simplify/sheet_clusters.h>
#include <surfel/simplify/shown_surface.h>
#include <surfel/simplify/simplify.h>

namespace surfel {

/// A cloud that is to be simplified, and the look that is to be kept.
struct OriginalCloud {
  /// Usable surfels along a Morton curve, mirror images left out; normals are unit, or zero =
  /// unknown.
  SurfelCloud cloud;
  CloudEdges edges;    ///< Of `cloud`.
  Array<float> area;   ///< Weight of each surfel in the errors.
  ShownSurface shown;  ///< Look of the cloud at its own surfels.
  double total_area = 0;
  double unit_deviation = 0;  ///< SimplifyOptions::unit_deviation, or the default.
  double brightness = 0;      ///< Mean of the colours shown.
};

/// Surfels that stand for clusters of an original's surfels, and the error of their look.
struct SimplifiedCloud {
  SheetClusters clusters;
  SurfelCloud cloud;  ///< A surfel for each cluster, then the mirror images (add_images()).
  Array<std::uint32_t> image_of;  ///< Of each image, the surfel that it continues.
  SimplifyError error;
  std::size_t uncovered = 0;  ///< SimplifyReport::uncovered.
};

/// Merges every cluster to a surfel, sizes and fits the surfels, and measures the errors: steps 3
/// to 5 of simplify_surfels(). The result does not depend on the number of threads.
SimplifiedCloud simplified_cloud(const OriginalCloud& original, SheetClusters clusters,
                                 const SimplifyOptions& options, StageTimes& times);

}  // namespace surfel
