#pragma once

#include <Eigen/Geometry>
#include <cmath>

#include <surfel/base/random.h>
#include <surfel/render/a_buffer.h>
#include <surfel/render/ewa_kernel.h>
#include <surfel/render/renderer.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/framing.h>

namespace surfel::test {

/// Camera at the origin's +z side looking along -z, so that world x is right and y is up.
inline Camera camera_at(double distance, int size, double fov = 40) {
  CameraOptions options;
  options.eye = Vec3d(0, 0, distance);
  options.target = Vec3d(0, 0, 0);
  options.fov = fov;
  options.width = size;
  options.height = size;
  return make_camera(options, SceneExtent{});
}

/// Orthographic, looking along -z: the square [-1, 1]^2 in z = 0 fills the picture exactly.
inline Camera square_camera(int size) {
  CameraOptions options;
  options.eye = Vec3d(0, 0, 4);
  options.target = Vec3d(0, 0, 0);
  options.ortho = 2;
  options.width = options.height = size;
  return make_camera(options, SceneExtent{});
}

inline void add_surfel(SurfelCloud& cloud, const Vec3f& position, const Vec3f& normal,
                       float variance, float area, const Vec3f& color) {
  cloud.position.push_back(position);
  cloud.normal.push_back(normal);
  cloud.variance.push_back(variance);
  cloud.area.push_back(area);
  cloud.coefficient.push_back(color);
}

/// Jittered grid of n x n surfels over [-half, half]^2 in z = `z`, V = h^2 I, random colours.
inline SurfelCloud jittered_plane(int n, double half, double jitter, std::uint64_t seed = 1,
                                  double z = 0) {
  SurfelCloud cloud;
  const double h = 2 * half / n;
  for (int j = 0; j < n; ++j) {
    for (int i = 0; i < n; ++i) {
      const auto k = static_cast<std::uint64_t>(j) * n + i;
      const double du = (2 * random_uniform(seed, k, 0) - 1) * jitter;
      const double dv = (2 * random_uniform(seed, k, 1) - 1) * jitter;
      add_surfel(
          cloud, Vec3d(-half + (i + 0.5 + du) * h, -half + (j + 0.5 + dv) * h, z).cast<float>(),
          Vec3f(0, 0, 1), static_cast<float>(h * h), static_cast<float>(h * h),
          Vec3d(random_uniform(seed, k, 2), random_uniform(seed, k, 3), random_uniform(seed, k, 4))
              .cast<float>());
    }
  }
  return cloud;
}

/// Area-uniform Fibonacci sphere.
inline SurfelCloud fibonacci_sphere(int n, double radius, const Vec3f& color = {1, 1, 1}) {
  SurfelCloud cloud;
  const double area = 4 * M_PI * radius * radius / n;
  for (int i = 0; i < n; ++i) {
    const double y = 1 - (2 * i + 1.0) / n;
    const double r = std::sqrt(1 - y * y);
    const double phi = i * M_PI * (3 - std::sqrt(5.0));
    const Vec3d p(r * std::cos(phi), y, r * std::sin(phi));
    add_surfel(cloud, (radius * p).cast<float>(), p.cast<float>(), static_cast<float>(area),
               static_cast<float>(area), color);
  }
  return cloud;
}

struct Stack {
  SurfelCloud cloud;
  Rgba expected;  ///< Exact composite over nothing.
};

/// k planes behind one another, each of one colour and alpha.
inline Stack stacked_planes(int k) {
  Stack stack;
  for (int i = 0; i < k; ++i) {
    const auto alpha = static_cast<float>(0.2 + 0.5 * random_uniform(5, i));
    const Vec3f color =
        Vec3d(random_uniform(6, i, 0), random_uniform(6, i, 1), random_uniform(6, i, 2))
            .cast<float>();
    SurfelCloud plane = jittered_plane(48, 1.5, 0.25, 10 + i, -0.4 * i);
    for (std::size_t s = 0; s < plane.size(); ++s) {
      add_surfel(stack.cloud, plane.position[s], plane.normal[s], plane.variance[s], plane.area[s],
                 color);
      stack.cloud.alpha.push_back(alpha);
    }
    stack.expected.composite({color.x() * alpha, color.y() * alpha, color.z() * alpha, alpha});
  }
  return stack;
}

/// Largest difference of a picture, 16 pixels inside its border, from one colour.
inline double worst_error(const Image& image, const Rgba& expected) {
  double worst = 0;
  for (int y = 16; y < image.height - 16; ++y) {
    for (int x = 16; x < image.width - 16; ++x) {
      const float* p = image.pixel(x, y);
      const float e[] = {expected.red, expected.green, expected.blue, expected.alpha};
      for (int c = 0; c < 4; ++c) worst = std::max<double>(worst, std::abs(p[c] - e[c]));
    }
  }
  return worst;
}

/// The unlit picture with all AOVs.
inline Image render_unlit(const SurfelCloud& cloud, const Camera& camera,
                          RenderOptions options = {}, FrameStatistics* statistics = nullptr) {
  options.lit = false;
  options.aovs = true;
  RenderCloud surfels(cloud);
  const Scene scene;
  Renderer renderer(surfels, scene, options);
  return renderer.render(camera, statistics);
}

/// Places of the AOVs in a pixel.
enum Aov { kZ = 4, kZFirst = 5, kNormal = 6, kSumOfRho = 9 };

/// Surfel i as the kernel takes it.
inline SurfelInCamera in_camera(const SurfelCloud& cloud, std::size_t i, const Camera& camera) {
  SurfelInCamera s;
  s.position = camera.camera_from_world * (cloud.world(i) - camera.eye);
  s.normal = camera.camera_from_world * cloud.normal[i].cast<double>().normalized();
  if (cloud.anisotropic()) {
    s.tangent = camera.camera_from_world * cloud.tangent[i].cast<double>();
    s.variance_u = cloud.variance_u[i];
    s.variance_v = cloud.variance_v[i];
  } else {
    s.tangent = s.normal.unitOrthogonal();
    s.variance_u = s.variance_v = cloud.variance[i];
  }
  s.area = cloud.area[i];
  return s;
}

/// Cameras that no picture can be taken with.
inline std::vector<Camera> unusable_cameras() {
  std::vector<Camera> bad(7, camera_at(3, 16));
  bad[0].width = 0;
  bad[1].height = Camera::kMostSide + 1;
  bad[2].eye.x() = NAN;
  bad[3].camera_from_world(1, 1) = INFINITY;
  bad[4].focal_x = 0;
  bad[5].center_y = NAN;
  bad[6].near = -1;
  return bad;
}

}  // namespace surfel::test
