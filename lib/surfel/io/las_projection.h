#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include <surfel/scene/coordinate_system.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// The coordinate system that the blocks of a LAS file name by a code of EPSG, be it as GeoTIFF's
/// keys or as well-known text; of a compound system the horizontal part. Unset where they name
/// none. Internal to the io module.
std::optional<CoordinateSystem> las_projection(const std::vector<LasRecord>& records);

/// The block that names a system by GeoTIFF's keys. Internal to the io module.
LasRecord las_projection_record(const CoordinateSystem& system);

/// GeoTIFF's keys as they stand in a directory: the kind of system, that pixels are areas, and the
/// code; without a system the second alone. Internal to the io module.
SURFEL_API std::vector<std::uint16_t> geo_keys(const std::optional<CoordinateSystem>& system);

}  // namespace surfel
