#include <algorithm>
#include <cmath>

#include <surfel/scene/volume.h>

namespace surfel {

double value_at(const Volume& volume, const Vec3d& voxel) {
  std::array<std::size_t, 3> first;
  std::array<std::size_t, 3> next;
  std::array<double, 3> t;
  for (std::size_t k = 0; k < 3; ++k) {
    const double last = static_cast<double>(volume.size[k] - 1);
    const double at = std::clamp(voxel[static_cast<int>(k)], 0.0, last);
    const double floor = std::min(std::floor(at), std::max(0.0, last - 1));
    first[k] = static_cast<std::size_t>(floor);
    next[k] = std::min(first[k] + 1, volume.size[k] - 1);
    t[k] = at - floor;
  }
  const auto along_x = [&](std::size_t y, std::size_t z) {
    const double a = volume.value[volume.index(first[0], y, z)];
    const double b = volume.value[volume.index(next[0], y, z)];
    return a + t[0] * (b - a);
  };
  const auto along_y = [&](std::size_t z) {
    const double a = along_x(first[1], z);
    return a + t[1] * (along_x(next[1], z) - a);
  };
  const double a = along_y(first[2]);
  return a + t[2] * (along_y(next[2]) - a);
}

Vec3d gradient_at(const Volume& volume, const Vec3d& voxel) {
  Vec3d gradient(0, 0, 0);
  for (int k = 0; k < 3; ++k) {
    const Vec3d& step = volume.step[static_cast<std::size_t>(k)];
    const Vec3d ahead = voxel + Vec3d::Unit(k);
    const Vec3d behind = voxel - Vec3d::Unit(k);
    const double difference = (value_at(volume, ahead) - value_at(volume, behind)) / 2;
    gradient += step * (difference / step.squaredNorm());
  }
  return gradient;
}

std::array<double, 2> value_quantiles(const Volume& volume, const std::array<double, 2>& share) {
  Array<float> sorted = volume.value;
  std::array<double, 2> result;
  for (std::size_t k = 0; k < 2; ++k) {
    const auto at = static_cast<std::ptrdiff_t>(share[k] * static_cast<double>(sorted.size() - 1));
    std::nth_element(sorted.begin(), sorted.begin() + at, sorted.end());
    result[k] = sorted[static_cast<std::size_t>(at)];
  }
  return result;
}

}  // namespace surfel
