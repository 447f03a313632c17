#include <algorithm>
#include <bit>
#include <limits>
#include <span>

#include <surfel/render/shading.h>
#include <surfel/sp06/layer_parts.h>

namespace surfel {

void HiddenLayers::set(const TileABuffer& tile, const NearestLayer* masked) {
  constexpr float kNoSide = 2;
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  planes.resize(std::size_t{2} * kTilePixels);
  for (int pixel = 0; pixel < kTilePixels; ++pixel) {
    const bool inside = tile_pixel_x(pixel) < tile.width && tile_pixel_y(pixel) < tile.height;
    const bool by_mask = inside && masked;
    planes[pixel] = by_mask ? masked[pixel].depth : (inside ? kInfinity : -kInfinity);
    planes[kTilePixels + pixel] = by_mask ? static_cast<float>(masked[pixel].front) : kNoSide;
  }
}

void ShadedSplats::reserve(const TileJob& job) {
  if (job.count == 0) return;
  const std::size_t splats = *std::max_element(job.order, job.order + job.count) + std::size_t{1};
  if (colors.size() >= splats) return;
  colors.resize(2 * splats);
  loads.resize(2 * splats, 0);
}

Fragment layer_fragment(const TileJob& job, std::uint32_t index, float depth) {
  const Splat& splat = job.splats[index];
  Fragment out{};
  float* c = out.channel;
  c[kWeight] = 1;
  c[kDepth] = depth;
  c[kRed] = splat.red;
  c[kGreen] = splat.green;
  c[kBlue] = splat.blue;
  c[kAlpha] = splat.alpha;
  c[kTag] = std::bit_cast<float>(splat.tag);
  c[kNormalX] = job.normals[index].x;
  c[kNormalY] = job.normals[index].y;
  c[kNormalZ] = job.normals[index].z;
  return out;
}

float nearest_weight(float key) {
  // It is not 0 at the rim, so that a pixel without other fragments has a normal.
  constexpr float kAtRim = 1e-3F;
  const float inside = std::max(0.0F, 1 - key * key);
  return std::max(kAtRim, inside * inside);
}

void merge_groups(const TileGroups& groups, const TileABuffer& tile, PictureLayers& picture,
                  std::vector<Fragment>& merged) {
  for (int pixel = 0; pixel < kTilePixels; ++pixel) {
    const int x = tile_pixel_x(pixel);
    const int y = tile_pixel_y(pixel);
    if (x >= tile.width || y >= tile.height) continue;
    const std::uint32_t begin = groups.begin[pixel];
    const auto here = std::span(groups.groups).subspan(begin, groups.begin[pixel + 1] - begin);
    if (picture.at_border(tile.x0 + x, tile.y0 + y)) {
      picture.keep(tile.x0 + x, tile.y0 + y, here);
    } else {
      merged[pixel] = picture.merged(*tile.shader, tile.x0 + x, tile.y0 + y, here);
    }
  }
}

}  // namespace surfel
