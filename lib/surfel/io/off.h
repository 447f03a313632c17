#pragma once

#include <surfel/io/input_file.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

/// Reads Geomview's OFF as text: OFF, COFF (vertex colours), NOFF (normals), STOFF (uv) and their
/// combinations. Colours of faces are skipped. OpenMesh's reader is not used: it takes comments
/// after the header for numbers and reads past the end of a truncated file. Internal to the io
/// module.
TriangleMesh read_off(const InputFile& file);

}  // namespace surfel
