#include <algorithm>
#include <array>
#include <vector>

#include <surfel/measure/judged_surface.h>
#include <surfel/measure/sensor_view.h>

namespace surfel {

std::optional<SensorView> find_sensor_view(const JudgedSurface& s, const Viewpoint& viewpoint,
                                           Vec3d& up) {
  const Vec3d eye = viewpoint.position - s.origin;
  const Vec3d to_center = (s.center - eye).normalized();
  if (!to_center.allFinite()) return std::nullopt;
  const Vec4d& q = viewpoint.orientation;
  const Eigen::Matrix3d turned =
      Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix();
  // Sensors look along z with y down (cameras), along -z with y up (graphics), or along x with z up
  // (robots); files do not say which of them is meant, the points do.
  struct Axes {
    Vec3d forward;
    Vec3d up;
  };
  const std::array<Axes, 3> known{Axes{turned.col(2), -turned.col(1)},
                                  Axes{-turned.col(2), turned.col(1)},
                                  Axes{turned.col(0), turned.col(2)}};
  const Axes* axes = &known[0];
  for (const Axes& other : known) {
    if (other.forward.dot(to_center) > axes->forward.dot(to_center) + 1e-9) axes = &other;
  }
  if (!(axes->forward.dot(to_center) > 0.5)) return std::nullopt;
  // The middle of what it saw, and its extent, in the picture across the direction of the centre.
  up = axes->up;
  SensorView view{viewpoint.position, to_center, up, 0, 0};
  for (int pass = 0; pass < 2; ++pass) {
    const Vec3d right = view.forward.cross(view.up).normalized();
    view.up = right.cross(view.forward);
    std::vector<double> x;
    std::vector<double> y;
    for (const SurfaceSample::Point& p : s.points) {
      const Vec3d ray = p.position.cast<double>() - eye;
      const double z = ray.dot(view.forward);
      if (!(z > 0)) continue;
      x.push_back(ray.dot(right) / z);
      y.push_back(ray.dot(view.up) / z);
    }
    // Too many behind it: it looked around, and has no picture of its own.
    if (static_cast<double>(x.size()) < 0.95 * static_cast<double>(s.points.size())) {
      return std::nullopt;
    }
    const Range u = range_of(x);
    const Range v = range_of(y);
    view.tan_x = u.size() / 2;
    view.tan_y = v.size() / 2;
    if (pass == 0) {
      view.forward =
          (view.forward + (u.min + u.max) / 2 * right + (v.min + v.max) / 2 * view.up).normalized();
    }
  }
  constexpr double kWidest = 1.75;  // 120 degrees.
  if (!(view.tan_x > 0 && view.tan_y > 0 && std::max(view.tan_x, view.tan_y) < kWidest)) {
    return std::nullopt;
  }
  return view;
}

}  // namespace surfel
