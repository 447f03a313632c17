#pragma once

#include <surfel/io/input_file.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

/// Reads STL, binary or text. Corners at the same position become one vertex. The normals of the
/// file are not used, since they follow from the faces. OpenMesh's reader is not used: it reads a
/// word that is no number as zero, and splits vertices where a mesh is not manifold. Internal to
/// the io module.
TriangleMesh read_stl(const InputFile& file);

}  // namespace surfel
