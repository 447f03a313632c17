#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/wrap_mode.h>

namespace surfel {

/// What the alpha of a material's image says.
enum class TextureAlpha : std::uint8_t {
  kOpacity,
  kNothing,  ///< The surface is opaque whatever the image holds.
  kMask,     ///< Texels are there or not, by MeshMaterial::alpha_cutoff.
};

/// Colour, texture and relief of a mesh's material (OBJ's mtl; PLY's TextureFile; glTF's
/// materials). Images are files, or TriangleMesh::embedded of the same name.
struct MeshMaterial {
  std::string name;
  Vec3f diffuse{1, 1, 1};          ///< Kd, linear: the colour where there is no texture.
  std::string texture;             ///< map_Kd, resolved against the mesh's folder; empty = none.
  Vec3f texture_factor{1, 1, 1};   ///< Multiplies the texture's colours; linear.
  std::optional<WrapMode> wrap{};  ///< Of all its images; unset: the file does not say.
  float opacity = 1;               ///< Multiplies alpha, 0..1.
  TextureAlpha texture_alpha = TextureAlpha::kOpacity;
  float alpha_cutoff = 0.5F;  ///< Of kMask: alpha of texels that are there, at least.
  /// The vertices' colours multiply the material's, as in glTF; else they are the colour of faces
  /// without texture.
  bool vertex_factor = false;
  bool unlit = false;  ///< Its colours are the light that leaves the surface.
  /// MTL's norm, an image of normals in tangent space, resolved as `texture`; empty = none.
  std::string normal_map{};
  std::string bump_map{};  ///< MTL's bump, an image of heights, resolved as `texture`.
  float bump_scale = 1;    ///< Height of white above black, scene units: bump's -bm.
  std::string named_by{};  ///< The file that names the images (open_named()); empty: none does.
};

/// An image inside of the mesh's file.
struct EmbeddedImage {
  std::string name;                               ///< As materials have it, and for messages.
  std::shared_ptr<const Array<std::byte>> bytes;  ///< As an image file's.
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
  std::vector<EmbeddedImage> embedded;
  std::optional<Vec3d> up{};         ///< Upward direction, where the format or the file says it.
  std::size_t degenerate_faces = 0;  ///< Faces of zero area or with repeated vertices that
                                     ///< were dropped on reading.
  /// What the file holds or names that could not be taken into account: half a sentence each, to
  /// follow the file's name in a message.
  std::vector<std::string> notes;

  /// Do the vertices' colours multiply what a material's map gives? Without texture the map of such
  /// a material is white.
  bool colors_multiply(const MeshMaterial& of) const {
    return !color.empty() && (of.vertex_factor || of.texture.empty());
  }
  /// Colour of a place of a face, whose corners weigh `b`, without its texture; white where there
  /// is nothing else. `face_material` names rows of `material`.
  Vec3f color_at(std::size_t face_index, const Vec3f& b) const;

  /// Throws Error(kInput) if a column is neither empty nor as long as it must be, or a face names a
  /// vertex that the mesh lacks; `name` starts the message.
  void check_columns(const std::string& name) const;
  /// Throws Error(kInput) if a face names a material that the mesh lacks; `name` starts the
  /// message.
  void check_materials(const std::string& name) const;
};

}  // namespace surfel
