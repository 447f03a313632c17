#pragma once

#include <string>

#include <surfel/io/mesh_io.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

/// Writes Wavefront OBJ and, if the mesh has materials, an MTL file beside it. The MTL names a
/// texture in its own folder or below by a path relative to that folder. Internal to the io module.
void write_obj(const TriangleMesh& mesh, const std::string& path, const MeshWriteOptions& options);

/// Writes binary little-endian PLY. Texture coordinates are written per corner in MeshLab's
/// properties (texcoord, texnumber, TextureFile). Normals are written only if all corners at a
/// vertex have the same one, because PLY has no normals per corner. Vertex colours are 8-bit sRGB,
/// which other programs read. Materials are reduced to their textures. Internal to the io module.
void write_ply_mesh(const TriangleMesh& mesh, const std::string& path,
                    const MeshWriteOptions& options);

}  // namespace surfel
