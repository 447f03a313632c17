#pragma once

#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/camera.h>

namespace surfel {

/// A camera that a path goes through.
struct PathKey {
  double time = 0;              ///< Seconds, or any other unit; grows from key to key.
  Camera camera;                ///< All have the same size and projection.
  std::optional<Vec3d> target;  ///< Point looked at.
  Vec3d up{0, 1, 0};            ///< Up in the picture, where all keys have targets.
};

enum class PathEase {
  kNone,
  kIn,   ///< From rest.
  kOut,  ///< To rest.
  kBoth
};

/// Empty if the keys make a path, else one sentence per violated rule.
SURFEL_API std::vector<std::string> path_problems(const std::vector<PathKey>& keys);

/// `count` cameras along the path, evenly in time, the first and the last key at its ends; with
/// ease the time itself has a speed that grows from zero and falls to it.
///
/// Eyes, and targets where all keys have one, lie on cubic Hermite splines with the slopes of the
/// parabolas through each three keys (Catmull-Rom's where keys are even in time), so that speed
/// does not jump. Without targets orientations turn by spherical cubics (Shoemake, "Quaternion
/// calculus and fast animation", 1987: squad). Focal lengths (their logarithms), principal points
/// and near planes go monotonously between keys (Fritsch, Butland 1984), so that a zoom does not
/// overshoot. The keys have no path_problems().
SURFEL_API std::vector<Camera> camera_path(const std::vector<PathKey>& keys, std::size_t count,
                                           PathEase ease);

}  // namespace surfel
