#pragma once

#include <string>

#include <surfel/base/export.h>
#include <surfel/scene/camera.h>
#include <surfel/store/render_cloud.h>
#include <surfel/truth/disc_hierarchy.h>

namespace surfel {

/// Most discs that a ray of a picture meets, in the mean, for require_bounded_overdraw(). Eighty
/// surfaces over each other have fewer, as about six kernels of cutoff 1 reach a place of each.
inline constexpr double kMostOverdraw = 512;

/// Number of discs that a ray through the picture meets, in the mean over a grid of 8 x 8 rays.
/// \param cloud   The discs.
/// \param discs   Hierarchy of the cloud's discs.
/// \param reach   Half axes of a disc, in standard deviations.
/// \param camera  The camera of the picture.
SURFEL_API double mean_overdraw(const RenderCloud& cloud, const DiscHierarchy& discs, double reach,
                                const Camera& camera);

/// Throws Error(kInput) where a renderer that draws every disc over each of its rays would take a
/// time that is not in proportion to the cloud: where mean_overdraw() is more than kMostOverdraw.
/// \param cloud   The discs.
/// \param discs   Hierarchy of the cloud's discs.
/// \param reach   Half axes of a disc, in standard deviations.
/// \param camera  The camera of the picture.
/// \param name    Starts the message.
SURFEL_API void require_bounded_overdraw(const RenderCloud& cloud, const DiscHierarchy& discs,
                                         double reach, const Camera& camera,
                                         const std::string& name);

}  // namespace surfel
