#pragma once

#include <string>

#include <surfel/io/record_table.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// The surfels in a file's records: columns that design.md section 2 names go to the attribute they
/// stand for, in any type and under any of their aliases (case does not matter), all others to
/// `extra`. Positions are re-centred, see cloud_io.h.
/// \param file              Name for messages.
/// \param double_positions  The file declares its coordinates as double (text may be read as double
///                          in spite of its header).
/// Throws Error(kInput) where there are no records, a coordinate column is missing or the memory
/// does not suffice. Internal to the io module.
SurfelCloud cloud_from_records(const RecordTable& table, const std::string& file,
                               bool double_positions);

/// Unit length, bit for bit what it was where it is unit already; zero where it has no direction.
Vec3f stored_unit(const Vec3f& n);

/// Linear light of every 8-bit and 16-bit sRGB value.
const float* srgb8_table();
const float* srgb16_table();

}  // namespace surfel
