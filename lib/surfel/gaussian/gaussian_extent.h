#pragma once

#include <surfel/base/export.h>
#include <surfel/scene/framing.h>
#include <surfel/scene/gaussian_cloud.h>
#include <surfel/scene/surface_sample.h>

namespace surfel {

/// What cameras are to see of Gaussians: each up to two standard deviations, where it is not nearly
/// clear. What is framed is the part of the scene that holds the middle 98 % of them along every
/// axis, and what is close to it, since training leaves floaters and far surroundings.
SURFEL_API SceneExtent gaussian_extent(const GaussianCloud& cloud);

/// Places of Gaussians that are not nearly clear, without normals, enough to judge a scene by.
SURFEL_API SurfaceSample sample_surface(const GaussianCloud& cloud);

}  // namespace surfel
