#include <algorithm>
#include <cmath>
#include <limits>

#include <surfel/render/edge_search.h>

namespace surfel {
namespace {

/// Finds the fragment of another pixel that continues a fragment: of the same side, nearest in
/// depth.
class Continuation {
 public:
  explicit Continuation(const Fragment& fragment)
      : depth_(front_depth(fragment)), front_(shows_front(fragment.channel[kTag])) {}

  void offer(float weight, float depth, bool front) {
    const float distance = std::abs(depth - depth_);
    if (front != front_ || !(distance < least_)) return;
    least_ = distance;
    weight_ = weight;
  }
  /// Its sum of rho; 0 if there is none.
  float weight() const { return weight_; }

 private:
  float depth_;
  bool front_;
  float least_ = std::numeric_limits<float>::infinity();
  float weight_ = 0;
};

float weight_of_neighbor(TileABuffer& tile, const Fragment& fragment, int pixel) {
  Continuation continuation(fragment);
  for (int layer = 0; layer < tile.layout.layers; ++layer) {
    const float weight = tile.at(layer, kWeight, pixel);
    if (weight == 0) break;
    if (weight < 0) continue;
    continuation.offer(weight, tile.at(layer, kDepth, pixel) / weight,
                       shows_front(tile.at(layer, kTag, pixel)));
  }
  return continuation.weight();
}

/// Calls visit(x, y, weight) for the pixels around (x, y), and their places in `around`.
template <class Visit>
void for_each_neighbor(int x, int y, EdgeNeighbors& around, const Visit& visit) {
  for (int step = -kEdgeReach; step <= kEdgeReach; ++step) {
    if (step == 0) continue;
    visit(x + step, y, around.weight[0][kEdgeReach + step]);
    visit(x, y + step, around.weight[1][kEdgeReach + step]);
  }
}

}  // namespace

bool EdgeNeighbors::known() const {
  return std::all_of(weight.begin(), weight.end(), [](const auto& line) {
    return std::find(line.begin(), line.end(), kUnknown) == line.end();
  });
}

bool may_be_at_edge(const TileABuffer& tile, const Fragment& fragment) {
  return !is_merged(fragment) && fragment.channel[kWeight] < tile.edge_weight &&
         is_filtered(fragment.channel[kTag]);
}

EdgeNeighbors look_around(TileABuffer& tile, const Fragment& fragment, int pixel) {
  EdgeNeighbors around;
  around.weight[0][kEdgeReach] = around.weight[1][kEdgeReach] = fragment.channel[kWeight];
  const auto look = [&](int x, int y, float& weight) {
    const int column = tile.x0 + x;
    const int row = tile.y0 + y;
    if (x >= 0 && x < tile.width && y >= 0 && y < tile.height) {
      weight = weight_of_neighbor(tile, fragment, tile_pixel(x, y));
    } else if (column < 0 || column >= tile.picture_width || row < 0 ||
               row >= tile.picture_height) {
      weight = EdgeNeighbors::kOutside;
    } else {
      weight = EdgeNeighbors::kUnknown;
    }
  };
  for_each_neighbor(tile_pixel_x(pixel), tile_pixel_y(pixel), around, look);
  return around;
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

void TileRims::begin(int tiles_x, int tiles_y, int first_row, int layers) {
  const std::size_t row = static_cast<std::size_t>(tiles_x) * layers * kRimPixels;
  // A row more, for the last one of the band before.
  Array<RimFragment> fragments;
  if (first_row > 0) {
    const RimFragment* const last = tile_rim(0, first_row - 1);
    fragments.assign(last, last + row);
  }
  tiles_x_ = tiles_x;
  tiles_y_ = tiles_y + 1;
  first_row_ = first_row - 1;
  layers_ = layers;
  fragments_.resize(row * tiles_y_);
  std::copy(fragments.begin(), fragments.end(), fragments_.begin());
}

int TileRims::rim_pixel(int x, int y) {
  constexpr int kFar = kTileSize - kEdgeReach;
  constexpr int kBetween = kTileSize - 2 * kEdgeReach;
  if (y < kEdgeReach) return y * kTileSize + x;
  if (y >= kFar) return (y - kBetween) * kTileSize + x;
  return 2 * kEdgeReach * kTileSize + (y - kEdgeReach) * 2 * kEdgeReach +
         (x < kEdgeReach ? x : x - kBetween);
}

TileRims::RimFragment* TileRims::tile_rim(int tile_x, int tile_y) {
  const std::size_t tile = static_cast<std::size_t>(tile_y - first_row_) * tiles_x_ + tile_x;
  return fragments_.data() + tile * layers_ * kRimPixels;
}

const TileRims::RimFragment* TileRims::tile_rim(int tile_x, int tile_y) const {
  return const_cast<TileRims*>(this)->tile_rim(tile_x, tile_y);
}

void TileRims::store(const TileABuffer& tile) {
  RimFragment* const rim = tile_rim(tile.x0 / kTileSize, tile.y0 / kTileSize);
  const auto store_pixel = [&](int x, int y) {
    const auto pixel = static_cast<std::size_t>(tile_pixel(x, y));
    RimFragment* to = rim + rim_pixel(x, y);
    RimFragment* const end = to + layers_ * kRimPixels;
    for (int layer = 0; layer < layers_; ++layer) {
      const float* fragment = tile.fragment(layer, pixel);
      const float weight = fragment[kWeight * kPatchPixels];
      if (weight == 0) break;
      if (weight < 0) continue;
      const bool front = shows_front(fragment[kTag * kPatchPixels]);
      *to = {front ? weight : -weight, fragment[kDepth * kPatchPixels] / weight};
      to += kRimPixels;
    }
    if (to < end) to->weight = 0;
  };
  for (int y = 0; y < kTileSize; ++y) {
    const bool whole = y < kEdgeReach || y >= kTileSize - kEdgeReach;
    for (int x = 0; x < kTileSize; ++x) {
      if (!whole && x == kEdgeReach) x = kTileSize - kEdgeReach;
      store_pixel(x, y);
    }
  }
}

void TileRims::complete(const Fragment& fragment, int x, int y, EdgeNeighbors& around) const {
  for_each_neighbor(x, y, around, [&](int column, int row, float& weight) {
    if (weight != EdgeNeighbors::kUnknown) return;
    const RimFragment* from = tile_rim(column / kTileSize, row / kTileSize) +
                              rim_pixel(column % kTileSize, row % kTileSize);
    Continuation continuation(fragment);
    for (int layer = 0; layer < layers_ && from->weight != 0; ++layer, from += kRimPixels) {
      continuation.offer(std::abs(from->weight), from->depth, from->weight > 0);
    }
    weight = continuation.weight();
  });
}

}  // namespace surfel
