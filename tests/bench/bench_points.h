#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <cstddef>
#include <numbers>

#include <surfel/base/morton.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel::bench {

/// Independent random points of a unit sphere with relief of three sizes, in random order or along
/// a Morton curve: a scan as far as searches are concerned.
inline Array<Vec3f> bumpy_sphere(std::size_t count, bool random_order = true) {
  Array<Vec3f> points(count);
  parallel_for(count, 1 << 14, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t i = begin; i < end; ++i) {
      const double z = 2 * random_uniform(42, i, 0) - 1;
      const double around = 2 * std::numbers::pi * random_uniform(42, i, 1);
      const double r = std::sqrt(1 - z * z);
      const Vec3d u(r * std::cos(around), r * std::sin(around), z);
      const double height =
          1 + 0.1 * std::sin(5 * u.x() + 1) * std::sin(4 * u.y()) * std::cos(3 * u.z()) +
          0.03 * std::sin(17 * u.x()) * std::sin(19 * u.y() + 2) * std::sin(16 * u.z()) +
          0.006 * std::sin(61 * u.x() + 20 * u.y()) * std::sin(57 * u.z());
      points[i] = (height * u).cast<float>();
    }
  });
  if (random_order) return points;
  SurfelCloud cloud;
  cloud.position = std::move(points);
  return cloud.gathered(morton_order(cloud.position)).position;
}

}  // namespace surfel::bench
