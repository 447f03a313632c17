#pragma once

#include <string>

#include <surfel/io/mesh_io.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

/// Wavefront OBJ, and where there are materials the MTL beside it. Textures in the MTL's folder or
/// below it are named as seen from there. Internal to the io module, like the next.
void write_obj(const TriangleMesh& mesh, const std::string& path, const MeshWriteOptions& options);

/// PLY, binary, little endian; uv per corner as MeshLab has them (texcoord, texnumber,
/// TextureFile). Normals are written where the wedges of every vertex share one, since PLY has none
/// per corner; vertex colours as 8-bit sRGB, which is what other programs read; of materials the
/// textures only.
void write_ply_mesh(const TriangleMesh& mesh, const std::string& path,
                    const MeshWriteOptions& options);

}  // namespace surfel
