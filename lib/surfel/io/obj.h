#pragma once

#include <surfel/io/input_file.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

/// Reads Wavefront OBJ with its MTL. OpenMesh's reader is not used: it loses texture coordinates
/// and normals of corners where a mesh is not manifold, names no line in its errors, and takes
/// options of map_Kd for part of the file name. Internal to the io module.
///
/// The lines v (a fourth number is a weight, which polygons do not use; three more are a colour),
/// vt, vn, f (polygons; indices count from either end), usemtl and mtllib are read, and Kd and
/// map_Kd of the MTL. All other lines are skipped. A missing material file is no error, but a note:
/// its materials are grey and have no texture.
TriangleMesh read_obj(const InputFile& file);

}  // namespace surfel
