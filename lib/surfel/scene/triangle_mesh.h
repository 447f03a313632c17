#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>

namespace surfel {

/// Colour, texture and relief of a mesh's material (OBJ's mtl; PLY's TextureFile).
struct MeshMaterial {
  std::string name;
  Vec3f diffuse{1, 1, 1};  ///< Kd, linear.
  std::string texture;     ///< map_Kd, resolved against the mesh's folder; empty = none.
  /// MTL's norm, an image of normals in tangent space, resolved as `texture`; empty = none.
  std::string normal_map{};
  std::string bump_map{};  ///< MTL's bump, an image of heights, resolved as `texture`.
  float bump_scale = 1;    ///< Height of white above black, scene units: bump's -bm.
};

/// Indexed triangles. Polygons were triangulated (concave ones rightly) on reading; faces keep the
/// file's order.
struct SURFEL_API TriangleMesh {
  Vec3d origin{0, 0, 0};                     ///< World position = origin + position.
  Array<Vec3f> position;                     ///< Per vertex, scene units.
  Array<Vec3f> color;                        ///< Per vertex, linear; empty = none.
  Array<std::array<std::uint32_t, 3>> face;  ///< Vertex indices, counter-clockwise from outside.
  Array<std::array<Vec2f, 3>> wedge_uv;      ///< Per face corner, v = 0 at the bottom; or empty.
  Array<std::array<Vec3f, 3>> wedge_normal;  ///< Per face corner, unit, from the file; or empty.
  Array<std::uint16_t> face_material;        ///< Index into `material`; or empty.
  std::vector<MeshMaterial> material;
  std::size_t degenerate_faces = 0;  ///< Faces of zero area or with repeated vertices that
                                     ///< were dropped on reading.

  /// Throws Error(kInput) if a column is neither empty nor as long as it must be, or a face names a
  /// vertex that the mesh lacks; `name` starts the message.
  void check_columns(const std::string& name) const;
  /// Throws Error(kInput) if a face names a material that the mesh lacks; `name` starts the
  /// message.
  void check_materials(const std::string& name) const;
};

}  // namespace surfel
