#pragma once

#include <string>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/camera.h>
#include <surfel/truth/disc_hierarchy.h>

namespace surfel {

/// Most discs that a ray of a picture meets, in the mean, for require_bounded_overdraw(). Eighty
/// surfaces over each other have fewer, as about six kernels of cutoff 1 reach a place of each.
inline constexpr double kMostOverdraw = 512;

/// Number of discs whose bounds a ray through the picture meets, in the mean over a grid of 8 x 8
/// rays.
/// \param origin  RenderCloud::origin().
SURFEL_API double mean_overdraw(const DiscHierarchy& discs, const Vec3d& origin,
                                const Camera& camera);

/// Throws Error(kInput) where a renderer that draws every disc over each of its rays would take a
/// time that is not in proportion to the cloud: where mean_overdraw() is more than kMostOverdraw.
/// \param name  starts the message.
SURFEL_API void require_bounded_overdraw(const DiscHierarchy& discs, const Vec3d& origin,
                                         const Camera& camera, const std::string& name);

}  // namespace surfel
