#pragma once

#include <string>
#include <vector>

#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Writes surfels or points as LAS, or, if the name ends in .laz, as LAZ in chunks of 50,000 points
/// that are compressed in parallel: LAS 1.2 with point formats 0 to 3, or 1.4 with 6 to 8 where a
/// column (`nir`, `scan_angle`, `overlap`, `scanner_channel`) or the number of points wants it, or
/// the cloud came from such a file (SurfelCloud::las). Columns with the names of las_fields() fill
/// these fields where all their values fit; all others are extra bytes under their names. Colours
/// have 16 bits, but 8 where the cloud came from LAS with 8. Coordinates have the scale and offset
/// of SurfelCloud::las where that reaches; else the scale is SurfelCloud::decimals', or the power
/// of ten that is finer than the cloud's positions. The file appears whole or not at all
/// (OutputFile). \param comments  lines that are stored in a block of their own Throws Error(kIo),
/// and Error(kInput) for positions that are not finite. Internal to the io module.
void write_las(const SurfelCloud& cloud, const std::string& path, bool no_clobber,
               const std::vector<std::string>& comments);

/// Who defines the block of comments, and its number.
inline constexpr const char* kCommentUser = "surfelkit";
inline constexpr int kCommentId = 1;

}  // namespace surfel
