#pragma once

#include <optional>
#include <string>

#include <surfel/base/export.h>
#include <surfel/scene/coordinate_system.h>

namespace surfel {

/// The coordinate system that a file's header names: blocks of LAS and LAZ, comments of PLY and
/// PCD. Unset where it names none, for other formats, and for what is no regular file, which can be
/// read once only. Throws Error (kIo, kInput) naming the file.
SURFEL_API std::optional<CoordinateSystem> read_coordinate_system(const std::string& path);

}  // namespace surfel
