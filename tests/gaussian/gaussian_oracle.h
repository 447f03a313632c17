#pragma once

#include <surfel/gaussian/gaussian_options.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/gaussian_cloud.h>
#include <surfel/scene/image.h>

namespace surfel::test {

/// The picture of Gaussians by plain loops in double precision: every pixel looks at every
/// Gaussian. Channels as GaussianRenderer's with depths; colours as displays take them, over black.
/// Written from the renderers' published formulas with matrices and their inverses, and shares
/// nothing with the library's renderer.
Image gaussian_oracle(const GaussianCloud& cloud, const Camera& camera,
                      const GaussianOptions& options);

}  // namespace surfel::test
