#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/bounds.h>
#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/camera.h>

namespace surfel {

/// The camera as a user describes it. An option that is not set gets a value with which the picture
/// shows the whole scene; stray points may lie outside of the picture.
struct CameraOptions {
  std::optional<Vec3d> eye;     ///< Default: in front of the target (towards +z, or -y where `up`
                                ///< is z) and 20 degrees above it, so far that all is seen.
  std::optional<Vec3d> from;    ///< Direction from the target to the eye, where `eye` is not set.
  std::optional<Vec3d> target;  ///< Default: the centre of the box around what is to be seen.
  std::optional<Vec3d> up;      ///< Need not be perpendicular to the view; default: y.
  double fov = 40;              ///< Vertical field of view, degrees, in (0, 180).
  std::optional<double> ortho;  ///< Orthographic instead: visible height in scene units, > 0.
  int width = 512;              ///< Pixels, 1..65536.
  int height = 512;
  double near = 0;             ///< Scene units, >= 0.
  double zoom = 1;             ///< Enlarges the picture about its centre, once framed; > 0.
  std::string name;            ///< Of the picture, for its file; has no effect on what is seen.
  std::optional<double> time;  ///< Seconds, for paths; has no effect on what is seen.
  bool frame_all = false;      ///< Move the eye along its line of sight (orthographic: set the
                               ///< height) until the whole scene is just seen, with stray points.

  Vec3d up_or_y() const { return up.value_or(Vec3d(0, 1, 0)); }
  /// Empty if usable, else one sentence per violated rule.
  SURFEL_API std::vector<std::string> problems() const;
};

/// The scene that a camera is to see: its box decides on the target, its support function on the
/// distance.
struct SceneExtent {
  Bounds box;  ///< World; an empty one stands for a unit cube.
  /// Of the spheres that the scene consists of, the greatest a . center + b radius (b >= 0), world
  /// coordinates: how far it reaches in a direction. Unset: the box's.
  std::function<double(const Vec3d& a, double b)> support = {};
  /// The scene without its stray points (stray_points.h), which is what is framed unless
  /// CameraOptions::frame_all is set. Unset: there are none.
  std::shared_ptr<const SceneExtent> core = {};
  std::uint64_t stray = 0;  ///< Number of stray points.
};

/// The part of the scene that a camera is to see.
SURFEL_API const SceneExtent& framed_extent(const CameraOptions& options, const SceneExtent& scene);

/// The point that a camera looks at.
SURFEL_API Vec3d view_target(const CameraOptions& options, const SceneExtent& scene);

/// Camera from options. Throws Error(kUsage) if eye and target coincide.
SURFEL_API Camera make_camera(const CameraOptions& options, const SceneExtent& scene);

/// `count` cameras on a circle around the target, `up` its axis, the first one the camera itself.
SURFEL_API std::vector<Camera> turntable(const CameraOptions& options, const SceneExtent& scene,
                                         int count);

}  // namespace surfel
