#pragma once

#include <cstdint>

#include <surfel/base/export.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Surfels of a cloud with variances, with the columns that all levels of detail have: anisotropic
/// variances, areas, levels (0).
/// \param source  the surfels, by their numbers in the cloud
SURFEL_API SurfelCloud level_columns(const SurfelCloud& cloud, const Array<std::uint32_t>& source);

}  // namespace surfel
