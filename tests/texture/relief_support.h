#pragma once

#include <cmath>
#include <cstdint>
#include <fstream>
#include <functional>
#include <string>

#include <surfel/base/types.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel::test {

/// Writes values 0..1 as a PPM image of 16 bits, or, with `grey`, the first of the values as PGM.
inline void write_relief(const std::string& path, int width, int height, bool grey,
                         const std::function<Vec3d(int, int)>& at) {
  std::ofstream out(path, std::ios::binary);
  out << (grey ? "P5" : "P6") << "\n" << width << " " << height << "\n65535\n";
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const Vec3d value = at(x, y);
      for (int c = 0; c < (grey ? 1 : 3); ++c) {
        const auto code = static_cast<std::uint16_t>(std::lround(65535 * value[c]));
        out.put(static_cast<char>(code >> 8)).put(static_cast<char>(code & 0xff));
      }
    }
  }
}

/// The value that stands for a normal.
inline Vec3d normal_code(const Vec3d& normal) { return (normal + Vec3d::Ones()) / 2; }

/// side x side surfels on a grid over the square [0, width] x [0, 1] in z = 0, which shows the
/// whole image once.
inline SurfelCloud relief_plane(int side, float sigma, float width = 1) {
  SurfelCloud cloud;
  for (int j = 0; j < side; ++j) {
    for (int i = 0; i < side; ++i) {
      const Vec2f uv((static_cast<float>(i) + 0.5F) / static_cast<float>(side),
                     (static_cast<float>(j) + 0.5F) / static_cast<float>(side));
      cloud.uv.push_back(uv);
      cloud.position.emplace_back(width * uv.x(), uv.y(), 0.0F);
    }
  }
  cloud.normal.assign(cloud.size(), Vec3f(0, 0, 1));
  cloud.dpdu.assign(cloud.size(), Vec3f(width, 0, 0));
  cloud.dpdv.assign(cloud.size(), Vec3f(0, 1, 0));
  cloud.variance.assign(cloud.size(), sigma * sigma);
  return cloud;
}

}  // namespace surfel::test
