#pragma once

#include <memory>

#include <surfel/io/cloud_from_records.h>
#include <surfel/io/input_file.h>

namespace surfel {

/// The points of a binary PLY file without lists, as records that are read from the file whenever
/// they are asked for; null for other files, and where the viewpoint is told by all points only.
/// Throws as read_cloud() does. Internal to the io module.
std::unique_ptr<PointRecords> open_records(InputFile input);

}  // namespace surfel
