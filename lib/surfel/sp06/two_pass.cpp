// Zhang, Pajarola, "Single-Pass Point Rendering and Transparent Shading", 2006: section 3.1.

#include <array>
#include <cmath>

#include <surfel/sp06/tile_fragments.h>
#include <surfel/sp06/two_pass.h>

namespace surfel {
namespace {

class TwoPasses {
 public:
  TwoPasses(const TileJob& job, TileABuffer& tile) : job_(job), tile_(tile) {
    nearest_.fill(kNoDepth);
    side_.fill(0);
  }

  void run() {
    for_each_part(job_, [&](SplatSpan part) { find_visible(part); });
    for_each_part(job_, [&](SplatSpan part) { add_attributes(part); });
  }

 private:
  /// The visibility pass: the depth of the nearest fragment, and its side.
  void find_visible(SplatSpan part) {
    for_each_fragment(job_, tile_, part, nearest_.data(), [&](const SplatFragment& f) {
      if (!(f.depth > nearest_[f.pixel])) return;
      nearest_[f.pixel] = f.depth;
      side_[f.pixel] = side_of(job_, f.splat);
      tile_.at(0, kTag, static_cast<int>(f.pixel)) = std::bit_cast<float>(job_.splats[f.splat].tag);
    });
  }

  /// The attribute pass. Nothing is seen behind surfaces that cover their pixel so far; a single
  /// layer shows nothing behind itself.
  void add_attributes(SplatSpan part) {
    std::array<float, kTilePixels> hidden;
    for (std::size_t pixel = 0; pixel < kTilePixels; ++pixel) {
      const bool hides = tile_.layout.layers == 1 || *tile_.fragment(0, pixel) >= tile_.edge_weight;
      hidden[pixel] = hides ? nearest_[pixel] : kNoDepth;
    }
    for_each_fragment(job_, tile_, part, hidden.data(), [&](const SplatFragment& f) {
      if (f.reach() < hidden[f.pixel]) return;
      if (f.reach() >= nearest_[f.pixel] && side_of(job_, f.splat) == side_[f.pixel]) {
        add_visible(f);
      } else {
        add_behind(f);
      }
    });
  }

  /// The tag stays the nearest fragment's.
  void add_visible(const SplatFragment& f) {
    float& tag = tile_.at(0, kTag, static_cast<int>(f.pixel));
    const float nearest = tag;
    add_to_layer(job_, f, tile_, 0);
    tag = nearest;
  }

  /// Adds a contribution to the layers behind the first, as in SS01 section 6. Where no layer is
  /// left it is dropped: as splats come front to back, its surface is the farthest.
  void add_behind(const SplatFragment& f) {
    for (int i = 1; i < tile_.layout.layers; ++i) {
      Fragment layer;
      load_fragment(tile_, i, static_cast<int>(f.pixel), layer);
      const float weight = layer.channel[kWeight];
      // The difference of depths, times the layer's weight.
      const float nearer = f.depth * weight - layer.channel[kDepth];
      const bool near = std::abs(nearer) < f.epsilon * weight;
      const bool front = side_of(job_, f.splat) != 0;
      if (weight == 0 || (near && shows_front(layer.channel[kTag]) == front)) {
        add_to_layer(job_, f, tile_, i);
        return;
      }
      if (weight >= tile_.edge_weight && nearer < 0) return;
    }
  }

  const TileJob& job_;
  TileABuffer& tile_;
  std::array<float, kTilePixels> nearest_;       ///< Depth of the nearest fragment ...
  std::array<std::uint32_t, kTilePixels> side_;  ///< ... and its side, kFrontTag or 0.
};

}  // namespace

void draw_two_pass(const TileJob& job, TileABuffer& tile) { TwoPasses(job, tile).run(); }

}  // namespace surfel
