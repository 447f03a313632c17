#pragma once

#include <cmath>

#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Whether a cloud's surfels have a variance, of either kind.
inline bool has_variance(const SurfelCloud& cloud) {
  return cloud.anisotropic() || !cloud.variance.empty();
}

/// Whether there is a Gaussian of this variance.
inline bool usable_variance(double variance) { return std::isfinite(variance) && variance > 0; }

}  // namespace surfel
