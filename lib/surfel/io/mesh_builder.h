#pragma once

#include <cstdint>
#include <limits>
#include <span>
#include <string>

#include <surfel/base/types.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

/// The polygons of a file on their way to a TriangleMesh: vertices, texture coordinates and normals
/// have pools of their own, as OBJ has them, and a polygon's corner names one of each. Internal to
/// the io module.
class MeshBuilder {
 public:
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

  struct Corner {
    std::uint32_t vertex = 0;
    std::uint32_t uv = kNone;
    std::uint32_t normal = kNone;
  };

  /// `file` is for messages.
  explicit MeshBuilder(std::string file) : file_(std::move(file)) {}

  Array<Vec3d> position;  ///< Finite.
  Array<Vec3f> color;     ///< One per position, or empty.
  Array<Vec2f> uv;
  Array<Vec3f> normal;
  std::vector<MeshMaterial> material;
  bool double_positions = false;  ///< The file's coordinates have the precision of double.

  /// Adds a polygon of three or more corners, whose indices may name vertices that are added later.
  /// The material is left out for all polygons or for none.
  void add_polygon(std::span<const Corner> corners, std::uint16_t polygon_material = 0);
  std::size_t polygon_count() const { return size_.size(); }

  /// Triangulates, drops faces without area and centres large coordinates. All indices must be
  /// valid. Throws Error(kInput) if no face is left. The builder cannot be used afterwards.
  TriangleMesh finish();

 private:
  void center_positions(TriangleMesh& mesh);
  void triangulate(TriangleMesh& mesh);
  void add_triangle(TriangleMesh& mesh, const std::array<Corner, 3>& corners,
                    std::uint16_t face_material);

  std::string file_;
  Array<Corner> corner_;              // Corners of all polygons, one polygon after the other.
  Array<std::uint32_t> size_;         // Corners per polygon.
  Array<std::uint16_t> material_of_;  // Per polygon.
  bool all_normals_ = true;           // Every kept corner has a normal of its own.
  bool any_uv_ = false;
};

}  // namespace surfel
