#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/cloud/cloud.h>

namespace surfel {

/// Pinhole or orthographic camera without distortion. Camera space: x right, y down, z forward.
/// A point p in camera space is seen at pixel coordinates (focal_x p.x / p.z + center_x,
/// focal_y p.y / p.z + center_y), orthographic without the division; (0, 0) is the corner of the
/// top left pixel, whose centre is (0.5, 0.5).
struct Camera {
  Eigen::Matrix3d camera_from_world = Eigen::Matrix3d::Identity();  ///< Rotation.
  Vec3d eye{0, 0, 0};                                               ///< World coordinates.
  int width = 512;
  int height = 512;
  double focal_x = 512;  ///< Pixels; orthographic: pixels per scene unit.
  double focal_y = 512;
  double center_x = 256;  ///< Principal point, pixels.
  double center_y = 256;
  bool orthographic = false;
  double near = 0;  ///< Nothing nearer along z is drawn; scene units, >= 0.
};

/// What a user says of a camera; what is left out is chosen so that the whole scene is seen.
struct CameraOptions {
  std::optional<Vec3d> eye;     ///< Default: in front of the target (towards +z, or -y where `up`
                                ///< is z) and 20 degrees above it, so far that all is seen.
  std::optional<Vec3d> from;    ///< Direction from the target to the eye, where `eye` is not set.
  std::optional<Vec3d> target;  ///< Default: the centre of the scene's bounding box.
  Vec3d up{0, 1, 0};            ///< Need not be perpendicular to the view.
  double fov = 40;              ///< Vertical field of view, degrees, in (0, 180).
  std::optional<double> ortho;  ///< Orthographic instead: visible height in scene units, > 0.
  int width = 512;              ///< Pixels, 1..65536.
  int height = 512;
  double near = 0;         ///< Scene units, >= 0.
  double zoom = 1;         ///< Enlarges the picture about its centre, once framed; > 0.
  bool frame_all = false;  ///< Move the eye along its line of sight (orthographic: set the
                           ///< height) until the whole scene is just seen.

  /// Empty if usable, else one sentence per violated rule.
  SURFEL_API std::vector<std::string> problems() const;
};

/// What a camera is to see: the box decides on the target, the support function on the distance.
struct SceneExtent {
  Bounds box;  ///< World; an empty one stands for a unit cube.
  /// Of the spheres that the scene consists of, the greatest a . center + b radius (b >= 0), world
  /// coordinates: how far it reaches in a direction. Unset: the box's.
  std::function<double(const Vec3d& a, double b)> support = {};
};

/// Camera from options. Throws Error(kUsage) if eye and target coincide.
SURFEL_API Camera make_camera(const CameraOptions& options, const SceneExtent& scene);

/// `count` cameras on a circle around the target, `up` its axis, the first one the camera itself.
SURFEL_API std::vector<Camera> turntable(const CameraOptions& options, const SceneExtent& scene,
                                         int count);

/// Reads cameras from TOML: keys eye, from, target, up, fov, ortho, size = [w, h], near, zoom,
/// frame-all at top level or, for several views, in tables [[camera]]; what a file leaves out comes
/// from `defaults`. Throws Error naming file and line; an unknown key is an error.
SURFEL_API std::vector<CameraOptions> read_cameras(const std::string& path,
                                                   const CameraOptions& defaults);

/// Row-major 4x4 world-to-camera matrix.
SURFEL_API std::vector<float> world_to_camera_matrix(const Camera& camera);

}  // namespace surfel
