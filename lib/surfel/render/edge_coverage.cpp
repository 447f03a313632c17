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

/// From this spacing_step() on the sums are too uneven to tell how many scans there are.
constexpr int kLargeStep = 3;

/// The sum of a pixel by the sums of two sides: of one body's, which are only uneven, the mean, as
/// the larger one would be too large; where one side is hidden or not there, the larger one.
float of_two_sides(float a, float b) {
  constexpr float kHidden = 0.7F;
  constexpr float kUneven = 0.9F;
  const float larger = std::max(a, b);
  const float smaller = std::min(a, b);
  const float both = std::clamp((smaller - kHidden * larger) / (kUneven - kHidden), 0.0F, larger);
  return larger > 0 ? larger - both / larger * (larger - smaller) / 2 : 0;
}

/// The surfaces of one side in the pixels of a patch.
struct SideSums {
  std::array<float, kPatchPixels> all{};       ///< Sums of rho.
  std::array<float, kPatchPixels> largest{};   ///< Of one surface.
  std::array<float, kPatchPixels> covered{};   ///< By all, if they cover independent parts.
  std::array<float, kPatchPixels> nearest{};   ///< Depth ...
  std::array<float, kPatchPixels> farthest{};  ///< ... where largest is not 0.

  /// Adds a surface to a pixel; of sum 0: none.
  /// \param mean  the mean sum within a surface.
  void add(int i, float sum, float depth, float mean) {
    const bool any = largest[i] > 0;
    const bool is = sum > 0;
    nearest[i] = is && (!any || depth > nearest[i]) ? depth : nearest[i];
    farthest[i] = is && (!any || depth < farthest[i]) ? depth : farthest[i];
    all[i] += sum;
    largest[i] = std::max(largest[i], sum);
    covered[i] += (mean - covered[i]) * std::min(1.0F, sum / mean);
  }
  float sum(int i) const {
    const bool one_body = nearest[i] - farthest[i] <= kRimDepth * std::abs(nearest[i]);
    return one_body ? largest[i] : std::max(largest[i], covered[i]);
  }
};

/// The sums of rho of the pixels of a patch.
struct PatchSums {
  std::array<float, kPatchPixels> one;  ///< Of the surface that counts.
  std::array<float, kPatchPixels> all;  ///< Of all surfaces of a side.
};

/// \param first   the patch's first pixel in the A-buffer's order.
/// \param layers  how many are in use.
PatchSums sums_of_patch(const TileABuffer& tile, std::size_t first, int layers) {
  PatchSums sums;
  if (layers < 2) {
    const float* const weights = tile.fragment(0, first);
    for (int i = 0; i < kPatchPixels; ++i) sums.one[i] = std::max(0.0F, weights[i]);
    sums.all = sums.one;
    return sums;
  }
  std::array<SideSums, 2> sides;  // The back, the front.
  for (int layer = 0; layer < layers; ++layer) {
    const float* const weights = tile.fragment(layer, first);
    const float* const depths = weights + kDepth * kPatchPixels;
    const float* const tags = weights + kTag * kPatchPixels;
    for (int i = 0; i < kPatchPixels; ++i) {
      const float weight = std::max(0.0F, weights[i]);
      const float depth = weight > 0 ? depths[i] / weight : 0.0F;
      const bool is_front = (std::bit_cast<std::uint32_t>(tags[i]) & kFrontTag) != 0;
      sides[0].add(i, is_front ? 0.0F : weight, depth, tile.mean_weight);
      sides[1].add(i, is_front ? weight : 0.0F, depth, tile.mean_weight);
    }
  }
  for (int i = 0; i < kPatchPixels; ++i) {
    sums.one[i] = of_two_sides(sides[0].sum(i), sides[1].sum(i));
    sums.all[i] = std::max(sides[0].all[i], sides[1].all[i]);
  }
  return sums;
}

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
  means_.assign(tiles, {});
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
  Range range;
  bool unknown = false;  // Are there pixels whose sums are not known yet?
  for (std::size_t first = 0; first < kTilePixels; first += kPatchPixels) {
    std::array<int, kPatchPixels> step{};
    std::array<std::uint32_t, kPatchPixels> merged{};
    int layers = 0;
    for (; layers < tile.layout.layers; ++layers) {
      const float* const weights = tile.fragment(layers, first);
      const float* const tags = weights + kTag * kPatchPixels;
      std::uint32_t any = 0;
      for (int i = 0; i < kPatchPixels; ++i) any |= std::bit_cast<std::uint32_t>(weights[i]);
      if (any == 0) break;
      for (int i = 0; i < kPatchPixels; ++i) {
        const int spacing = spacing_step(std::bit_cast<std::uint32_t>(tags[i]));
        step[i] = std::max(step[i], weights[i] > 0 ? spacing : 0);
        merged[i] |= weights[i] < 0 ? 1U : 0U;
      }
      if (!tile.layout.clips) continue;
      const float* const cut = weights + kCutPartial * kPatchPixels;
      for (int i = 0; i < kPatchPixels; ++i) {
        // Lines tell more about the edges of surfels that are larger than the pixel filter.
        const bool ends_at_line = weights[i] > 0 && cut[i] > 0 && !is_filtered(tags[i]);
        step[i] = ends_at_line ? kCoarseStep : step[i];
      }
    }
    PatchSums sums = sums_of_patch(tile, first, layers);
    float all = 0;
    bool any_unknown = false;
    for (int i = 0; i < kPatchPixels; ++i) {
      sums.one[i] *= filter_.inv_mean();
      sums.all[i] *= filter_.inv_mean();
      range.most = std::max(range.most, sums.all[i]);
      range.ends |= EdgeFilter::slack(sums.all[i], step[i]) < 0;
      any_unknown |= step[i] == kCoarseStep || merged[i] != 0;
      all += sums.one[i];
    }
    unknown |= any_unknown && !resolved;
    for_each_row(first, to, [&](int i, Pixel* row) {
      for (int column = 0; column < kStripWidth; ++column, ++i) {
        const float opacity =
            resolved ? std::min(1.0F, sums.one[i] / filter_.inv_mean() * inv_full_) : 0.0F;
        row[column] = {steps_of(sums.one[i]), steps_of(sums.all[i]), 0,
                       static_cast<std::uint8_t>(step[i]), merged[i] != 0};
        note_opacity(row[column], opacity);
      }
    });
    const bool fine = *std::max_element(step.begin(), step.end()) < kLargeStep;
    means_[number][first / kPatchPixels] = fine ? all / kPatchPixels : 0;
  }
  if (unknown) {
    range.most = std::max(1.0F, range.most);
    range.ends = true;
  }
  ranges_[number] = range;
}

