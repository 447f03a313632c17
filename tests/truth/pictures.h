#pragma once

#include <cmath>

#include <surfel/scene/camera.h>
#include <surfel/scene/framing.h>
#include <surfel/scene/image.h>

namespace surfel::test {

/// Looks along -z at a square of this height about the origin.
inline Camera orthographic_camera(double height, int size) {
  CameraOptions options;
  options.eye = Vec3d(0, 0, 5);
  options.target = Vec3d(0, 0, 0);
  options.ortho = height;
  options.width = options.height = size;
  return make_camera(options, SceneExtent{});
}

/// dB, of the first four channels.
inline double psnr(const Image& a, const Image& b) {
  double sum = 0;
  const auto pixels = static_cast<std::size_t>(a.width) * static_cast<std::size_t>(a.height);
  for (std::size_t i = 0; i < pixels; ++i) {
    for (std::size_t c = 0; c < 4; ++c) {
      const double difference = static_cast<double>(a.data[i * a.channels.size() + c]) -
                                b.data[i * b.channels.size() + c];
      sum += difference * difference;
    }
  }
  return -10 * std::log10(sum / (4 * static_cast<double>(pixels)));
}

}  // namespace surfel::test
