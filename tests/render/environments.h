#pragma once

#include <memory>

#include <surfel/base/types.h>
#include <surfel/render/environment_map.h>
#include <surfel/scene/image.h>
#include <surfel/scene/lat_long.h>
#include <surfel/scene/scene.h>

namespace surfel::test {

/// Lat-long picture of a function of the direction.
template <class Radiance>
Image lat_long_image(int height, Radiance&& radiance) {
  Image image;
  image.width = 2 * height;
  image.height = height;
  image.channels = {"R", "G", "B", "A"};
  image.data.assign(static_cast<std::size_t>(8) * height * height, 1.0F);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const Vec3d d = lat_long_direction((x + 0.5) / image.width, (y + 0.5) / height);
      Eigen::Map<Vec3f>{image.pixel(x, y)} = radiance(d);
    }
  }
  return image;
}

inline Vec3f direction_color(const Vec3d& d) { return (0.5 * (d + Vec3d::Ones())).cast<float>(); }

/// An environment whose colour tells the direction: (d + 1) / 2.
inline Environment direction_environment(int height = 256) {
  Environment environment;
  environment.image = "directions";
  environment.map = std::make_shared<const EnvironmentMap>(lat_long_image(height, direction_color),
                                                           environment.image);
  return environment;
}

/// The same radiance from everywhere.
inline Environment uniform_environment(const Vec3f& radiance) {
  Environment environment;
  environment.image = "uniform";
  environment.map = std::make_shared<const EnvironmentMap>(
      lat_long_image(8, [&](const Vec3d&) { return radiance; }), environment.image);
  return environment;
}

}  // namespace surfel::test
