#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
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

  void offer(float weight, float depth, bool front, int /*step*/) {
    // A surface's last kernels hide nothing.
    constexpr float kLittle = 0.05F;
    const bool hides = weight >= kLittle;
    if (hides) nearest_ = std::max(nearest_, depth);
    if (hides && front) nearest_front_ = std::max(nearest_front_, depth);
    if (front != front_) return;
    const float distance = std::abs(depth - depth_);
    if (!(distance < least_)) return;
    least_ = distance;
    weight_ = weight;
    found_ = depth;
  }
  /// \param depth  of the nearest one.
  void offer_merged(float depth) { nearest_ = std::max(nearest_, depth); }
  /// Its sum of rho; 0 if there is none.
  float weight() const { return weight_; }
  /// Its sum of rho; 0 if there is none, or if something is nearer.
  float leading() const { return weight_ > 0 && found_ >= nearest_ ? weight_ : 0; }
  /// Depth of the nearest front-facing fragment.
  float nearest_front() const { return nearest_front_; }

 private:
  float depth_;
  bool front_;
  float least_ = std::numeric_limits<float>::infinity();
  float weight_ = 0;
  float found_ = 0;  ///< Its depth.
  /// The nearest depth of all fragments of the pixel, and of the fragments that show their fronts.
  float nearest_ = -std::numeric_limits<float>::infinity();
  float nearest_front_ = -std::numeric_limits<float>::infinity();
};

/// Whether there is a fragment of a layer in a patch. Bits are added up without a branch, so that
/// compilers use vectors.
/// \param layer  The layer's weights in the patch.
bool is_used(const float* layer) {
  std::uint32_t all = 0;
  for (int i = 0; i < kPatchPixels; ++i) all |= std::bit_cast<std::uint32_t>(layer[i]);
  return all != 0;
}

/// The weights of a layer in a patch as TileRims keeps them: negative where the back is seen,
/// infinite where fragments are merged, else with the spacing_step() as the last bits. There is no
/// branch, so that compilers use vectors.
/// \param layer  The layer's weights in the patch, which its other channels follow.
void sign_weights(const float* layer, float* __restrict out) {
  constexpr std::uint32_t kInfinity =
      std::bit_cast<std::uint32_t>(std::numeric_limits<float>::infinity());
  static_assert(kFrontTag == 1);
  for (int i = 0; i < kPatchPixels; ++i) {
    const auto weight = std::bit_cast<std::uint32_t>(layer[kWeight * kPatchPixels + i]);
    const auto tag = std::bit_cast<std::uint32_t>(layer[kTag * kPatchPixels + i]);
    const std::uint32_t merged = 0 - (weight >> 31);  // All bits, or none.
    const std::uint32_t with_side = weight ^ (~tag << 31);
    // Tags are written for all pixels of a vector.
    const std::uint32_t step = weight == 0 ? 0 : tag >> kSpacingShift & kStepMask;
    const std::uint32_t with_step = (with_side & ~kStepMask) | step;
    out[i] = std::bit_cast<float>((with_step & ~merged) | (kInfinity & merged));
  }
}

/// What continues a fragment around pixel (x, y) in a picture of some size.
/// \param offer  Offers the fragments of a pixel to a Continuation of the fragment.
template <class Offer>
EdgeNeighbors continued_around(const Fragment& fragment, int x, int y,
                               const std::array<int, 2>& size, const Offer& offer) {
  constexpr int kReach = 2;
  EdgeNeighbors around{};
  around.nearest_front = -std::numeric_limits<float>::infinity();
  const auto look = [&](int column, int row) {
    if (column < 0 || column >= size[0] || row < 0 || row >= size[1]) return;
    Continuation continuation(fragment);
    offer(column, row, continuation);
    around.leading = std::max(around.leading, continuation.leading());
    around.nearest_front = std::max(around.nearest_front, continuation.nearest_front());
  };
  look(x, y);
  for (int step = 1; step <= kReach; ++step) {
    look(x - step, y);
    look(x + step, y);
    look(x, y - step);
    look(x, y + step);
  }
  return around;
}

/// Adds up the sums of a surface's fragments in a pixel.
class SurfaceSum {
 public:
  /// \param dx, dy  From the surface's pixel to the pixel.
  /// \param whole   The sum of a surface that hides others.
  SurfaceSum(const SurfaceRange& range, int dx, int dy, float whole)
      : range_(range),
        nearest_(range.nearest.middle.at(dx, dy)),
        farthest_(range.farthest.middle.at(dx, dy)),
        crossed_(range.nearest.gap.at(dx, dy) < 0 || range.farthest.gap.at(dx, dy) < 0),
        whole_(whole),
        step_(range.step) {}

  void offer(float weight, float depth, bool front, int step) {
    if (front != range_.front) return;
    if (depth >= nearest_) {
      nearer_ += weight;
    } else if (depth > farthest_) {
      step_ = sum_ > 0 ? std::max(step_, step) : step;
      sum_ += weight;
    }
  }
  /// Merged surfaces do not tell what they hold of it: it is taken to go on as in the pixel.
  void offer_merged(float depth) {
    if (depth > farthest_) sum_ = std::max(sum_, range_.sum);
  }
  /// What nearer surfaces hide may not have been drawn, and what lies beyond a crossing is not told
  /// apart: it is taken to go on.
  float sum() const {
    return crossed_ || nearer_ >= whole_ ? std::numeric_limits<float>::infinity() : sum_;
  }
  int step() const { return step_; }

