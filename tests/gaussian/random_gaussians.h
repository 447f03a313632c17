#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <random>

#include <surfel/scene/camera.h>
#include <surfel/scene/gaussian_cloud.h>

namespace surfel::test {

/// A camera at the origin that looks along +z, with a principal point off the middle.
inline Camera gaussian_camera(int width, int height) {
  Camera camera;
  camera.width = width;
  camera.height = height;
  camera.focal_x = 0.9 * width;
  camera.focal_y = 1.1 * width;
  camera.center_x = 0.53 * width;
  camera.center_y = 0.46 * height;
  return camera;
}

/// Round, flat and needle-like Gaussians of all opacities in front of gaussian_camera(), some
/// beside the picture and some near the eye.
/// \param scale  median standard deviation over the depth.
inline GaussianCloud random_gaussians(std::size_t count, unsigned seed, int degree = 3,
                                      double scale = 0.03) {
  std::mt19937 random(seed);
  const auto uniform = [&](double a, double b) {
    return a + (b - a) * (static_cast<double>(random()) / 4294967296.0);
  };
  GaussianCloud cloud;
  cloud.origin = {1000, -2000, 500};
  cloud.degree = degree;
  for (std::size_t i = 0; i < count; ++i) {
    const double z = uniform(0.15, 6);
    cloud.position.push_back(
        Vec3d(uniform(-0.8, 0.8) * z, uniform(-0.7, 0.7) * z, z).cast<float>());
    Vec3f s;
    for (int k = 0; k < 3; ++k) {
      s[k] = static_cast<float>(scale * std::sqrt(z) * std::exp2(uniform(-3, 2)));
    }
    if (i % 4 == 1) s[2] *= 1e-3F;
    cloud.scale.push_back(s);
    const Eigen::Vector4d q =
        Eigen::Vector4d(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1), uniform(-1, 1))
            .normalized();
    cloud.rotation.push_back({static_cast<float>(q[0]), static_cast<float>(q[1]),
                              static_cast<float>(q[2]), static_cast<float>(q[3])});
    cloud.amplitude.push_back(static_cast<float>(i % 5 == 0 ? 1 : uniform(0, 1)));
    for (std::size_t k = 0; k < cloud.harmonics_stride(); ++k) {
      cloud.harmonics.push_back(static_cast<float>(uniform(-1, 1) * (k < 3 ? 1.5 : 0.25)));
    }
  }
  return cloud;
}

/// gaussian_camera() where random_gaussians() expect it.
inline Camera camera_before(const GaussianCloud& cloud, int width, int height) {
  Camera camera = gaussian_camera(width, height);
  camera.eye = cloud.origin;
  return camera;
}

}  // namespace surfel::test
