#pragma once

#include <cmath>
#include <cstddef>
#include <numbers>
#include <string>

#include <surfel/io/cloud_io.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel::test {

/// Surfels of a sphere, of all colours, along a spiral from pole to pole.
inline SurfelCloud sphere(std::size_t count, bool elliptic = false) {
  SurfelCloud cloud;
  for (std::size_t i = 0; i < count; ++i) {
    const double y = 1 - (2 * static_cast<double>(i) + 1) / static_cast<double>(count);
    const double angle = static_cast<double>(i) * std::numbers::pi * (3 - std::sqrt(5.0));
    const double r = std::sqrt(1 - y * y);
    const Vec3f p(static_cast<float>(r * std::cos(angle)), static_cast<float>(y),
                  static_cast<float>(r * std::sin(angle)));
    cloud.position.push_back(p);
    cloud.normal.push_back(p.normalized());
    cloud.color.emplace_back(((p.array() + 1) / 2));
    const auto area = static_cast<float>(4 * std::numbers::pi / static_cast<double>(count) *
                                         (1 + 0.3 * std::sin(angle)));
    cloud.area.push_back(area);
    if (elliptic) {
      cloud.tangent.push_back(Vec3f(0, 1, 0.3F).cross(cloud.normal.back()).normalized());
      cloud.variance_u.push_back(area);
      cloud.variance_v.push_back(area / 4);
    } else {
      cloud.variance.push_back(area / 2);
    }
  }
  return cloud;
}

}  // namespace surfel::test
