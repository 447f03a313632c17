#pragma once

#include <string>

#include <surfel/base/export.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

/// Reads OBJ (with mtl, per-wedge uv and normals), PLY (faces, triangle strips, uv per vertex or
/// per corner), STL or OFF. Throws Error (kIo, kInput) naming file and line or element: an index
/// out of range, a face with fewer than three corners, a coordinate that is not finite, no face at
/// all.
SURFEL_API TriangleMesh read_mesh(const std::string& path);

struct MeshWriteOptions {
  bool no_clobber = false;
};

/// Writes OBJ (and the .mtl beside it where there are materials) or binary PLY, by extension.
SURFEL_API void write_mesh(const TriangleMesh& mesh, const std::string& path,
                           const MeshWriteOptions& options = {});

}  // namespace surfel
