#pragma once

#include <string>

#include <surfel/base/export.h>

namespace surfel {

/// What a file holds.
enum class FileKind { kCloud, kMesh, kImage };

/// Tells it from the name's extension, and for PLY from the header: a file with faces or triangle
/// strips is a mesh, one with points alone a cloud ("-", standard input, is always a cloud).
/// Throws Error (kIo, kInput) naming the file if it cannot be read, is empty, or is of a format
/// that is not supported.
SURFEL_API FileKind file_kind(const std::string& path);

}  // namespace surfel
