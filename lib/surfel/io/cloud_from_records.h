#pragma once

#include <string>

#include <surfel/io/record_table.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// The surfels in a file's records, as SurfelDecoder decodes them; properties that stand for no
/// attribute go to `extra`. Positions are re-centred, see cloud_io.h.
/// \param file              Name for messages.
/// \param double_positions  The file declares its coordinates as double (text may be read as double
///                          in spite of its header).
/// Throws Error(kInput) where there are no records, a coordinate is missing or the memory does not
/// suffice. Internal to the io module.
SurfelCloud cloud_from_records(const RecordTable& table, const std::string& file,
                               bool double_positions);

}  // namespace surfel
