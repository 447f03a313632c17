#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace surfel::bench {

/// A point of the one-pixel z-buffer loop: 16 bytes.
struct ZPoint {
  float x, y, z;
  std::uint32_t color;
};

/// Pixel = scale * (row . (p, 1)) / depth + center, depth = row_z . (p, 1).
struct ZCamera {
  float row_x[4];
  float row_y[4];
  float row_z[4];
  float center_x, center_y;  ///< Pixels.
  int width, height;
};

/// The least that a renderer which touches every point once must do: transform, one depth test, one
/// store of depth and colour; a buffer a thread, merged at the end. `pixels` are inverse depth
/// << 32 | colour, 0 = empty. Compiled for this machine (-march=native).
class ZBufferLoop {
 public:
  ZBufferLoop(const ZCamera& camera, int threads);
  void run(const ZPoint* points, std::size_t count);
  const std::vector<std::uint64_t>& pixels() const { return buffers_.front(); }

 private:
  ZCamera camera_;
  std::vector<std::vector<std::uint64_t>> buffers_;
};

}  // namespace surfel::bench
