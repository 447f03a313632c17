#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include <surfel/scene/camera.h>
#include <surfel/scene/gaussian_cloud.h>

namespace surfel::bench {

/// 3D Gaussian splatting as programs without a GPU do it: a loop over the Gaussians that projects
/// them, one sort of (tile, depth) keys, and for every tile of 16 x 16 pixels and every pixel a
/// loop over the tile's list. OpenMP over Gaussians and tiles; compiled with -O3 for AVX2, where
/// the compiler vectorises what it can.
class GaussianLoop {
 public:
  explicit GaussianLoop(const GaussianCloud& cloud) : cloud_(cloud) {}

  /// Red, green and blue of each pixel, as displays take them, over black.
  const std::vector<float>& render(const Camera& camera);

 private:
  struct Splat {
    float x, y, xx, xy, yy, opacity, red, green, blue, z;
    int x0, y0, x1, y1;  ///< Tiles, half open.
  };
  struct Pair {
    std::uint64_t key;
    std::uint32_t splat;
  };
  void project(const Camera& camera);
  void sort(int columns, int rows);

  const GaussianCloud& cloud_;
  std::vector<Splat> splats_;
  std::vector<Pair> pairs_, spare_;
  std::vector<std::size_t> first_;
  std::vector<float> picture_;
};

}  // namespace surfel::bench
