#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/surface/neighbor_search.h>

namespace surfel {

/// Rotation and translation: p goes to rotation * p + translation.
struct RigidPose {
  Quaternion rotation{Quaternion::Identity()};  ///< Unit.
  Vec3d translation{0, 0, 0};

  Vec3d operator()(const Vec3d& p) const { return rotation * p + translation; }
  RigidPose inverse() const;
  RigidPose operator*(const RigidPose& first) const;  ///< First the other, then this one.
};

/// The finite points of a scan, without strays, about their own centre, made ready to be matched.
struct Scan {
  Vec3d center{0, 0, 0};       ///< Mean of the points, world coordinates.
  double radius = 0;           ///< Of the ball around the centre that holds the points.
  double spacing = 0;          ///< point_spacing().
  bool oriented = false;       ///< Normals tell front from back, as a file's own normals do.
  Array<Vec3f> position;       ///< Relative to the centre, along a space-filling curve.
  Array<Vec3f> normal;         ///< Unit; zero: unknown.
  Array<std::uint8_t> border;  ///< 1 where the surface ends beside a point.
  std::unique_ptr<NeighborSearch> search;  ///< Searches `position`.
};

/// Normals come from the points; `name` starts messages. Throws Error(kInput) for fewer than 100
/// finite points, and where half of the points lie on others.
SURFEL_API Scan make_scan(const SurfelCloud& cloud, const std::string& name);

}  // namespace surfel
