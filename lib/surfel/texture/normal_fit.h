#pragma once

#include <cstddef>
#include <string>

#include <surfel/base/export.h>
#include <surfel/base/timing.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/texture/normal_maps.h>
#include <surfel/texture/texture_fit.h>

namespace surfel {

/// Figures of the normals of a relief.
struct NormalFitReport {
  std::size_t mapped = 0;         ///< Surfels that got a normal.
  std::size_t unmapped = 0;       ///< Surfels whose material has no map.
  std::size_t without_frame = 0;  ///< No finite uv, no normal, or derivatives without area.
  double mean_tilt = 0;           ///< Mean angle from the surfel's normal to the relief's, radians.
  /// Mean over the mapped surfels of -ln |mean normal|: the normals' variance along an axis,
  /// radians^2.
  double mean_variance = 0;
  StageTimes times;
};

/// Writes the column shading_normal: the mean of the relief's unit normals under each surfel's
/// Gaussian in the image, the one of fit_ewa(), so that its length tells their variance (Toksvig,
/// "Mipmapping normal maps", 2005). The relief bends the shading normals that there are, as of a
/// mesh with smooth normals, else the discs' own. Surfels without relief keep what they have, or
/// get a zero. All other columns stay as they are: the disc stays on the surface.
///
/// Normals are averaged as they are; slopes of heights by their moments (raised_normal()).
///
/// \param cloud    Surfels with normals and uv. The column shading_normal changes.
/// \param maps     The relief of each material.
/// \param options  reconstruction, max_aspect and exact are heeded.
/// \param name     The cloud's file, for messages.
///
/// Throws Error(kUsage) where the options are not usable, Error(kInput) with a message that starts
/// with `name`, the cloud's, where it has no normals or lacks a texture's columns, or has a
/// material without a map. The same for any number of threads.
SURFEL_API NormalFitReport fit_normals(SurfelCloud& cloud, NormalMaps& maps,
                                       const TextureFitOptions& options,
                                       const std::string& name = "surfels");

}  // namespace surfel
