#pragma once

#include <surfel/io/input_file.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

/// Reads the default scene of a glTF 2.0 file, text or GLB, as it stands at the start of its first
/// animation: triangles, normals, texture coordinates, vertex colours and materials with their
/// images. Corners at one place are one vertex, whatever part of the scene they belong to. Internal
/// to the io module.
TriangleMesh read_gltf(InputFile file);

}  // namespace surfel
