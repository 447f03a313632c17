#pragma once

#include <surfel/io/input_file.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

/// Wavefront OBJ with its MTL. A scanner of our own: OpenMesh's reader loses what belongs to a face
/// corner where a mesh is not manifold, names no line when something is wrong, and takes options of
/// map_Kd for part of the file name. Internal to the io module.
///
/// Read: v (a fourth number is a weight, which polygons have no use for; three more are a colour),
/// vt, vn, f (indices from either end, polygons), usemtl, mtllib; of the MTL: Kd, map_Kd. All else
/// is skipped. A material file that is not there is no error: its materials have no texture.
TriangleMesh read_obj(const InputFile& file);

}  // namespace surfel