void EdgeCoverage::store_inside(const TileABuffer& tile) {
  const std::size_t number = tile_of(tile.x0, tile.y0);
  static_assert(sizeof(Pixel) >= sizeof(float));
  auto* to = reinterpret_cast<std::byte*>(pixels_.data() + number * kTilePixels);
  for (std::size_t first = 0; first < kTilePixels; first += kPatchPixels) {
    const float* const weights = tile.fragment(0, first);
    const float* const tags = weights + kTag * kPatchPixels;
    std::array<std::uint32_t, kPatchPixels> raw;
    float all = 0;
    bool fine = true;
    for (int i = 0; i < kPatchPixels; ++i) {
      const int step = spacing_step(std::bit_cast<std::uint32_t>(tags[i]));
      fine &= step < kLargeStep;
      const auto bits = std::bit_cast<std::uint32_t>(weights[i]);
      raw[i] = (bits & ~kStepMask) | static_cast<std::uint32_t>(step);
      all += weights[i];
    }
    std::memcpy(to + first * sizeof(float), raw.data(), sizeof(raw));
    means_[number][first / kPatchPixels] = fine ? all * filter_.inv_mean() / kPatchPixels : 0;
  }
  ranges_[number] = {.most = 1, .ends = false, .raw = true};
}

/// Makes pixels of a tile's raw sums.
void EdgeCoverage::unpack(std::size_t tile) {
  Pixel* const pixels = pixels_.data() + tile * kTilePixels;
  std::array<std::uint32_t, kTilePixels> raw;
  std::memcpy(raw.data(), pixels, sizeof(raw));
  for (std::size_t first = 0; first < kTilePixels; first += kPatchPixels) {
    for_each_row(first, pixels, [&](int i, Pixel* row) {
      const std::uint32_t* const from = raw.data() + first + i;
      for (int column = 0; column < kStripWidth; ++column) {
        const float weight = std::bit_cast<float>(from[column] & ~kStepMask);
        const std::uint16_t sum = steps_of(weight * filter_.inv_mean());
        row[column] = {sum, sum, steps_of(std::min(1.0F, weight * inv_full_)),
                       static_cast<std::uint8_t>(from[column] & kStepMask), false};
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
         any_around(tile_x, tile_y, [&](int x, int y) { return range_at(x, y).ends; });
}

/// The mean sum of the place of a pixel over the mean sum within a surface: more than 1 where
/// several scans of it are joined, so that all patches around that are whole have such sums. Edges
/// reach less than a patch beside theirs.
float EdgeCoverage::mean_at(int x, int y) const {
  constexpr int kAround = 2;  // Patches.
  const auto last = [](int pixels) { return (pixels - 1) / kStripWidth; };
  const int patch_x = x / kStripWidth;
  const int patch_y = y / kStripWidth;
  // Half of what a second scan adds.
  constexpr float kTwoScans = 1.5F;
  float most = 0;
  float sum = 0;
  int whole = 0;
  for (int py = std::max(0, patch_y - kAround); py <= std::min(last(height_), patch_y + kAround);
       ++py) {
    for (int px = std::max(0, patch_x - kAround); px <= std::min(last(width_), patch_x + kAround);
         ++px) {
      const int column = px * kStripWidth;
      const int row = py * kStripWidth;
      const int pixel = tile_pixel(column % kTileSize, row % kTileSize);
      const float mean = means_[tile_of(column, row)][pixel / kPatchPixels];
      most = std::max(most, mean);
      sum += mean >= 1 ? mean : 0;
      whole += mean >= 1 ? 1 : 0;
    }
  }
  return sum > kTwoScans * static_cast<float>(whole) ? most : 1.0F;
}

/// Fetches the sums around a tile, and returns their largest. Beyond the picture they go on as they
/// are at its border.
float EdgeCoverage::gather(int x0, int y0, Scratch& scratch) const {
  const int margin = reach_ + kTaps;
  const int side = kTileSize + 2 * margin;
  const int first = x0 - margin;
  std::uint16_t most = 0;
  for (int row = 0; row < side; ++row) {
    const int y = std::clamp(y0 - margin + row, 0, height_ - 1);
    auto& sums = scratch.sum[row];
    auto& slacks = scratch.slack[row];
    // Within a tile a row's pixels follow one another.
    const int end = std::min(first + side, width_);
    for (int x = std::max(first, 0); x < end;) {
      const Pixel* const pixels = &at(x, y);
      const int count = std::min(kTileSize - x % kTileSize, end - x);
      for (int i = 0; i < count; ++i) {
        sums[x - first + i] = share_of(pixels[i].sum);
        slacks[x - first + i] =
            EdgeFilter::slack(std::min(kOneSurface, share_of(pixels[i].all)), pixels[i].step);
        most = std::max(most, pixels[i].sum);
      }
      x += count;
    }
    for (auto* const plane : {&sums, &slacks}) {
      for (int column = 0; column < -first; ++column) (*plane)[column] = (*plane)[-first];
      for (int column = end - first; column < side; ++column) {
        (*plane)[column] = (*plane)[end - first - 1];
      }
    }
  }
  return share_of(most);
}

/// Evens out the slacks. In `rows` the least one within reach of each of the tile's pixels is left.
void EdgeCoverage::filter(Scratch& scratch) const {
  const int side = kTileSize + 2 * (reach_ + kTaps);
  const int filtered = side - 2 * kTaps;
  static_assert(kTaps == 2);
  for (int y = 0; y < side; ++y) {
    const auto& s = scratch.slack[y];
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
  const float most = gather(x0, y0, scratch);
  if (most == 0) return;
  filter(scratch);
  const int x1 = std::min(x0 + kTileSize, width_);
  const int y1 = std::min(y0 + kTileSize, height_);
  for (int y = y0; y < y1; ++y) {
    for (int x = x0; x < x1; ++x) {
      Pixel& pixel = at(x, y);
      if (pixel.step == kCoarseStep) continue;
      const float edge = EdgeFilter::edge_by(scratch.rows[y - y0][x - x0], pixel.step);
      if (edge == 0 && !pixel.merged) continue;
      const bool several = most > kSeveralSurfaces && pixel.step < kLargeStep;
      const float inv_mean = several ? 1 / mean_at(x, y) : 1;
      std::array<float, 2 * kTaps + 1> rows;
      for (int i = 0; i <= 2 * kTaps; ++i) {
        const float* const s = scratch.sum[y - y0 + reach_ + i].data() + (x - x0 + reach_);
        const auto share = [&](int k) { return std::min(kOneSurface, s[k] * inv_mean); };
        rows[i] = filter_.complete(pixel.step, share(0), share(1), share(2), share(3), share(4));
      }
      const float coverage = filter_.coverage(
          filter_.complete(pixel.step, rows[0], rows[1], rows[2], rows[3], rows[4]), pixel.step);
      const float before = share_of(pixel.opacity);
      // Merging took fragments to be at edges where there may be none.
      const float inside = pixel.merged ? 1.0F : before;
      const float opacity = inside + edge * (coverage - inside);
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
      const float opacity = share_of(at(x, y).opacity);
      if (opacity < kLeastOpacity) continue;
      if (at(x, y).step == kCoarseStep) return;
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
