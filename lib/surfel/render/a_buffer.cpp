#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>

#include <surfel/render/a_buffer.h>
#include <surfel/render/shading.h>

namespace surfel {
namespace {

Fragment load(TileABuffer& tile, int layer, int pixel) {
  Fragment fragment{};
  for (int c = 0; c < tile.layout.channels(); ++c) fragment.channel[c] = tile.at(layer, c, pixel);
  if (tile.layout.opaque && fragment.channel[kWeight] > 0) {
    fragment.channel[kAlpha] = fragment.channel[kWeight];
  }
  return fragment;
}

bool is_merged(const Fragment& fragment) { return fragment.channel[kWeight] < 0; }

float front_depth(const Fragment& fragment) {
  return is_merged(fragment) ? fragment.channel[kDepth]
                             : fragment.channel[kDepth] / fragment.channel[kWeight];
}

float back_depth(const Fragment& fragment) {
  return is_merged(fragment) ? fragment.channel[kBack] : front_depth(fragment);
}

Rgba color_of(const TileABuffer& tile, const Fragment& fragment, int pixel) {
  const float* c = fragment.channel;
  if (is_merged(fragment)) return {c[kRed], c[kGreen], c[kBlue], c[kAlpha]};
  return tile.shader->shade(fragment, static_cast<float>(tile.x0 + tile_pixel_x(pixel)) + 0.5F,
                            static_cast<float>(tile.y0 + tile_pixel_y(pixel)) + 0.5F,
                            tile.full_weight);
}

/// SS01 (12).
Fragment merged(const TileABuffer& tile, const Fragment& front, const Fragment& back, int pixel) {
  Rgba color = color_of(tile, front, pixel);
  color.composite(color_of(tile, back, pixel));
  Fragment out{};
  out.channel[kWeight] = kMergedWeight;
  out.channel[kDepth] = front_depth(front);
  out.channel[kRed] = color.red;
  out.channel[kGreen] = color.green;
  out.channel[kBlue] = color.blue;
  out.channel[kAlpha] = color.alpha;
  out.channel[kBack] = back_depth(back);
  return out;
}

Fragment contribution(float rho, float depth, const Splat& splat, const SplatNormal* normal) {
  Fragment out{};
  float* c = out.channel;
  c[kWeight] = rho;
  c[kDepth] = rho * depth;
  c[kRed] = rho * splat.red;
  c[kGreen] = rho * splat.green;
  c[kBlue] = rho * splat.blue;
  c[kAlpha] = rho * splat.alpha;
  c[kTag] = std::bit_cast<float>(splat.tag);
  if (normal) {
    c[kNormalX] = rho * normal->x;
    c[kNormalY] = rho * normal->y;
    c[kNormalZ] = rho * normal->z;
  }
  return out;
}

/// Layers of a pixel in use, nearest first.
struct Sorted {
  static constexpr int kMost = 64;
  std::array<Fragment, kMost> fragment;
  std::array<int, kMost> order;
  int count = 0;

  Sorted(TileABuffer& tile, int pixel) {
    std::array<float, kMost> depth;
    for (int layer = 0; layer < tile.layout.layers; ++layer) {
      if (tile.at(layer, kWeight, pixel) == 0) break;
      fragment[layer] = load(tile, layer, pixel);
      depth[layer] = front_depth(fragment[layer]);
      int place = count++;
      for (; place > 0 && depth[order[place - 1]] < depth[layer]; --place) {
        order[place] = order[place - 1];
      }
      order[place] = layer;
    }
  }
  const Fragment& operator[](int i) const { return fragment[order[i]]; }
};

void store(TileABuffer& tile, int layer, int pixel, const Fragment& fragment) {
  for (int c = 0; c < tile.layout.channels(); ++c) tile.at(layer, c, pixel) = fragment.channel[c];
}

}  // namespace

void insert_by_merging(TileABuffer& tile, int pixel, float rho, float depth, const Splat& splat,
                       const SplatNormal* normal) {
  const Fragment fresh = contribution(rho, depth, splat, normal);
  const Sorted sorted(tile, pixel);
  int in_front = 0;  // How many fragments are nearer than the newcomer.
  while (in_front < sorted.count && front_depth(sorted[in_front]) >= depth) ++in_front;
  if (sorted.count == 1) {
    if (in_front == 0) store(tile, 0, pixel, fresh);
    return;
  }
  ++tile.merges.merged;
  // The pair to merge, and the layer that it leaves free. Nothing may lie between the two.
  if (in_front == 1 && sorted.count == 2) {
    // One on either side: the newcomer itself joins the one behind.
    store(tile, sorted.order[1], pixel, merged(tile, fresh, sorted[1], pixel));
    return;
  }
  const int front = in_front >= 2 ? 0 : sorted.count - 2;
  store(tile, sorted.order[front], pixel, merged(tile, sorted[front], sorted[front + 1], pixel));
  store(tile, sorted.order[front + 1], pixel, fresh);
}

PixelResult resolve_pixel(TileABuffer& tile, int pixel) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  PixelResult result;
  result.depth = kInfinity;
  result.depth_first = kInfinity;
  const Sorted sorted(tile, pixel);
  for (int i = 0; i < sorted.count; ++i) {
    const Fragment& fragment = sorted[i];
    result.color.composite(color_of(tile, fragment, pixel));
    const float z = tile.shader->z(front_depth(fragment));
    if (i == 0) {
      result.depth_first = z;
      if (!is_merged(fragment)) {
        result.weight = fragment.channel[kWeight];
        if (tile.layout.normals) {
          const Vec3f n = Vec3f(fragment.channel[kNormalX], fragment.channel[kNormalY],
                                fragment.channel[kNormalZ])
                              .normalized();
          std::copy_n(n.data(), 3, result.normal);
        }
      }
    }
    if (result.depth == kInfinity && result.color.alpha >= 0.5F) result.depth = z;
    if (!is_merged(fragment)) tile.merges.total_weight += fragment.channel[kWeight];
  }
  return result;
}

}  // namespace surfel
