#pragma once

#include <surfel/io/input_file.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

/// Reads a PLY file's surface: polygons or triangle strips; uv per vertex (u v, s t, texture_u
/// texture_v, texture_s texture_t) or per corner (texcoord, with texnumber and `comment
/// TextureFile`); vertex colours and normals.
/// Internal to the io module.
TriangleMesh read_ply_mesh(InputFile file);

}  // namespace surfel
