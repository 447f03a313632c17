#pragma once

#include <string>

#include <surfel/base/export.h>
#include <surfel/io/input_file.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

/// Reads OBJ (with MTL, uv and normals per corner), PLY (faces, triangle strips, uv per vertex or
/// per corner), STL, OFF, or glTF 2.0 (gltf.h; text or GLB). Throws Error (kIo, kInput) naming the
/// file and the line or element for an index out of range, a face with fewer than three corners, a
/// coordinate that is not finite, and a mesh without faces.
SURFEL_API TriangleMesh read_mesh(const std::string& path);
/// Reads a mesh from a file that is open, or in memory; its name tells the format.
SURFEL_API TriangleMesh read_mesh(InputFile file);

/// How a file of a mesh is written.
struct MeshWriteOptions {
  bool no_clobber = false;
};

/// Writes OBJ (and an MTL file beside it if the mesh has materials) or binary PLY, by extension;
/// "-" is standard output, as PLY.
SURFEL_API void write_mesh(const TriangleMesh& mesh, const std::string& path,
                           const MeshWriteOptions& options = {});

}  // namespace surfel
