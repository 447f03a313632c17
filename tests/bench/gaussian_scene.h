#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <random>

#include <surfel/scene/camera.h>
#include <surfel/scene/gaussian_cloud.h>

namespace surfel::bench {

/// Gaussians as training leaves them: flat ones on a ground, on balls standing on it and on a far
/// dome, sizes by their spacing and spread over a factor of ten, opacities mostly near 0 or 1,
/// spherical harmonics of degree 3.
inline GaussianCloud trained_like(std::size_t count) {
  std::mt19937 random(5);
  const auto uniform = [&] { return static_cast<double>(random()) / 4294967296.0; };
  const auto normal = [&] {
    return std::sqrt(-2 * std::log(uniform() + 1e-12)) * std::cos(6.283185307179586 * uniform());
  };
  GaussianCloud cloud;
  cloud.degree = 3;
  const std::size_t stride = cloud.harmonics_stride();
  cloud.position.resize(count);
  cloud.scale.resize(count);
  cloud.rotation.resize(count);
  cloud.amplitude.resize(count);
  cloud.harmonics.resize(count * stride);
  for (std::size_t i = 0; i < count; ++i) {
    Vec3d p;
    Vec3d n(0, -1, 0);
    double area = 0;  // Of the surface that the Gaussian is on.
    double share = 0;
    const Vec3d on_sphere = Vec3d(normal(), normal(), normal()).normalized();
    switch (i % 10) {
      case 0:
      case 1:
      case 2:
        p = {8 * uniform() - 4, 1, 8 * uniform() - 4};
        area = 64;
        share = 0.3;
        break;
      case 3:
      case 4:
        p = 20 * on_sphere;
        n = -on_sphere;
        area = 12.57 * 400;
        share = 0.2;
        break;
      default: {
        const auto ball = static_cast<double>(i / 10 % 7);
        const double angle = 0.9 * ball;
        const double radius = 0.5 + 0.05 * ball;
        p = radius * on_sphere + Vec3d(2.2 * std::cos(angle), 1 - radius, 2.2 * std::sin(angle));
        n = on_sphere;
        area = 7 * 12.57 * 0.45;
        share = 0.5;
      }
    }
    p += 0.01 * Vec3d(normal(), normal(), normal());
    const double spacing = std::sqrt(area / (share * static_cast<double>(count)));
    cloud.position[i] = p.cast<float>();
    cloud.scale[i] = (spacing * Vec3d(std::exp(0.5 * normal()), std::exp(0.5 * normal()),
                                      0.15 * std::exp(0.5 * normal())))
                         .cast<float>();
    const Eigen::Quaterniond q =
        Eigen::Quaterniond::FromTwoVectors(Vec3d(0, 0, 1), n) *
        Eigen::Quaterniond(Eigen::AngleAxisd(6.28 * uniform(), Vec3d(0, 0, 1)));
    cloud.rotation[i] = {static_cast<float>(q.w()), static_cast<float>(q.x()),
                         static_cast<float>(q.y()), static_cast<float>(q.z())};
    cloud.amplitude[i] = static_cast<float>(1 / (1 + std::exp(-(0.5 + 2.5 * normal()))));
    for (std::size_t k = 0; k < stride; ++k) {
      cloud.harmonics[i * stride + k] = static_cast<float>(normal() * (k < 3 ? 0.8 : 0.1));
    }
  }
  return cloud;
}

/// A camera that walks around the balls; y is down.
inline Camera walking_camera(int width, int height) {
  Camera camera;
  camera.width = width;
  camera.height = height;
  camera.focal_x = camera.focal_y = 0.6 * width;
  camera.center_x = 0.5 * width;
  camera.center_y = 0.5 * height;
  camera.eye = {0.3, -0.6, -4.5};
  const Vec3d z = (Vec3d(0, 0.6, 0) - camera.eye).normalized();
  const Vec3d x = Vec3d(0, 1, 0).cross(z).normalized();
  camera.camera_from_world << x.transpose(), z.cross(x).transpose(), z.transpose();
  return camera;
}

}  // namespace surfel::bench
