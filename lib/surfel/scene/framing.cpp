#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/rotation.h>
#include <surfel/scene/framing.h>

namespace surfel {
namespace {

/// Part of the half-picture that a framed scene fills.
constexpr double kFrameFill = 0.95;

/// Rotation whose rows are right, down and forward. `up` parallel to the view is replaced.
Eigen::Matrix3d look_along(const Vec3d& forward, const Vec3d& up) {
  Vec3d right = forward.cross(up);
  if (!(right.norm() > 1e-9 * up.norm())) right = forward.unitOrthogonal();
  right.normalize();
  const Vec3d down = forward.cross(right);
  Eigen::Matrix3d rotation;
  rotation.row(0) = right;
  rotation.row(1) = down;
  rotation.row(2) = forward;
  return rotation;
}

/// The box's support function.
double reach_of(const Bounds& box, const Vec3d& a) {
  return a.cwiseProduct((a.array() > 0).select(box.max, box.min)).sum();
}

}  // namespace

std::vector<std::string> CameraOptions::problems() const {
  std::vector<std::string> found;
  check_option(found, fov > 0 && fov < 180, "fov", fov, "in (0, 180) degrees");
  check_option(found, !ortho || (*ortho > 0 && std::isfinite(*ortho)), "ortho", ortho.value_or(0),
               "a positive height");
  check_rule(
      found, width >= 1 && width <= Camera::kMostSide && height >= 1 && height <= Camera::kMostSide,
      fmt::format("size is {}x{}; each side must be in 1..{}", width, height, Camera::kMostSide));
  check_option(found, near >= 0 && std::isfinite(near), "near", near, ">= 0");
  check_rule(found, !up || (up->allFinite() && up->norm() > 0),
             "`up` must be a finite direction, not zero");
  check_option(found, zoom > 0 && std::isfinite(zoom), "zoom", zoom, "> 0");
  check_rule(found, !eye || eye->allFinite(), "`eye` must be finite");
  check_rule(found, !from || (from->allFinite() && from->norm() > 0),
             "`from` must be a finite direction, not zero");
  check_rule(found, !eye || !from, "eye and from exclude each other");
  check_rule(found, !time || std::isfinite(*time), "`time` must be finite");
  check_rule(found, !target || target->allFinite(), "`target` must be finite");
  return found;
}

const SceneExtent& framed_extent(const CameraOptions& options, const SceneExtent& scene) {
  return scene.core && !options.frame_all ? *scene.core : scene;
}

Vec3d view_target(const CameraOptions& options, const SceneExtent& scene) {
  const Bounds& box = framed_extent(options, scene).box;
  return options.target.value_or(box.empty() ? Vec3d(0, 0, 0) : box.center());
}

Camera make_camera(const CameraOptions& options, const SceneExtent& whole) {
  const SceneExtent& scene = framed_extent(options, whole);
  Bounds box = scene.box;
  if (box.empty()) {
    box.add(Vec3d::Constant(-0.5));
    box.add(Vec3d::Constant(0.5));
  }
  const Vec3d target = view_target(options, whole);
  const bool z_up = std::abs(options.up_or_y().normalized().z()) > 0.9;
  const Vec3d side = options.from ? options.from->normalized()
                     : z_up       ? Vec3d(0, -1, 0.36).normalized()
                                  : Vec3d(0, 0.36, 1).normalized();
  const Vec3d back = options.eye ? Vec3d(*options.eye - target) : side;
  if (!(back.norm() > 0)) throw_usage("eye and target are the same point");

  Camera camera;
  camera.width = options.width;
  camera.height = options.height;
  camera.near = options.near;
  camera.center_x = options.width / 2.0;
  camera.center_y = options.height / 2.0;
  camera.orthographic = options.ortho.has_value();
  camera.camera_from_world = look_along(-back.normalized(), options.up_or_y());

  const bool frame = options.frame_all || !options.eye;
  const double half_y = portable::tan(options.fov * std::numbers::pi / 360) * kFrameFill;
  const double half_x = half_y * options.width / options.height;
  double distance = back.norm();
  double half_height = options.ortho.value_or(1) / 2;
  if (frame) {
    // How far the scene reaches beyond the target, in camera axes.
    const auto reach = [&](const Vec3d& in_camera, double b) {
      const Vec3d a = camera.camera_from_world.transpose() * in_camera;
      const double from_origin = scene.support ? scene.support(a, b) : reach_of(box, a);
      return from_origin - a.dot(target);
    };
    const auto to_either_side = [&](const Vec3d& across, const Vec3d& along, double b) {
      return std::max(reach(across + along, b), reach(along - across, b));
    };
    const double nearest = std::max(0.0, reach(-Vec3d::UnitZ(), 1));
    const double size = box.diagonal() > 0 ? box.diagonal() : 1;
    if (!camera.orthographic) {
      // Smallest distance from which all lies inside the picture: a sphere touches the side plane
      // of slope h where |x| + radius sqrt(1 + h^2) = h (z + distance).
      const auto needed = [&](const Vec3d& across, double h) {
        return to_either_side(across / h, -Vec3d::UnitZ(), portable::hypot(1, h) / h);
      };
      distance = std::max({needed(Vec3d::UnitX(), half_x), needed(Vec3d::UnitY(), half_y),
                           nearest + 0.05 * size}) +
                 options.near;
    } else {
      if (options.frame_all) {
        const double half_width = to_either_side(Vec3d::UnitX(), Vec3d::Zero(), 1);
        half_height = std::max({to_either_side(Vec3d::UnitY(), Vec3d::Zero(), 1),
                                half_width * options.height / options.width, 1e-3 * size}) /
                      kFrameFill;
      }
      distance = std::max(distance, nearest + size);
    }
  }
  camera.eye = target + back.normalized() * distance;
  const double half_picture =
      camera.orthographic ? half_height : portable::tan(options.fov * std::numbers::pi / 360);
  camera.focal_y = options.zoom * options.height / (2 * half_picture);
  camera.focal_x = camera.focal_y;
  return camera;
}

std::vector<Camera> turntable(const CameraOptions& options, const SceneExtent& scene, int count) {
  const Camera first = make_camera(options, scene);
  const Vec3d target = view_target(options, scene);
  std::vector<Camera> cameras;
  cameras.reserve(static_cast<std::size_t>(std::max(count, 0)));
  for (int i = 0; i < count; ++i) {
    const Eigen::Matrix3d turn =
        rotation_about(options.up_or_y().normalized(), 2 * std::numbers::pi * i / count).matrix();
    Camera camera = first;
    camera.eye = target + turn * (first.eye - target);
    camera.camera_from_world = first.camera_from_world * turn.transpose();
    cameras.push_back(camera);
  }
  return cameras;
}

}  // namespace surfel
