#pragma once

#include <Eigen/LU>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <random>
#include <utility>

#include <surfel/scene/image.h>
#include <surfel/scene/triangle_mesh.h>
#include <surfel/texture/texture_fit.h>
#include <surfel/texture/texture_map.h>

namespace surfel::test {

inline Image make_image(int width, int height, const std::function<Eigen::Vector4f(int, int)>& at) {
  Image image;
  image.width = width;
  image.height = height;
  image.channels = {"R", "G", "B", "A"};
  image.data.resize(static_cast<std::size_t>(width) * height * 4);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) Eigen::Map<Eigen::Vector4f>(image.pixel(x, y)) = at(x, y);
  }
  return image;
}

inline TextureSet one_map(Image image, WrapMode wrap = WrapMode::kRepeat) {
  TextureSet textures;
  textures.maps.emplace_back(std::move(image), wrap);
  return textures;
}

/// Two squares side by side, left and right half of the image, as charts of their own: they share
/// no vertex.
inline TriangleMesh two_charts() {
  TriangleMesh mesh;
  for (const float x : {0.0F, 0.5F}) {
    const auto v = static_cast<std::uint32_t>(mesh.position.size());
    const std::array<Vec2f, 4> corner{Vec2f(x, 0), Vec2f(x + 0.5F, 0), Vec2f(x + 0.5F, 1),
                                      Vec2f(x, 1)};
    for (const Vec2f& p : corner) mesh.position.emplace_back(p.x(), p.y(), 0.0F);
    mesh.face.push_back({v, v + 1, v + 2});
    mesh.face.push_back({v, v + 2, v + 3});
    mesh.wedge_uv.push_back({corner[0], corner[1], corner[2]});
    mesh.wedge_uv.push_back({corner[0], corner[2], corner[3]});
  }
  return mesh;
}

/// Independent values in [0, 1] per texel and channel: as hard to filter as an image can be.
inline Image noise_image(int width, int height, unsigned seed, bool alpha = false) {
  std::mt19937 generator(seed);
  std::uniform_real_distribution<float> uniform(0, 1);
  return make_image(width, height, [&](int, int) {
    Eigen::Vector4f texel;
    for (int c = 0; c < 4; ++c) texel[c] = uniform(generator);
    if (!alpha) texel[3] = 1;
    return texel;
  });
}

/// Index of the texel that stands at i, worked out by walking: independent of the library.
inline int walk(int i, int count, WrapMode wrap) {
  if (wrap == WrapMode::kClamp) return std::min(std::max(i, 0), count - 1);
  bool mirrored = false;
  while (i < 0) {
    i += count;
    mirrored = !mirrored;
  }
  while (i >= count) {
    i -= count;
    mirrored = !mirrored;
  }
  return wrap == WrapMode::kMirror && mirrored ? count - 1 - i : i;
}

/// Plain double sum of the definition over all texels within 6.5 standard deviations of the
/// kernel, with alpha as weight.
inline TextureSample brute_force(const Image& image, WrapMode wrap, const TexelKernel& kernel) {
  const Mat2d conic = kernel.variance.inverse();
  const double reach_x = 6.5 * std::sqrt(kernel.variance(0, 0));
  const double reach_y = 6.5 * std::sqrt(kernel.variance(1, 1));
  Vec3d color = Vec3d::Zero();
  double alpha = 0;
  double weight = 0;
  for (int y = static_cast<int>(std::floor(kernel.center.y() - reach_y));
       y <= std::ceil(kernel.center.y() + reach_y); ++y) {
    for (int x = static_cast<int>(std::floor(kernel.center.x() - reach_x));
         x <= std::ceil(kernel.center.x() + reach_x); ++x) {
      const Vec2d d = Vec2d(x + 0.5, y + 0.5) - kernel.center;
      const double g = std::exp(-d.dot(conic * d) / 2);
      const float* texel = image.pixel(walk(x, image.width, wrap), walk(y, image.height, wrap));
      for (int c = 0; c < 3; ++c) color[c] += g * texel[3] * texel[c];
      alpha += g * texel[3];
      weight += g;
    }
  }
  return {(color / alpha).cast<float>(), static_cast<float>(alpha / weight)};
}

inline double difference(const TextureSample& a, const TextureSample& b) {
  return std::max<double>((a.color - b.color).cwiseAbs().maxCoeff(), std::abs(a.alpha - b.alpha));
}

/// Kernel with these standard deviations along axes turned by `angle`.
inline TexelKernel turned_kernel(const Vec2d& center, double sigma_1, double sigma_2,
                                 double angle) {
  Mat2d rotation;
  rotation << std::cos(angle), -std::sin(angle), std::sin(angle), std::cos(angle);
  return {center, rotation * Vec2d(sigma_1 * sigma_1, sigma_2 * sigma_2).asDiagonal() *
                      rotation.transpose()};
}

}  // namespace surfel::test
