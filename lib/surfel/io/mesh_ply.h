#pragma once

#include <string>

#include <surfel/io/input_file.h>
#include <surfel/io/mesh.h>

namespace surfel {

/// A PLY file's surface: polygons or triangle strips; uv per vertex (u v, s t, texture_u texture_v)
/// or per face (texcoord, with texnumber and `comment TextureFile`); vertex colours and normals.
/// Internal to the io module.
TriangleMesh read_ply_mesh(InputFile file);

/// Binary, little endian. Normals are written where the wedges of each vertex share one, since PLY
/// has none per corner; vertex colours as 8-bit sRGB, which is what other programs read.
void write_ply_mesh(const TriangleMesh& mesh, const std::string& path,
                    const MeshWriteOptions& options);

}  // namespace surfel
