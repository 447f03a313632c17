#pragma once

#include <surfel/io/input_file.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

/// STL, binary or text; corners at the same position become one vertex. Its normals are not used:
/// they are the faces' own. A scanner of our own: OpenMesh's reader takes what is no number for
/// zero, and splits vertices where a mesh is not manifold. Internal to the io module.
TriangleMesh read_stl(const InputFile& file);

}  // namespace surfel
