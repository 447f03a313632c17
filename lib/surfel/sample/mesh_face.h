#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include <surfel/base/types.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

using FaceCorners = std::array<Vec3d, 3>;

inline FaceCorners face_corners(const TriangleMesh& mesh, std::size_t face) {
  FaceCorners out;
  for (int k = 0; k < 3; ++k) out[k] = mesh.position[mesh.face[face][k]].cast<double>();
  return out;
}

/// The face's normal, as long as twice its area.
inline Vec3d area_vector(const FaceCorners& corner) {
  return (corner[1] - corner[0]).cross(corner[2] - corner[0]);
}

inline double longest_edge(const FaceCorners& corner) {
  return std::sqrt(
      std::max({(corner[1] - corner[0]).squaredNorm(), (corner[2] - corner[1]).squaredNorm(),
                (corner[0] - corner[2]).squaredNorm()}));
}

/// Derivatives of the position by uv over a face.
struct UvFrame {
  Vec3d dpdu = Vec3d::Zero();
  Vec3d dpdv = Vec3d::Zero();
};

/// The derivatives are zero where the uv span no area: less than 1e-12 of the area that their edges
/// could span, which is rounding.
inline UvFrame uv_frame(const FaceCorners& corner, const std::array<Vec2f, 3>& uv) {
  const Vec2d a = (uv[1] - uv[0]).cast<double>();
  const Vec2d b = (uv[2] - uv[0]).cast<double>();
  const double determinant = a.x() * b.y() - a.y() * b.x();
  if (!(std::abs(determinant) > 1e-12 * (a.norm() * b.norm()))) return {};
  const Vec3d edge_a = corner[1] - corner[0];
  const Vec3d edge_b = corner[2] - corner[0];
  return {(b.y() * edge_a - a.y() * edge_b) / determinant,
          (a.x() * edge_b - b.x() * edge_a) / determinant};
}

}  // namespace surfel
