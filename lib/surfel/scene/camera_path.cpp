#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>

#include <fmt/format.h>
#include <surfel/base/elementary.h>
#include <surfel/base/option_check.h>
#include <surfel/scene/camera_path.h>
#include <surfel/scene/framing.h>

namespace surfel {
namespace {

/// A place on the path: after key `key` by the share `s` of the way to the next.
struct PathPlace {
  std::size_t key;
  double s;
};

PathPlace place_at(const std::vector<PathKey>& keys, double time) {
  std::size_t key = 0;
  while (key + 2 < keys.size() && keys[key + 1].time <= time) ++key;
  const double length = keys[key + 1].time - keys[key].time;
  return {key, std::clamp((time - keys[key].time) / length, 0.0, 1.0)};
}

/// The share of the path's time that has passed after a share of the pictures.
double eased(double u, PathEase ease) {
  switch (ease) {
    case PathEase::kNone:
      return u;
    case PathEase::kIn:
      return u * u;
    case PathEase::kOut:
      return u * (2 - u);
    case PathEase::kBoth:
      return u * u * (3 - 2 * u);
  }
  return u;
}

/// Cubic from a to b with these derivatives by s at its ends.
template <class T>
T hermite(const T& a, const T& b, const T& from, const T& to, double s) {
  const double s2 = s * s;
  const double s3 = s2 * s;
  return (2 * s3 - 3 * s2 + 1) * a + (s3 - 2 * s2 + s) * from + (3 * s2 - 2 * s3) * b +
         (s3 - s2) * to;
}

/// Points of the keys, on a spline that has the slopes of the parabolas through three keys.
Vec3d spline(const std::vector<PathKey>& keys, const PathPlace& at,
             const std::function<Vec3d(const PathKey&)>& point) {
  const auto step = [&](std::size_t k) { return keys[k + 1].time - keys[k].time; };
  const auto secant = [&](std::size_t k) -> Vec3d {
    return (point(keys[k + 1]) - point(keys[k])) / step(k);
  };
  const auto slope = [&](std::size_t k) -> Vec3d {
    if (keys.size() == 2) return secant(0);
    const std::size_t middle = std::clamp<std::size_t>(k, 1, keys.size() - 2);
    const double h0 = step(middle - 1);
    const double h1 = step(middle);
    const Vec3d d0 = secant(middle - 1);
    const Vec3d d1 = secant(middle);
    const Vec3d there = (h1 * d0 + h0 * d1) / (h0 + h1);
    return k < middle ? Vec3d(2 * d0 - there) : k > middle ? Vec3d(2 * d1 - there) : there;
  };
  const double h = step(at.key);
  return hermite<Vec3d>(point(keys[at.key]), point(keys[at.key + 1]), h * slope(at.key),
                        h * slope(at.key + 1), at.s);
}

/// Numbers of the keys, on a spline that has no extrema but at keys.
double monotone(const std::vector<PathKey>& keys, const PathPlace& at,
                const std::function<double(const PathKey&)>& number) {
  const auto step = [&](std::size_t k) { return keys[k + 1].time - keys[k].time; };
  const auto secant = [&](std::size_t k) {
    return (number(keys[k + 1]) - number(keys[k])) / step(k);
  };
  const auto slope = [&](std::size_t k) {
    if (k == 0 || k + 1 == keys.size()) return keys.size() == 2 ? secant(0) : 0.0;
    const double d0 = secant(k - 1);
    const double d1 = secant(k);
    if (!(d0 * d1 > 0)) return 0.0;
    const double alpha = (1 + step(k) / (step(k - 1) + step(k))) / 3;
    return d0 * d1 / (alpha * d1 + (1 - alpha) * d0);
  };
  const double h = step(at.key);
  return hermite(number(keys[at.key]), number(keys[at.key + 1]), h * slope(at.key),
                 h * slope(at.key + 1), at.s);
}

/// Half the rotation vector of a unit quaternion.
Vec3d log_of(const Quaternion& q) {
  const double sine = q.vec().norm();
  if (!(sine > 0)) return {0, 0, 0};
  return q.vec() * (portable::atan2(sine, q.w()) / sine);
}

Quaternion exp_of(const Vec3d& v) {
  const double angle = v.norm();
  if (!(angle > 0)) return Quaternion::Identity();
  const Vec3d axis = v * (portable::sin(angle) / angle);
  return {portable::cos(angle), axis.x(), axis.y(), axis.z()};
}

/// Along the great circle from a to b, which is the longer way round if they are further apart
/// than half a turn.
Quaternion slerp(const Quaternion& a, const Quaternion& b, double s) {
  return (a * exp_of(s * log_of(a.conjugate() * b))).normalized();
}

/// The keys' orientations as quaternions, each on the side of the one before it.
std::vector<Quaternion> orientations(const std::vector<PathKey>& keys) {
  std::vector<Quaternion> turns;
  for (const PathKey& key : keys) {
    Quaternion q(key.camera.camera_from_world);
    q.normalize();
    if (!turns.empty() && turns.back().dot(q) < 0) q.coeffs() *= -1;
    turns.push_back(q);
  }
  return turns;
}

Quaternion squad(const std::vector<Quaternion>& q, const PathPlace& at) {
  const auto inner = [&](std::size_t k) -> Quaternion {
    if (k == 0 || k + 1 == q.size()) return q[k];
    const Quaternion inverse = q[k].conjugate();
    return (q[k] * exp_of((log_of(inverse * q[k + 1]) + log_of(inverse * q[k - 1])) / -4))
        .normalized();
  };
  const std::size_t k = at.key;
  return slerp(slerp(q[k], q[k + 1], at.s), slerp(inner(k), inner(k + 1), at.s),
               2 * at.s * (1 - at.s));
}

}  // namespace

std::vector<std::string> path_problems(const std::vector<PathKey>& keys) {
  std::vector<std::string> found;
  check_rule(found, keys.size() >= 2, "a path needs two key frames at least");
  for (std::size_t k = 1; k < keys.size(); ++k) {
    const Camera& a = keys[k - 1].camera;
    const Camera& b = keys[k].camera;
    if (!(keys[k].time > keys[k - 1].time)) {
      found.push_back(fmt::format("key frame {} is at time {:g}, and must be later than {:g}", k,
                                  keys[k].time, keys[k - 1].time));
    } else if (a.width != b.width || a.height != b.height) {
      found.push_back(
          fmt::format("key frame {} has {}x{} pixels, the one before it {}x{}; all "
                      "must have the same",
                      k, b.width, b.height, a.width, a.height));
    } else if (a.orthographic != b.orthographic) {
      found.push_back(fmt::format("key frame {} is {}, the one before it is not", k,
                                  b.orthographic ? "orthographic" : "in perspective"));
    } else {
      continue;
    }
    break;
  }
  return found;
}

std::vector<Camera> camera_path(const std::vector<PathKey>& keys, std::size_t count,
                                PathEase ease) {
  const bool targets =
      std::all_of(keys.begin(), keys.end(), [](const PathKey& key) { return key.target; });
  const std::vector<Quaternion> turns = orientations(keys);
  std::vector<Camera> cameras;
  for (std::size_t i = 0; i < count; ++i) {
    const double u = count > 1 ? static_cast<double>(i) / static_cast<double>(count - 1) : 0;
    const double begin = keys.front().time;
    const PathPlace at = place_at(keys, begin + eased(u, ease) * (keys.back().time - begin));
    Camera camera = keys[at.key].camera;
    const auto number = [&](double Camera::*field) {
      return monotone(keys, at, [field](const PathKey& key) { return key.camera.*field; });
    };
    const auto focal = [&](double Camera::*field) {
      return portable::exp(monotone(
          keys, at, [field](const PathKey& key) { return portable::log(key.camera.*field); }));
    };
    camera.focal_x = focal(&Camera::focal_x);
    camera.focal_y = focal(&Camera::focal_y);
    camera.center_x = number(&Camera::center_x);
    camera.center_y = number(&Camera::center_y);
    camera.near = std::max(0.0, number(&Camera::near));
    camera.eye = spline(keys, at, [](const PathKey& key) { return key.camera.eye; });
    if (targets) {
      CameraOptions options;
      options.eye = camera.eye;
      options.target = spline(keys, at, [](const PathKey& key) { return *key.target; });
      options.up = spline(keys, at, [](const PathKey& key) { return key.up.normalized(); });
      // Where the eye meets its target, or up turns over, the camera keeps the key's direction.
      const bool usable = (*options.target - *options.eye).norm() > 0 && options.up->norm() > 0;
      if (usable) camera.camera_from_world = make_camera(options, {}).camera_from_world;
    } else {
      camera.camera_from_world = squad(turns, at).toRotationMatrix();
    }
    cameras.push_back(camera);
  }
  return cameras;
}

}  // namespace surfel