 private:
  const SurfaceRange& range_;
  float nearest_, farthest_;
  bool crossed_;
  float whole_;
  int step_;
  float sum_ = 0;
  float nearer_ = 0;  ///< The sum of nearer fragments of the side.
};

/// How a surface covers pixel (x, y) of a picture of some size.
/// \param offer  Offers the fragments of a pixel to a SurfaceSum.
template <class Offer>
EdgeFilter::Edge edge_in_picture(const EdgeFilter& filter, const SurfaceRange& range, int x, int y,
                                 const std::array<int, 2>& size, const Offer& offer) {
  const auto share_of = [&](int column, int row) {
    const int at_x = std::clamp(x + column - EdgeFilter::kReach, 0, size[0] - 1);
    const int at_y = std::clamp(y + row - EdgeFilter::kReach, 0, size[1] - 1);
    SurfaceSum sum(range, at_x - x, at_y - y, kWholeSurface / filter.inv_mean());
    offer(at_x, at_y, sum);
    return EdgeFilter::Sample{std::min(kOneSurface, sum.sum() * filter.inv_mean()), sum.step()};
  };
  return filter.edge_of(share_of, range.step);
}

/// Offers the fragments of a pixel of a tile, by its place in the picture.
template <class Taker>
void offer_fragments(const TileABuffer& tile, int x, int y, Taker& taker) {
  const auto pixel = static_cast<std::size_t>(tile_pixel(x - tile.x0, y - tile.y0));
  for (int layer = 0; layer < tile.layout.layers; ++layer) {
    const float* channel = tile.fragment(layer, pixel);
    const float weight = channel[kWeight * kPatchPixels];
    if (weight == 0) break;
    const float depth = channel[kDepth * kPatchPixels];
    if (weight < 0) {
      taker.offer_merged(depth);
    } else {
      const float tag = channel[kTag * kPatchPixels];
      taker.offer(weight, depth / weight, shows_front(tag),
                  spacing_step(std::bit_cast<std::uint32_t>(tag)));
    }
  }
}

}  // namespace

bool sees_other_tiles(const TileABuffer& tile, int pixel) {
  constexpr int kFar = kTileSize - kEdgeReach;
  const int x = tile_pixel_x(pixel);
  const int y = tile_pixel_y(pixel);
  return (x < kEdgeReach && tile.x0 > 0) ||
         (x >= kFar && tile.x0 + kTileSize < tile.picture_width) ||
         (y < kEdgeReach && tile.y0 > 0) ||
         (y >= kFar && tile.y0 + kTileSize < tile.picture_height);
}

EdgeNeighbors look_around(const TileABuffer& tile, const Fragment& fragment, int pixel) {
  return continued_around(
      fragment, tile.x0 + tile_pixel_x(pixel), tile.y0 + tile_pixel_y(pixel),
      {tile.picture_width, tile.picture_height},
      [&](int x, int y, Continuation& continuation) { offer_fragments(tile, x, y, continuation); });
}

EdgeFilter::Edge edge_around(const TileABuffer& tile, const SurfaceRange& range, int pixel) {
  return edge_in_picture(*tile.edge_filter, range, tile.x0 + tile_pixel_x(pixel),
                         tile.y0 + tile_pixel_y(pixel), {tile.picture_width, tile.picture_height},
                         [&](int x, int y, SurfaceSum& sum) { offer_fragments(tile, x, y, sum); });
}

