#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <optional>
#include <vector>

#include <surfel/base/random.h>
#include <surfel/base/types.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel::test {

/// A depth camera that tells depth from the disparity of two views, as structured light does. The
/// noise is what Khoshelham, Elberink 2012 and Nguyen, Izadi, Lovell 2012 measured of a Kinect.
struct DepthCamera {
  int width = 640;
  int height = 480;
  int step = 1;              ///< Every step-th pixel of every step-th row is kept.
  double focal = 525;        ///< Pixels.
  double baseline = 0.075;   ///< Metres.
  double disparity = 0.125;  ///< Disparities are multiples of this many pixels; 0 = exact.
  double noise = 1;          ///< Times the standard deviation 1.2 mm + 1.9 mm (z - 0.4 m)^2.
  double lateral = 0.5;      ///< Standard deviation of the place that a pixel sees, pixels.
  double lost = 0.7;         ///< Share of the pixels beside a jump of depth that see nothing.
};

/// What a ray from the origin meets.
struct RangeHit {
  double distance = std::numeric_limits<double>::infinity();  ///< In lengths of the direction.
  Vec3d normal{0, 0, 0};                                      ///< Unit, towards the origin.
};

/// The nearest surface of a room of 3.6 m with a box, a ball and a column in it. x points right, y
/// down, z into the room.
inline RangeHit room_hit(const Vec3d& direction) {
  RangeHit nearest;
  const auto meet = [&](double distance, const Vec3d& normal) {
    if (!(distance > 0 && distance < nearest.distance)) return;
    nearest = {distance, normal.dot(direction) > 0 ? Vec3d(-normal) : normal};
  };
  const auto wall = [&](const Vec3d& normal, double offset) {
    meet(offset / normal.dot(direction), normal);
  };
  wall({0, 0, 1}, 3.6);
  wall({0, 1, 0}, 1.1);
  wall({1, 0, 0}, -1.7);
  // The box: slabs of its own axes.
  const double turn = 0.6;
  const std::array<Vec3d, 3> axis = {Vec3d(std::cos(turn), 0, std::sin(turn)), Vec3d(0, 1, 0),
                                     Vec3d(-std::sin(turn), 0, std::cos(turn))};
  const Vec3d center(-0.5, 0.75, 2.1);
  const Vec3d half(0.35, 0.35, 0.25);
  double enter = 0;
  double leave = std::numeric_limits<double>::infinity();
  Vec3d side = axis[0];
  for (int k = 0; k < 3; ++k) {
    const double along = axis[static_cast<std::size_t>(k)].dot(direction);
    const double middle = axis[static_cast<std::size_t>(k)].dot(center);
    const double a = (middle - half[k]) / along;
    const double b = (middle + half[k]) / along;
    if (std::min(a, b) > enter) {
      enter = std::min(a, b);
      side = axis[static_cast<std::size_t>(k)];
    }
    leave = std::min(leave, std::max(a, b));
  }
  if (enter < leave) meet(enter, side);
  // A ball, and a column without an end: the smaller root of |p + t d|^2 = r^2.
  const auto round = [&](const Vec3d& middle, const Vec3d& kept, double radius) {
    const Vec3d d = direction.cwiseProduct(kept);
    const Vec3d m = middle.cwiseProduct(kept);
    const double b = d.dot(m);
    const double root = b * b - d.squaredNorm() * (m.squaredNorm() - radius * radius);
    if (root < 0) return;
    const double t = (b - std::sqrt(root)) / d.squaredNorm();
    meet(t, (t * d - m).normalized());
  };
  round({0.35, 0.2, 1.5}, {1, 1, 1}, 0.3);
  round({1.1, 0, 2.5}, {1, 0, 1}, 0.2);
  return nearest;
}

/// A range image: its points, and the true normals there, smoothed over what the noise spans.
struct RangeImage {
  SurfelCloud points;
  Array<Vec3f> normal;
};

/// The room as the camera at the origin sees it.
inline RangeImage room_range_image(const DepthCamera& camera) {
  RangeImage out;
  const auto gauss = [](std::uint64_t pixel, std::uint64_t dimension) {
    const double u = std::max(random_uniform(21, pixel, 2 * dimension), 1e-12);
    return std::sqrt(-2 * std::log(u)) *
           std::cos(2 * std::numbers::pi * random_uniform(21, pixel, 2 * dimension + 1));
  };
  const auto direction = [&](double x, double y) {
    return Vec3d((x - camera.width / 2.0) / camera.focal, (y - camera.height / 2.0) / camera.focal,
                 1);
  };
  for (int y = camera.step / 2; y < camera.height; y += camera.step) {
    for (int x = camera.step / 2; x < camera.width; x += camera.step) {
      const auto pixel = static_cast<std::uint64_t>(y * camera.width + x);
      const double px = x + 0.5 + camera.lateral * gauss(pixel, 0);
      const double py = y + 0.5 + camera.lateral * gauss(pixel, 1);
      const RangeHit hit = room_hit(direction(px, py));
      const double z = hit.distance;
      const double sigma = camera.noise * (0.0012 + 0.0019 * (z - 0.4) * (z - 0.4));
      // A camera sees nothing of a surface that it looks along, and little beside a jump.
      const Vec3d ray = direction(px, py).normalized();
      if (!std::isfinite(z) || -hit.normal.dot(ray) < 0.15) continue;
      bool jump = false;
      for (const auto& [dx, dy] :
           {std::pair(1, 0), std::pair(-1, 0), std::pair(0, 1), std::pair(0, -1)}) {
        jump |= std::abs(room_hit(direction(x + 0.5 + dx, y + 0.5 + dy)).distance - z) > 0.05 * z;
      }
      if (jump && random_uniform(22, pixel) < camera.lost) continue;
      const double full = camera.focal * camera.baseline;
      double disparity = full / z + sigma * full / (z * z) * gauss(pixel, 2);
      if (camera.disparity > 0) {
        disparity = camera.disparity * std::round(disparity / camera.disparity);
      }
      out.points.position.push_back((direction(x + 0.5, y + 0.5) * full / disparity).cast<float>());
      // Closer to an edge than the noise, no one can tell which side a point is of.
      const double blur = camera.step + sigma * camera.focal / z;
      Vec3d normal = hit.normal;
      for (int k = 0; k < 8; ++k) {
        const double turn = k * std::numbers::pi / 4;
        const RangeHit near =
            room_hit(direction(px + blur * std::cos(turn), py + blur * std::sin(turn)));
        if (std::abs(near.distance - z) < 0.05 * z) normal += near.normal;
      }
      out.normal.push_back(normal.normalized().cast<float>());
    }
  }
  return out;
}

/// Share of the normals that are more than `angle` off the true ones, whatever their side; zero
/// normals are.
inline double share_beyond(const Array<Vec3f>& normal, const Array<Vec3f>& truth, double angle) {
  std::size_t beyond = 0;
  for (std::size_t i = 0; i < normal.size(); ++i) {
    beyond += std::abs(normal[i].dot(truth[i])) < std::cos(angle) ? 1 : 0;
  }
  return static_cast<double>(beyond) / static_cast<double>(normal.size());
}

}  // namespace surfel::test
