#include <algorithm>

#include <surfel/scene/gaussian_cloud.h>

namespace surfel {

void GaussianCloud::resize(std::size_t size) {
  position.resize(size);
  scale.resize(size);
  rotation.resize(size);
  amplitude.resize(size);
  harmonics.resize(size * harmonics_stride());
}

void GaussianCloud::assign(std::size_t to, const GaussianCloud& other, std::size_t i) {
  position[to] = other.position[i];
  scale[to] = other.scale[i];
  rotation[to] = other.rotation[i];
  amplitude[to] = other.amplitude[i];
  const std::size_t stride = harmonics_stride();
  std::copy_n(other.harmonics.begin() + static_cast<std::ptrdiff_t>(i * stride), stride,
              harmonics.begin() + static_cast<std::ptrdiff_t>(to * stride));
}

GaussianCloud GaussianCloud::without_gaussians() const {
  GaussianCloud out;
  out.origin = origin;
  out.degree = degree;
  out.rule = rule;
  out.trained_with = trained_with;
  out.up = up;
  return out;
}

}  // namespace surfel