void TileRims::begin(const Camera& camera, const Band& band, int layers) {
  const auto tiles = static_cast<std::size_t>(band.tiles_x);
  // The row of tiles before the band's first is the last one of the band before.
  const int row_before = band.y0 / kTileSize - 1;
  if (row_before < 0) {
    const std::size_t all = tiles * (band.tiles_y + 1);
    layer_stride_ = all * kPatches;
    weights_.resize(layer_stride_ * layers);
    depths_.resize(layer_stride_ * layers);
    used_.resize(layer_stride_);
    inside_.resize(all);
  } else {
    const std::size_t from = tiles * (row_before - first_row_);
    for (Array<Patch>* patches : {&weights_, &depths_}) {
      for (int layer = 0; layer < layers; ++layer) {
        Patch* const first = patches->data() + layer * layer_stride_;
        std::copy_n(first + from * kPatches, tiles * kPatches, first);
      }
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
  const int pixel = tile_pixel(x % kTileSize, y % kTileSize);
  return {tile_of(x / kTileSize, y / kTileSize) * kPatches + pixel / kPatchPixels,
          static_cast<std::size_t>(pixel % kPatchPixels)};
}

void TileRims::store(const TileABuffer& tile, TileInside inside) {
  const std::size_t number = tile_of(tile.x0 / kTileSize, tile.y0 / kTileSize);
  inside_[number] = inside;
  const std::size_t stride = tile.layout.layer_stride();
  for (std::size_t k = 0; k < kPatches; ++k) {
    const std::size_t patch = number * kPatches + k;
    const float* const first = tile.fragment(0, k * kPatchPixels);
    int used = 0;
    if (inside != TileInside::kNo) {
      used = 1;
    } else {
      while (used < tile.layout.layers && is_used(first + used * stride)) ++used;
    }
    used_[patch] = static_cast<std::uint8_t>(used);
    for (int layer = 0; layer < used; ++layer) {
      const float* const from = first + layer * stride;
      const std::size_t to = layer * layer_stride_ + patch;
      sign_weights(from, weights_[to].data());
      std::copy_n(from + kDepth * kPatchPixels, kPatchPixels, depths_[to].begin());
    }
  }
}

/// Offers the fragments of a pixel near a tile's border.
template <class Taker>
void TileRims::offer_fragments(int x, int y, Taker& taker) const {
  const auto [patch, pixel] = place_of(x, y);
  const int used = used_[patch];
  for (int layer = 0; layer < used; ++layer) {
    const std::size_t place = layer * layer_stride_ + patch;
    const float weight = weights_[place][pixel];
    if (weight == 0) break;
    const float depth = depths_[place][pixel];
    if (std::isinf(weight)) {
      taker.offer_merged(depth);
    } else {
      taker.offer(std::abs(weight), depth / std::abs(weight), weight > 0,
                  static_cast<int>(std::bit_cast<std::uint32_t>(weight) & kStepMask));
    }
  }
}

EdgeNeighbors TileRims::look_around(const Fragment& fragment, int x, int y) const {
  return continued_around(fragment, x, y, {width_, height_},
                          [&](int column, int row, Continuation& continuation) {
                            offer_fragments(column, row, continuation);
                          });
}

EdgeFilter::Edge TileRims::edge_around(const EdgeFilter& filter, const SurfaceRange& range, int x,
                                       int y) const {
  return edge_in_picture(
      filter, range, x, y, {width_, height_},
      [&](int column, int row, SurfaceSum& sum) { offer_fragments(column, row, sum); });
}

/// Whether the tile of a pixel lies inside a surface and so do the tiles that the pixel sees.
bool TileRims::inside_goes_on(int x, int y) const {
  const TileInside inside = inside_[tile_of(x / kTileSize, y / kTileSize)];
  if (inside == TileInside::kNo) return false;
  const auto same = [&](int column, int row) {
    return column >= 0 && column < width_ && row >= 0 && row < height_ &&
           inside_[tile_of(column / kTileSize, row / kTileSize)] == inside;
  };
  return same(x - kEdgeReach, y - kEdgeReach) && same(x + kEdgeReach, y - kEdgeReach) &&
         same(x - kEdgeReach, y + kEdgeReach) && same(x + kEdgeReach, y + kEdgeReach);
}

float TileRims::coverage_change(const TileABuffer& weights, const LoneFragment& lone) const {
  if (inside_goes_on(lone.x, lone.y)) return 1;
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  const SlantedDepth far_off{kInfinity, {}};
  const SurfaceRange all{shows_front(lone.tag),
                         {far_off, far_off},
                         {{-kInfinity, {}}, far_off},
                         lone.weight,
                         spacing_step(std::bit_cast<std::uint32_t>(lone.tag))};
  const EdgeFilter& filter = *weights.edge_filter;
  const auto [degree, coverage] = edge_around(filter, all, lone.x, lone.y);
  const float inside = std::min(1.0F, lone.weight / weights.full_weight);
  return 1 + degree * (coverage / inside - 1);
}

void OpenPixels::add_lone(const TileABuffer& tile,
                          const std::array<std::uint16_t, kTilePixels / kPatchPixels>& which) {
  for (std::size_t patch = 0; patch < which.size(); ++patch) {
    for (unsigned left = which[patch]; left != 0; left &= left - 1) {
      const auto pixel = static_cast<int>(patch * kPatchPixels) + std::countr_zero(left);
      const float* channel = tile.fragment(0, static_cast<std::size_t>(pixel));
      lone.push_back({tile.x0 + tile_pixel_x(pixel), tile.y0 + tile_pixel_y(pixel),
                      channel[kWeight * kPatchPixels], channel[kTag * kPatchPixels]});
    }
  }
}

void OpenPixels::keep_from_row(int row) {
  std::erase_if(lone, [&](const LoneFragment& fragment) { return fragment.y < row; });
  std::erase_if(pixels, [&](const Pixel& pixel) { return pixel.y < row; });
  std::vector<Fragment> kept;
  for (Pixel& pixel : pixels) {
    const auto first = fragments.begin() + static_cast<std::ptrdiff_t>(pixel.first);
    pixel.first = kept.size();
    kept.insert(kept.end(), first, first + pixel.count + (pixel.rest ? 1 : 0));
  }
  fragments.assign(kept.begin(), kept.end());
}

void OpenPixels::clear() {
  pixels.clear();
  fragments.clear();
  lone.clear();
}

}  // namespace surfel
