#pragma once

#include <surfel/base/export.h>
#include <surfel/scene/gaussian_cloud.h>
#include <surfel/scene/transform.h>

namespace surfel {

/// Moves Gaussians as transform_cloud() moves surfels; colours that depend on the direction turn
/// with them, densities per scene unit fall as lengths grow. The identity changes nothing, not a
/// bit. Throws Error(kUsage) for an unusable similarity.
SURFEL_API void transform_gaussians(GaussianCloud& cloud, const Similarity& similarity);

}  // namespace surfel
