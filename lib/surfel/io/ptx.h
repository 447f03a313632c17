#pragma once

#include <string>

#include <surfel/io/input_file.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Does the name end in .ptx?
bool is_ptx_name(const std::string& path);

/// Reads the points of all scans of a PTX file, text that Leica's programs write: of each scan the
/// number of columns and of rows of its grid, where the scanner stood, its axes, a matrix of four
/// rows, the last of which is the translation, and then x y z intensity, or x y z intensity r g b,
/// column by column. Points are moved by the matrix, in double. Points 0 0 0, which mark lines of
/// sight without a return, are left out (SurfelCloud::unmeasured_skipped). Properties are
/// `intensity`, `row_index`, `column_index` and, where there are several scans, `scan`.
///
/// The viewpoint of a scan is where the matrix moves the scan's origin. Where the matrix moves
/// nothing it is the scanner's place as the file tells it, or the origin where the points form a
/// grid; else it is unknown. Throws Error(kInput) naming file and line. Internal to the io module.
SurfelCloud read_ptx(const InputFile& file);

}  // namespace surfel
