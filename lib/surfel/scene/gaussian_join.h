#pragma once

#include <span>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/scene/gaussian_cloud.h>

namespace surfel {

/// The Gaussians of several clouds in one, in their order, about an origin for all. A single cloud
/// keeps all that it has; of several
///  - harmonics have the highest degree of all, with zeros where a cloud has a lower one;
///  - what they were trained with, and what is up, stay if all say the same;
///  - the numbers of Gaussians that were left out are added up.
/// \param names  one for each cloud, for messages.
///
/// Throws Error(kInput) where the amplitudes of two clouds have different rules, and for no clouds.
SURFEL_API GaussianCloud join_gaussians(std::vector<GaussianCloud> clouds,
                                        std::span<const std::string> names);

}  // namespace surfel
