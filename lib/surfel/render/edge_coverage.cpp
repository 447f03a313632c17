#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

#include <surfel/render/edge_coverage.h>
#include <surfel/render/frame.h>

namespace surfel {
namespace {

/// Least opacity of a pixel whose colour is its own.
constexpr float kLeastOpacity = 1.0F / 4096;

}  // namespace

EdgeCoverage::EdgeCoverage(const EdgeFilter& filter, double lowpass, float full_weight)
    : filter_(filter),
      inv_full_(1 / full_weight),
      reach_(std::min(kMostReach, static_cast<int>(std::ceil(3 * lowpass)))) {}

void EdgeCoverage::begin(int width, int height) {
  width_ = width;
  height_ = height;
  tiles_x_ = tiles_along(width);
  tiles_y_ = tiles_along(height);
  const std::size_t tiles = static_cast<std::size_t>(tiles_x_) * tiles_y_;
  ranges_.assign(tiles, {});
  pixels_.resize(tiles * kTilePixels);
}

/// Calls visit(pixel of the patch, place of that pixel) for the rows of a patch of a tile.
/// \param first  the patch's first pixel in the A-buffer's order.
/// \param tile   the tile's pixels, row by row.
template <class Visit>
void EdgeCoverage::for_each_row(std::size_t first, Pixel* tile, const Visit& visit) {
  const auto pixel = static_cast<int>(first);
  Pixel* row = tile + tile_pixel_y(pixel) * kTileSize + tile_pixel_x(pixel);
  for (int i = 0; i < kPatchPixels; i += kStripWidth, row += kTileSize) visit(i, row);
}

void EdgeCoverage::store(const TileABuffer& tile, TileInside inside) {
  const bool resolved = inside != TileInside::kNo;
  const std::size_t number = tile_of(tile.x0, tile.y0);
  Pixel* const to = pixels_.data() + number * kTilePixels;
  Range range{1, 0};
  bool unknown = false;      // Are there pixels whose sums are not known yet ...
  bool some_merged = false;  // ... as surfaces have been merged?
  for (std::size_t first = 0; first < kTilePixels; first += kPatchPixels) {
    std::array<float, kPatchPixels> front{};
    std::array<float, kPatchPixels> back{};
    std::array<std::uint32_t, kPatchPixels> kept{};
    std::array<std::uint32_t, kPatchPixels> merged{};
    for (int layer = 0; layer < tile.layout.layers; ++layer) {
      const float* const weights = tile.fragment(layer, first);
      const float* const tags = weights + kTag * kPatchPixels;
      std::uint32_t any = 0;
      for (int i = 0; i < kPatchPixels; ++i) any |= std::bit_cast<std::uint32_t>(weights[i]);
      if (any == 0) break;
      for (int i = 0; i < kPatchPixels; ++i) {
        const auto tag = std::bit_cast<std::uint32_t>(tags[i]);
        const float weight = std::max(0.0F, weights[i]);
        const bool is_front = (tag & kFrontTag) != 0;
        front[i] += is_front ? weight : 0.0F;
        back[i] += is_front ? 0.0F : weight;
        kept[i] |= weights[i] > 0 && (tag & kFineTag) == 0 ? 1U : 0U;
        merged[i] |= weights[i] < 0 ? 1U : 0U;
      }
      if (!tile.layout.clips) continue;
      const float* const cut = weights + kCutPartial * kPatchPixels;
      for (int i = 0; i < kPatchPixels; ++i) {
        // Lines tell more about the edges of surfels that are larger than the pixel filter.
        const bool filtered = is_filtered(tags[i]);
        kept[i] |= weights[i] > 0 && cut[i] > 0 && !filtered ? 1U : 0U;
      }
    }
    std::array<float, kPatchPixels> sums;
    std::uint32_t any_kept = 0;
    std::uint32_t any_merged = 0;
    for_each_row(first, to, [&](int i, Pixel* row) {
      for (int column = 0; column < kStripWidth; ++column, ++i) {
        const float sum = std::max(front[i], back[i]);
        const float known = std::min(1.0F, sum * filter_.inv_mean());
        const float opacity = resolved ? std::min(1.0F, sum * inv_full_) : 0.0F;
        sums[i] = resolved && kept[i] != 0 ? opacity : known;
        row[column] = {
            static_cast<std::uint16_t>(steps_of(sums[i]) | (kept[i] != 0 ? kKept : 0)),
            static_cast<std::uint16_t>(steps_of(opacity) | (merged[i] != 0 ? kMerged : 0))};
        any_kept |= kept[i];
        any_merged |= merged[i];
      }
    });
    unknown = unknown || (!resolved && (any_kept | any_merged) != 0);
    some_merged = some_merged || any_merged != 0;
    const auto [least, most] = std::minmax_element(sums.begin(), sums.end());
    range = {std::min(range.least, *least), std::max(range.most, *most)};
  }
  if (unknown) range = {0, 1};
  range.merged = some_merged;
  ranges_[number] = range;
}

void EdgeCoverage::store_inside(const TileABuffer& tile, float least) {
  const std::size_t number = tile_of(tile.x0, tile.y0);
  static_assert(sizeof(Pixel) == sizeof(float));
  Pixel* to = pixels_.data() + number * kTilePixels;
  for (std::size_t first = 0; first < kTilePixels; first += kPatchPixels, to += kPatchPixels) {
    std::memcpy(to, tile.fragment(0, first), kPatchPixels * sizeof(float));
  }
  ranges_[number] = {std::min(1.0F, least * filter_.inv_mean()), 1, true};
}

/// Makes pixels of a tile's raw sums.
void EdgeCoverage::unpack(std::size_t tile) {
  Pixel* const pixels = pixels_.data() + tile * kTilePixels;
  std::array<float, kTilePixels> sums;
  std::memcpy(sums.data(), pixels, sizeof(sums));
  for (std::size_t first = 0; first < kTilePixels; first += kPatchPixels) {
    for_each_row(first, pixels, [&](int i, Pixel* row) {
      const float* const from = sums.data() + first + i;
      for (int column = 0; column < kStripWidth; ++column) {
        row[column] = {steps_of(std::min(1.0F, from[column] * filter_.inv_mean())),
                       steps_of(std::min(1.0F, from[column] * inv_full_))};
      }
    });
  }
  ranges_[tile].raw = false;
}

/// Whether something holds for a tile or for one of those next to it.
template <class Holds>
bool EdgeCoverage::any_around(int tile_x, int tile_y, const Holds& holds) const {
  for (int y = std::max(0, tile_y - 1); y <= std::min(tiles_y_ - 1, tile_y + 1); ++y) {
    for (int x = std::max(0, tile_x - 1); x <= std::min(tiles_x_ - 1, tile_x + 1); ++x) {
      if (holds(x, y)) return true;
    }
  }
  return false;
}

/// Whether the sums around a tile are not all the same as far as edges are concerned.
bool EdgeCoverage::may_have_edges(int tile_x, int tile_y) const {
  const auto range_at = [&](int x, int y) -> const Range& {
    return ranges_[static_cast<std::size_t>(y) * tiles_x_ + x];
  };
  return any_around(tile_x, tile_y, [&](int x, int y) { return range_at(x, y).most > 0; }) &&
         any_around(tile_x, tile_y,
                    [&](int x, int y) { return range_at(x, y).least < EdgeFilter::kEdgeSum; });
}

/// Fetches the sums around a tile, and returns their least and their largest. Beyond the picture
/// they go on as they are at its border.
std::pair<float, float> EdgeCoverage::gather(int x0, int y0, Scratch& scratch) const {
  const int margin = reach_ + kTaps;
  const int side = kTileSize + 2 * margin;
  const int first = x0 - margin;
  std::uint16_t least = kKept;
  std::uint16_t most = 0;
  for (int row = 0; row < side; ++row) {
    const int y = std::clamp(y0 - margin + row, 0, height_ - 1);
    auto& sums = scratch.sum[row];
    // Within a tile a row's pixels follow one another.
    const int end = std::min(first + side, width_);
    for (int x = std::max(first, 0); x < end;) {
      const Pixel* const pixels = &at(x, y);
      const int count = std::min(kTileSize - x % kTileSize, end - x);
      for (int i = 0; i < count; ++i) {
        const auto steps = static_cast<std::uint16_t>(pixels[i].sum & ~kKept);
        sums[x - first + i] = static_cast<float>(steps) * (1 / kScale);
        least = std::min(least, steps);
        most = std::max(most, steps);
      }
      x += count;
    }
    for (int column = 0; column < -first; ++column) sums[column] = sums[-first];
    for (int column = end - first; column < side; ++column) sums[column] = sums[end - first - 1];
  }
  return {static_cast<float>(least) / kScale, static_cast<float>(most) / kScale};
}

/// Filters the sums. In `rows` the least filtered sum within reach of each of the tile's pixels is
/// left.
void EdgeCoverage::filter(Scratch& scratch) const {
  const int side = kTileSize + 2 * (reach_ + kTaps);
  const int filtered = side - 2 * kTaps;
  static_assert(kTaps == 2);
  for (int y = 0; y < side; ++y) {
    const auto& s = scratch.sum[y];
    for (int x = 0; x < filtered; ++x) {
      scratch.rows[y][x] = filter_.smooth(s[x], s[x + 1], s[x + 2], s[x + 3], s[x + 4]);
    }
  }
  for (int y = 0; y < filtered; ++y) {
    const auto* r = &scratch.rows[y];
    for (int x = 0; x < filtered; ++x) {
      scratch.smooth[y][x] = filter_.smooth(r[0][x], r[1][x], r[2][x], r[3][x], r[4][x]);
    }
  }
  // The least of a window, by windows that grow by as much as they are long: of 1, 2, 4 ... values.
  const int window = 2 * reach_ + 1;
  const auto for_each_step = [&](const auto& grow) {
    for (int size = 1; size < window;) {
      const int step = std::min(size, window - size);
      size += step;
      grow(step, filtered - size + 1);
    }
  };
  for (int y = 0; y < filtered; ++y) {
    auto& low = scratch.rows[y];
    std::copy_n(scratch.smooth[y].begin(), filtered, low.begin());
    for_each_step([&](int step, int count) {
      for (int x = 0; x < count; ++x) low[x] = std::min(low[x], low[x + step]);
    });
  }
  for_each_step([&](int step, int count) {
    for (int y = 0; y < count; ++y) {
      auto& low = scratch.rows[y];
      const auto& other = scratch.rows[y + step];
      for (int x = 0; x < kTileSize; ++x) low[x] = std::min(low[x], other[x]);
    }
  });
}

void EdgeCoverage::change_tile(int x0, int y0, Scratch& scratch, Image& image,
                               FunctionRef<Rgba(int x, int y)> behind) {
  const auto [least, most] = gather(x0, y0, scratch);
  if ((least >= EdgeFilter::kEdgeSum && !ranges_[tile_of(x0, y0)].merged) || most == 0) return;
  filter(scratch);
  const int x1 = std::min(x0 + kTileSize, width_);
  const int y1 = std::min(y0 + kTileSize, height_);
  for (int y = y0; y < y1; ++y) {
    for (int x = x0; x < x1; ++x) {
      const float low = scratch.rows[y - y0][x - x0];
      Pixel& pixel = at(x, y);
      // Merging took fragments to be at edges where there may be none.
      const bool merged = (pixel.opacity & kMerged) != 0;
      if ((low >= EdgeFilter::kEdgeSum && !merged) || (pixel.sum & kKept) != 0) continue;
      const int row = y - y0 + reach_;
      const int column = x - x0 + reach_;
      const auto& s = scratch.smooth;
      const float sum = s[row][column];
      const float laplacian = (s[row][column - 1] + s[row][column + 1]) +
                              (s[row - 1][column] + s[row + 1][column]) - 4 * sum;
      const float before = opacity_of(pixel);
      const float edge = merged ? 1.0F : EdgeFilter::edge_by(low);
      const float opacity = before + edge * (filter_.sharpened(sum, laplacian) - before);
      if (before < kLeastOpacity) {
        if (opacity >= kLeastOpacity) scratch.unreached.push_back({x, y, opacity});
        continue;
      }
      const Rgba back = behind(x, y);
      float* const out = image.pixel(x, y);
      const float scale = opacity / before;
      int channel = 0;
      for (const float b : {back.red, back.green, back.blue}) {
        out[channel] = (out[channel] - (1 - before) * b) * scale + (1 - opacity) * b;
        ++channel;
      }
      // The scale is rounded as `before` is, which would leave a faint pixel's alpha above 1.
      out[3] = opacity + (1 - opacity) * back.alpha;
      pixel.opacity = steps_of(opacity);
      if (image.channel_count() > 4) {
        // Z is where opacity passes one half, Z.first the nearest surface's depth.
        if (opacity < 0.5F) {
          out[4] = std::numeric_limits<float>::infinity();
        } else if (std::isinf(out[4])) {
          out[4] = out[5];
        }
      }
    }
  }
}

/// Gives a pixel the mean colour of those around that have one.
void EdgeCoverage::fill(const Unreached& pixel, Image& image,
                        FunctionRef<Rgba(int x, int y)> behind) const {
  constexpr int kAround = 2;
  Rgba sum;
  for (int y = std::max(0, pixel.y - kAround); y <= std::min(height_ - 1, pixel.y + kAround); ++y) {
    for (int x = std::max(0, pixel.x - kAround); x <= std::min(width_ - 1, pixel.x + kAround);
         ++x) {
      const float opacity = opacity_of(at(x, y));
      if (opacity < kLeastOpacity) continue;
      if ((at(x, y).sum & kKept) != 0) return;
      const Rgba back = behind(x, y);
      const float* const c = image.pixel(x, y);
      sum.red += c[0] - (1 - opacity) * back.red;
      sum.green += c[1] - (1 - opacity) * back.green;
      sum.blue += c[2] - (1 - opacity) * back.blue;
      sum.alpha += opacity;
    }
  }
  if (!(sum.alpha > 0)) return;
  const float scale = pixel.opacity / sum.alpha;
  Rgba color{sum.red * scale, sum.green * scale, sum.blue * scale, pixel.opacity};
  color.composite(behind(pixel.x, pixel.y));
  float* const out = image.pixel(pixel.x, pixel.y);
  out[0] = color.red;
  out[1] = color.green;
  out[2] = color.blue;
  out[3] = color.alpha;
}

void EdgeCoverage::apply(Image& image, const RowRange& rows,
                         FunctionRef<Rgba(int x, int y)> behind) {
  constexpr std::size_t kGrain = 4;  // Tiles.
  // Pixels that no kernel reaches take the colours of the tiles next to theirs.
  const auto row = static_cast<std::size_t>(tiles_x_);
  const std::size_t first = row * std::max(0, rows.begin / kTileSize - 1);
  const std::size_t end_tile = row * std::min(tiles_y_, tiles_along(rows.end) + 1);
  const auto is_looked_at = [&](std::size_t tile) {
    return any_around(static_cast<int>(tile % tiles_x_), static_cast<int>(tile / tiles_x_),
                      [&](int x, int y) { return may_have_edges(x, y); });
  };
  parallel_each(ranges_.size(), 8 * kGrain, [&](std::size_t tile) {
    if (ranges_[tile].raw && is_looked_at(tile)) unpack(tile);
  });
  parallel_for(end_tile - first, kGrain, [&](std::size_t begin, std::size_t end, int w) {
    for (std::size_t tile = first + begin; tile < first + end; ++tile) {
      const int x = static_cast<int>(tile % tiles_x_);
      const int y = static_cast<int>(tile / tiles_x_);
      if (!may_have_edges(x, y)) continue;
      change_tile(x * kTileSize, y * kTileSize, scratch_[w], image, behind);
    }
  });
  scratch_.for_each([&](Scratch& scratch) {
    parallel_each(scratch.unreached.size(), 256,
                  [&](std::size_t i) { fill(scratch.unreached[i], image, behind); });
    scratch.unreached.clear();
  });
}

}  // namespace surfel
