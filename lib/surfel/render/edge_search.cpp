#include <algorithm>
#include <cmath>
#include <limits>

#include <surfel/render/edge_search.h>

namespace surfel {
namespace {

/// Fragments of a pixel: pointers to the first one's channels.
struct PixelLayers {
  const float *weight, *depth, *tag;
  std::size_t stride;  ///< From one fragment to the next.
  int count;           ///< Most fragments; the first one of weight 0 ends them, too.
};

/// The sum of rho of the fragment that continues a fragment in another pixel, of the same side and
/// nearest in depth; 0 if there is none.
float continued_weight(const PixelLayers& layers, const Fragment& fragment) {
  const float depth = front_depth(fragment);
  const bool front = shows_front(fragment.channel[kTag]);
  float least = std::numeric_limits<float>::infinity();
  float found = 0;
  for (std::size_t i = 0; i < layers.count * layers.stride; i += layers.stride) {
    const float weight = layers.weight[i];
    if (weight == 0) break;
    if (weight < 0 || shows_front(layers.tag[i]) != front) continue;
    const float distance = std::abs(layers.depth[i] / weight - depth);
    if (distance >= least) continue;
    least = distance;
    found = weight;
  }
  return found;
}

/// The sums around a fragment of pixel (x, y).
/// \param layers_at  The PixelLayers of a pixel of the picture.
template <class LayersAt>
EdgeNeighbors sums_around(const Fragment& fragment, int x, int y, int picture_width,
                          int picture_height, const LayersAt& layers_at) {
  EdgeNeighbors around;
  const auto look = [&](int column, int row) {
    if (column < 0 || column >= picture_width || row < 0 || row >= picture_height) {
      return EdgeNeighbors::kOutside;
    }
    return continued_weight(layers_at(column, row), fragment);
  };
  around.weight[0][kEdgeReach] = around.weight[1][kEdgeReach] = fragment.channel[kWeight];
  for (int step = -kEdgeReach; step <= kEdgeReach; ++step) {
    if (step == 0) continue;
    around.weight[0][kEdgeReach + step] = look(x + step, y);
    around.weight[1][kEdgeReach + step] = look(x, y + step);
  }
  return around;
}

}  // namespace

bool may_be_at_edge(const TileABuffer& tile, const Fragment& fragment) {
  return !is_merged(fragment) && fragment.channel[kWeight] < tile.edge_weight &&
         is_filtered(fragment.channel[kTag]);
}

bool sees_other_tiles(const TileABuffer& tile, int pixel) {
  const TileRims::Sides inner{.left = tile.x0 > 0,
                              .right = tile.x0 + kTileSize<tile.picture_width, .top = tile.y0> 0,
                              .bottom = tile.y0 + kTileSize < tile.picture_height};
  return inner.near(tile_pixel_x(pixel), tile_pixel_y(pixel));
}

EdgeNeighbors look_around(const TileABuffer& tile, const Fragment& fragment, int pixel) {
  const auto layers_at = [&](int x, int y) {
    const float* first =
        tile.fragment(0, static_cast<std::size_t>(tile_pixel(x - tile.x0, y - tile.y0)));
    return PixelLayers{first + kWeight * kPatchPixels, first + kDepth * kPatchPixels,
                       first + kTag * kPatchPixels, tile.layout.layer_stride(), tile.layout.layers};
  };
  return sums_around(fragment, tile.x0 + tile_pixel_x(pixel), tile.y0 + tile_pixel_y(pixel),
                     tile.picture_width, tile.picture_height, layers_at);
}

float edge_of(const TileABuffer& tile, const Fragment& fragment, const EdgeNeighbors& around) {
  // The sums beyond an edge, by tau: 1 where they are less than the first, 0 where they are more
  // than kInsideShare. Inside a surface they are above it, where its discs just close, too.
  constexpr float kBeyondEdge = 1.0F / 6;
  // Where both sides have more than this many times the sum, there is a gap, not an edge.
  constexpr float kGap = 1.2F;
  const float weight = fragment.channel[kWeight];
  float least = weight;
  for (const auto& [left2, left, middle, right, right2] : around.weight) {
    if (std::min(std::max(left, left2), std::max(right, right2)) > kGap * weight) return 0;
    const auto end = [&](float far, float near, float before, float before2) {
      if (far >= 0) return far;
      if (near >= 0) return before > near ? near * near / before : near;
      return before2 > weight ? weight * weight / before2 : weight;
    };
    least = std::min({least, end(left2, left, right, right2), end(right2, right, left, left2)});
  }
  return std::clamp((kInsideShare - least / tile.full_weight) / (kInsideShare - kBeyondEdge), 0.0F,
                    1.0F);
}

void TileRims::begin(const Camera& camera, const Band& band, int layers) {
  const auto tiles = static_cast<std::size_t>(band.tiles_x);
  // A row more, for the last one of the band before.
  const int row_before = band.y0 / kTileSize - 1;
  if (row_before < 0) {
    const std::size_t all = tiles * (band.tiles_y + 1);
    layer_stride_ = all * kPatches;
    patches_.resize(layer_stride_ * layers);
    used_.resize(layer_stride_);
    inside_.resize(all);
  } else {
    const std::size_t from = tiles * (row_before - first_row_);
    for (int layer = 0; layer < layers; ++layer) {
      Patch* const first = patches_.data() + layer * layer_stride_;
      std::copy_n(first + from * kPatches, tiles * kPatches, first);
    }
    std::copy_n(used_.begin() + from * kPatches, tiles * kPatches, used_.begin());
    std::copy_n(inside_.begin() + from, tiles, inside_.begin());
  }
  width_ = camera.width;
  height_ = camera.height;
  tiles_x_ = band.tiles_x;
  first_row_ = row_before;
}

TileRims::Place TileRims::place_of(int x, int y) const {
  constexpr int kNone = kPatches;
  constexpr std::array<std::uint8_t, kTilePixels / kPatchPixels> kPlaces{
      0, 1, 2, 3, 4, kNone, kNone, 5, 6, kNone, kNone, 7, 8, 9, 10, 11};
  const int pixel = tile_pixel(x % kTileSize, y % kTileSize);
  return {tile_of(x / kTileSize, y / kTileSize) * kPatches + kPlaces[pixel / kPatchPixels],
          static_cast<std::size_t>(pixel % kPatchPixels)};
}

void TileRims::store(const TileABuffer& tile, TileInside inside) {
  constexpr int kFar = kTileSize - kStripWidth;
  inside_[tile_of(tile.x0 / kTileSize, tile.y0 / kTileSize)] = inside;
  for (int x = 0; x < kTileSize; x += kStripWidth) {
    for (int y = 0; y < kTileSize; y += x == 0 || x == kFar ? kStripWidth : kFar) {
      const std::size_t patch = place_of(tile.x0 + x, tile.y0 + y).patch;
      const float* from = tile.fragment(0, static_cast<std::size_t>(tile_pixel(x, y)));
      int layer = 0;
      for (; layer < tile.layout.layers; ++layer, from += tile.layout.layer_stride()) {
        if (std::all_of(from, from + kPatchPixels, [](float weight) { return weight == 0; })) break;
        Patch& to = patches_[layer * layer_stride_ + patch];
        std::copy_n(from + kWeight * kPatchPixels, kPatchPixels, to.weight.begin());
        std::copy_n(from + kDepth * kPatchPixels, kPatchPixels, to.depth.begin());
        std::copy_n(from + kTag * kPatchPixels, kPatchPixels, to.tag.begin());
      }
      used_[patch] = static_cast<std::uint8_t>(layer);
    }
  }
}

EdgeNeighbors TileRims::look_around(const Fragment& fragment, int x, int y) const {
  return sums_around(fragment, x, y, width_, height_, [&](int column, int row) {
    const auto [patch, pixel] = place_of(column, row);
    const Patch& first = patches_[patch];
    return PixelLayers{&first.weight[pixel], &first.depth[pixel], &first.tag[pixel],
                       layer_stride_ * (sizeof(Patch) / sizeof(float)), used_[patch]};
  });
}

TileRims::Sides TileRims::open_sides(int tile_x, int tile_y) const {
  const TileInside inside = inside_[tile_of(tile_x, tile_y)];
  if (inside == TileInside::kNo) return {};
  const auto open = [&](int x, int y) {
    return x < 0 || x >= tiles_along(width_) || y < 0 || y >= tiles_along(height_) ||
           inside_[tile_of(x, y)] != inside;
  };
  return {.left = open(tile_x - 1, tile_y),
          .right = open(tile_x + 1, tile_y),
          .top = open(tile_x, tile_y - 1),
          .bottom = open(tile_x, tile_y + 1)};
}

float TileRims::coverage_change(const TileABuffer& weights, int x, int y) const {
  const auto [patch, pixel] = place_of(x, y);
  Fragment fragment{};
  fragment.channel[kWeight] = patches_[patch].weight[pixel];
  fragment.channel[kDepth] = patches_[patch].depth[pixel];
  fragment.channel[kTag] = patches_[patch].tag[pixel];
  if (!may_be_at_edge(weights, fragment)) return 1;
  const float edge = edge_of(weights, fragment, look_around(fragment, x, y));
  return weights.coverage(fragment, edge) / weights.coverage(fragment, 0);
}

}  // namespace surfel
