#include "bench/gaussian_loop.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

namespace surfel::bench {
namespace {

constexpr int kTile = 16;

void add_harmonics(int degree, const Vec3f& d, const float* sh, float* color) {
  const float x = d.x();
  const float y = d.y();
  const float z = d.z();
  const float xx = x * x;
  const float yy = y * y;
  const float zz = z * z;
  const std::array<float, 16> basis{0.28209479F,
                                    -0.48860251F * y,
                                    0.48860251F * z,
                                    -0.48860251F * x,
                                    1.09254843F * x * y,
                                    -1.09254843F * y * z,
                                    0.31539157F * (2 * zz - xx - yy),
                                    -1.09254843F * x * z,
                                    0.54627422F * (xx - yy),
                                    -0.59004359F * y * (3 * xx - yy),
                                    2.89061144F * x * y * z,
                                    -0.45704580F * y * (4 * zz - xx - yy),
                                    0.37317633F * z * (2 * zz - 3 * xx - 3 * yy),
                                    -0.45704580F * x * (4 * zz - xx - yy),
                                    1.44530572F * z * (xx - yy),
                                    -0.59004359F * x * (xx - 3 * yy)};
  const int count = (degree + 1) * (degree + 1);
  for (int c = 0; c < 3; ++c) color[c] = 0.5F;
  for (int k = 0; k < count; ++k) {
    for (int c = 0; c < 3; ++c) color[c] += basis[static_cast<std::size_t>(k)] * sh[3 * k + c];
  }
  for (int c = 0; c < 3; ++c) color[c] = std::max(color[c], 0.0F);
}

}  // namespace

void GaussianLoop::project(const Camera& camera) {
  const int columns = (camera.width + kTile - 1) / kTile;
  const int rows = (camera.height + kTile - 1) / kTile;
  const Eigen::Matrix3f W = camera.camera_from_world.cast<float>();
  const Vec3f eye = (camera.eye - cloud_.origin).cast<float>();
  const auto fx = static_cast<float>(camera.focal_x);
  const auto fy = static_cast<float>(camera.focal_y);
  const float limit_x = 1.3F * static_cast<float>(camera.width) / (2 * fx);
  const float limit_y = 1.3F * static_cast<float>(camera.height) / (2 * fy);
  splats_.resize(cloud_.size());
#pragma omp parallel for schedule(dynamic, 1024)
  for (std::size_t i = 0; i < cloud_.size(); ++i) {
    Splat& s = splats_[i];
    s.x1 = s.x0 = 0;
    const Vec3f p = W * (cloud_.position[i] - eye);
    if (p.z() <= 0.2F) continue;
    const auto& q = cloud_.rotation[i];
    const Eigen::Matrix3f M = W * Eigen::Quaternionf(q[0], q[1], q[2], q[3]).toRotationMatrix() *
                              cloud_.scale[i].asDiagonal();
    const float u = std::clamp(p.x() / p.z(), -limit_x, limit_x);
    const float v = std::clamp(p.y() / p.z(), -limit_y, limit_y);
    const Vec3f tx = fx / p.z() * (M.row(0) - u * M.row(2)).transpose();
    const Vec3f ty = fy / p.z() * (M.row(1) - v * M.row(2)).transpose();
    const float a = tx.dot(tx) + 0.3F;
    const float b = tx.dot(ty);
    const float c = ty.dot(ty) + 0.3F;
    const float det = a * c - b * b;
    s.xx = c / det;
    s.xy = -b / det;
    s.yy = a / det;
    const float mid = 0.5F * (a + c);
    const float radius = std::ceil(3 * std::sqrt(mid + std::sqrt(std::max(0.1F, mid * mid - det))));
    s.x = fx * p.x() / p.z() + static_cast<float>(camera.center_x) - 0.5F;
    s.y = fy * p.y() / p.z() + static_cast<float>(camera.center_y) - 0.5F;
    const auto tile = [](float at, int most) {
      return std::clamp(static_cast<int>(std::clamp(at, -1e6F, 1e6F) / kTile), 0, most);
    };
    s.x0 = tile(s.x - radius, columns);
    s.y0 = tile(s.y - radius, rows);
    s.x1 = tile(s.x + radius + kTile - 1, columns);
    s.y1 = tile(s.y + radius + kTile - 1, rows);
    if (s.x0 >= s.x1 || s.y0 >= s.y1) {
      s.x1 = s.x0;
      continue;
    }
    s.z = p.z();
    s.opacity = cloud_.amplitude[i];
    add_harmonics(std::min(cloud_.degree, 3), (cloud_.position[i] - eye).normalized(),
                  &cloud_.harmonics[i * cloud_.harmonics_stride()], &s.red);
  }
}

void GaussianLoop::sort(int columns, int rows) {
  pairs_.clear();
  for (std::size_t i = 0; i < splats_.size(); ++i) {
    const Splat& s = splats_[i];
    if (s.x0 >= s.x1) continue;
    std::uint32_t depth = 0;
    std::memcpy(&depth, &s.z, sizeof(depth));
    for (int y = s.y0; y < s.y1; ++y) {
      for (int x = s.x0; x < s.x1; ++x) {
        pairs_.push_back({static_cast<std::uint64_t>(y * columns + x) << 32 | depth,
                          static_cast<std::uint32_t>(i)});
      }
    }
  }
  // A radix sort, as renderers on GPUs do.
  spare_.resize(pairs_.size());
  for (int shift = 0; shift < 48; shift += 12) {
    std::vector<std::size_t> next(4097, 0);
    for (const Pair& p : pairs_) ++next[(p.key >> shift & 4095) + 1];
    for (std::size_t k = 1; k < next.size(); ++k) next[k] += next[k - 1];
    for (const Pair& p : pairs_) spare_[next[p.key >> shift & 4095]++] = p;
    pairs_.swap(spare_);
  }
  first_.assign(static_cast<std::size_t>(columns * rows) + 1, 0);
  for (const Pair& p : pairs_) ++first_[(p.key >> 32) + 1];
  for (std::size_t t = 1; t < first_.size(); ++t) first_[t] += first_[t - 1];
}

const std::vector<float>& GaussianLoop::render(const Camera& camera) {
  const int columns = (camera.width + kTile - 1) / kTile;
  const int rows = (camera.height + kTile - 1) / kTile;
  project(camera);
  sort(columns, rows);
  picture_.resize(3 * static_cast<std::size_t>(camera.width) *
                  static_cast<std::size_t>(camera.height));
#pragma omp parallel for schedule(dynamic, 4)
  for (int tile = 0; tile < columns * rows; ++tile) {
    const auto t = static_cast<std::size_t>(tile);
    const int x_end = std::min(tile % columns * kTile + kTile, camera.width);
    const int y_end = std::min(tile / columns * kTile + kTile, camera.height);
    for (int y = tile / columns * kTile; y < y_end; ++y) {
      for (int x = tile % columns * kTile; x < x_end; ++x) {
        float color[3] = {0, 0, 0};
        float transmittance = 1;
        for (std::size_t k = first_[t]; k < first_[t + 1]; ++k) {
          const Splat& s = splats_[pairs_[k].splat];
          const float dx = s.x - static_cast<float>(x);
          const float dy = s.y - static_cast<float>(y);
          const float power = -0.5F * (s.xx * dx * dx + s.yy * dy * dy) - s.xy * dx * dy;
          if (power > 0) continue;
          const float alpha = std::min(0.99F, s.opacity * std::exp(power));
          if (alpha < 1.0F / 255) continue;
          const float next = transmittance * (1 - alpha);
          if (next < 1e-4F) break;
          const float weight = alpha * transmittance;
          color[0] += weight * s.red;
          color[1] += weight * s.green;
          color[2] += weight * s.blue;
          transmittance = next;
        }
        std::copy_n(color, 3, &picture_[3 * (static_cast<std::size_t>(y) * camera.width + x)]);
      }
    }
  }
  return picture_;
}

}  // namespace surfel::bench
