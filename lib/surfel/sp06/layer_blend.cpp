// Zhang, Pajarola, "Single-Pass Point Rendering and Transparent Shading", 2006: Algorithm 2.

#include <algorithm>
#include <bit>
#include <cmath>
#include <iterator>
#include <numeric>
#include <utility>

#include <surfel/render/shading.h>
#include <surfel/sp06/layer_blend.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/sp06/layer_blend.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <surfel/base/function_ref.h>
#include <surfel/render/kernel_raster-inl.h>

#ifndef SURFEL_RENDER_LAYER_BLEND_ONCE
#define SURFEL_RENDER_LAYER_BLEND_ONCE
namespace surfel {
namespace {

/// A fragment of a group's image.
struct LayerFragment {
  int pixel;
  float depth;
  float epsilon;
  float key;  ///< sqrt(beta / cutoff).
};

}  // namespace
}  // namespace surfel
#endif

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {

/// Calls take(splat's index, its fragment) for a job's splats in their order in every pixel.
void for_each_fragment_simd(
    const TileJob& job, int x0, int y0,
    FunctionRef<void(std::uint32_t index, const LayerFragment& fragment)> take) {
  const D d;
  const KernelRaster raster(job, x0, y0);
  const V cutoff = hn::Set(d, job.cutoff);
  const V inv_cutoff = hn::Set(d, 1 / job.cutoff);
  HWY_ALIGN float depths[kTileSize];
  HWY_ALIGN float epsilons[kTileSize];
  HWY_ALIGN float keys[kTileSize];
  const auto store = [&](std::uint32_t index, std::size_t pixel, const Sample& s) HWY_ATTR {
    const M inside = hn::Lt(s.beta, cutoff);
    if (hn::AllFalse(d, inside)) return;
    hn::Store(s.depth, d, depths);
    hn::Store(s.epsilon, d, epsilons);
    hn::Store(hn::IfThenElse(inside, hn::Sqrt(hn::Mul(s.beta, inv_cutoff)), hn::Set(d, -1.0F)), d,
              keys);
    for (std::size_t lane = 0; lane < hn::Lanes(d); ++lane) {
      if (keys[lane] < 0) continue;
      take(index, {static_cast<int>(pixel + lane), depths[lane], epsilons[lane], keys[lane]});
    }
  };
  raster.draw(0, job.count, nullptr, store);
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {
namespace {

HWY_EXPORT(for_each_fragment_simd);

using Pending = LayerScratch::Pending;

/// Of a nearest fragment at its splat's very rim: where there are only such it must not be 0.
constexpr float kLeastWeight = 1e-3F;
using State = LayerScratch::State;

/// Calls visit(pixel, share) for the pixels of a tile around one, and it, with the shares of a
/// Gaussian of one pixel's standard deviation.
template <class Visit>
void for_each_around(const TileABuffer& tile, int pixel, Visit&& visit) {
  constexpr float kShare[] = {1, 0.6065F, 0.3679F};  // At distances of 0, 1 and sqrt 2 pixels.
  const int x = tile_pixel_x(pixel);
  const int y = tile_pixel_y(pixel);
  for (int row = std::max(0, y - 1); row <= std::min(tile.height - 1, y + 1); ++row) {
    for (int column = std::max(0, x - 1); column <= std::min(tile.width - 1, x + 1); ++column) {
      visit(tile_pixel(column, row), kShare[std::abs(row - y) + std::abs(column - x)]);
    }
  }
}

Vec3f normal_of(const Fragment& f) {
  return {f.channel[kNormalX], f.channel[kNormalY], f.channel[kNormalZ]};
}

/// Normals further apart than this are of different surfaces, or sides of a crease.
bool alike(const Vec3f& a, const Vec3f& b) {
  constexpr float kCosine = 0.5F;
  return a.dot(b) > kCosine * a.norm() * b.norm();
}

class Blender {
 public:
  Blender(const TileJob& job, const LayerRule& rule, const NearestLayer* masked,
          const TileABuffer& tile, LayerScratch& scratch)
      : job_(job), rule_(rule), masked_(masked), tile_(tile), scratch_(scratch) {}

  std::uint64_t run(int groups) {
    scratch_.states.assign(static_cast<std::size_t>(groups) * kTilePixels, State{});
    scratch_.pixels.assign(kTilePixels, BlendedPixel{});
    scratch_.order.assign(std::make_reverse_iterator(job_.order + job_.count),
                          std::make_reverse_iterator(job_.order));
    scratch_.order.resize(job_.count + kTileSize);
    TileJob back_to_front = job_;
    back_to_front.order = scratch_.order.data();
    HWY_DYNAMIC_DISPATCH(for_each_fragment_simd)
    (back_to_front, tile_.x0, tile_.y0,
     [&](std::uint32_t index, const LayerFragment& fragment) { take(index, fragment); });
    for (int pixel = 0; pixel < kTilePixels; ++pixel) {
      for (int group = 0; group < groups; ++group) add_nearest(state(group, pixel), pixel);
    }
    const bool environment = tile_.shader->has_environment();
    if (environment) filter_nearest();
    for (int pixel = 0; pixel < kTilePixels; ++pixel) {
      for (int group = 0; group < groups; ++group) finish(state(group, pixel), groups, pixel);
      count_layers(groups, pixel);
    }
    // With Algorithm 3 it is the nearest layer that things are seen through.
    if (environment && !masked_) filter_layers();
    return culled_;
  }

 private:
  State& state(int group, int pixel) {
    return scratch_.states[static_cast<std::size_t>(group) * kTilePixels + pixel];
  }

  bool in_nearest_layer(const LayerFragment& f, bool front) const {
    if (!masked_) return false;
    const NearestLayer& nearest = masked_[f.pixel];
    return f.depth >= nearest.depth ||
           (front == nearest.front && f.depth + f.epsilon >= nearest.depth);
  }

  float step(float depth) const {
    const float z = rule_.orthographic ? -depth : 1.0F / depth;
    return std::floor((z - rule_.nearest) * rule_.steps_per_unit);  // (6)
  }

  bool same_layer(float depth, float other, float epsilon) const {
    switch (rule_.voronoi) {
      case Voronoi::kOff:
        return false;
      case Voronoi::kQuantised:
        return step(depth) == step(other);
      case Voronoi::kWindowed:
        break;
    }
    return std::abs(depth - other) < epsilon;
  }

  void take(std::uint32_t index, const LayerFragment& f) {
    if (tile_pixel_x(f.pixel) >= tile_.width || tile_pixel_y(f.pixel) >= tile_.height) return;
    const std::uint32_t side = job_.splats[index].tag & kFrontTag;
    if (in_nearest_layer(f, side != 0)) return;
    State& s = state(job_.groups[index], f.pixel);
    Pending& pending = s.side[side];
    if (pending.splat >= 0) {
      if (same_layer(f.depth, pending.depth, f.epsilon)) {
        ++culled_;
        if (f.key < pending.key) put(pending, index, f);
        return;
      }
      if (f.depth < pending.depth) {
        // Its splat's centre lies in front of what is behind, this fragment does not.
        if (pending.any_blended && same_layer(f.depth, pending.blended, f.epsilon)) {
          ++culled_;
          return;
        }
        const Rgba color = shaded(index, f.pixel, f.depth);
        if (f.depth >= pending.blended) {
          over(s, color);
          pending.blended = f.depth;
          pending.any_blended = true;
        } else {
          s.color.composite(color);
        }
        ++s.layers;
        return;
      }
      // The layer is over, and what the other side has of layers behind it is, too.
      Pending& other = s.side[1 - side];
      if (other.splat >= 0 && other.depth < pending.depth) flush(s, other, f.pixel);
      flush(s, pending, f.pixel);
    }
    put(pending, index, f);
  }

  static void put(Pending& pending, std::uint32_t index, const LayerFragment& f) {
    pending.depth = f.depth;
    pending.key = f.key;
    pending.splat = index;
  }

  static void over(State& s, Rgba front) {
    front.composite(s.color);
    s.color = front;
  }

  void flush(State& s, Pending& pending, int pixel) {
    over(s, shaded(static_cast<std::uint32_t>(pending.splat), pixel, pending.depth));
    ++s.layers;
    pending.blended = pending.depth;
    pending.any_blended = true;
    pending.splat = -1;
  }

  Fragment fragment(std::uint32_t index, float depth) const {
    const Splat& splat = job_.splats[index];
    Fragment out{};
    float* c = out.channel;
    c[kWeight] = 1;
    c[kDepth] = depth;
    c[kRed] = splat.red;
    c[kGreen] = splat.green;
    c[kBlue] = splat.blue;
    c[kAlpha] = splat.alpha;
    c[kTag] = std::bit_cast<float>(splat.tag);
    if (job_.normals) {
      c[kNormalX] = job_.normals[index].x;
      c[kNormalY] = job_.normals[index].y;
      c[kNormalZ] = job_.normals[index].z;
    }
    return out;
  }

  Rgba shaded(const Fragment& fragment, int pixel) const {
    return tile_.shader->shade(fragment, static_cast<float>(tile_.x0 + tile_pixel_x(pixel)) + 0.5F,
                               static_cast<float>(tile_.y0 + tile_pixel_y(pixel)) + 0.5F, 1);
  }
  Rgba shaded(std::uint32_t index, int pixel, float depth) const {
    return shaded(fragment(index, depth), pixel);
  }

  /// Which of a pixel's sides has the nearer pending layer; null where nothing is pending.
  static Pending* nearer(State& s) {
    Pending& back = s.side[0];
    Pending& front = s.side[1];
    if (back.splat < 0 && front.splat < 0) return nullptr;
    if (front.splat < 0) return &back;
    return back.splat >= 0 && back.depth > front.depth ? &back : &front;
  }

  /// Adds a group's nearest layer to the pixel's.
  void add_nearest(State& s, int pixel) {
    const Pending* near = nearer(s);
    if (!near) return;
    // Of the groups' flat splats the ones that are seen near their centres count most, and those at
    // their rims nothing: the mean normal has no steps there, nor has what is seen through it.
    const float inside = 1 - near->key * near->key;
    add(scratch_.pixels[pixel].nearest, std::max(kLeastWeight, inside * inside),
        fragment(static_cast<std::uint32_t>(near->splat), near->depth));
  }

  /// Colour of a group's nearest layer. What it mirrors, it mirrors with the mean normal of all
  /// groups, whose length says how much the surface bends there: a flat splat mirrors a single
  /// direction, and where that is a lamp's the whole splat is a speck of light.
  Rgba shaded_nearest(const Pending& near, int pixel) const {
    Fragment out = fragment(static_cast<std::uint32_t>(near.splat), near.depth);
    if (!tile_.shader->has_environment()) return shaded(out, pixel);
    const Fragment& all = scratch_.pixels[pixel].nearest;
    const Vec3f mean = normal_of(all) / all.channel[kWeight];
    if (alike(normal_of(out), mean)) {
      for (int c = 0; c < 3; ++c) out.channel[kNormalX + c] = mean[c];
    }
    return shaded(out, pixel);
  }

  /// Blends what is pending, and adds a group's share to the mean.
  void finish(State& s, int groups, int pixel) {
    Pending* near = nearer(s);
    if (!near) return;
    Pending& far = near == &s.side[0] ? s.side[1] : s.side[0];
    if (far.splat >= 0) flush(s, far, pixel);
    over(s, shaded_nearest(*near, pixel));
    ++s.layers;
    const float share = 1.0F / static_cast<float>(groups);
    BlendedPixel& out = scratch_.pixels[pixel];
    out.color.red += s.color.red * share;
    out.color.green += s.color.green * share;
    out.color.blue += s.color.blue * share;
    out.color.alpha += s.color.alpha * share;
  }

  /// Number of a pixel's layers: the mean of the groups without the quarters of them that have the
  /// fewest and the most, since a single large disc that sticks out of a bent surface is a layer
  /// more, and refraction by one layer more goes elsewhere. Where that is none, of all groups.
  void count_layers(int groups, int pixel) {
    std::vector<int>& counts = scratch_.counts;
    counts.clear();
    for (int group = 0; group < groups; ++group) counts.push_back(state(group, pixel).layers);
    const std::ptrdiff_t cut = groups / 4;
    if (cut > 0) std::sort(counts.begin(), counts.end());
    const auto mean = [&](std::ptrdiff_t left_out) {
      const int sum = std::accumulate(counts.begin() + left_out, counts.end() - left_out, 0);
      return static_cast<float>(sum) / static_cast<float>(groups - 2 * left_out);
    };
    BlendedPixel& out = scratch_.pixels[pixel];
    out.layers = mean(cut);
    if (!(out.layers > 0)) out.layers = mean(0);
  }

  /// What is mirrored by and seen through the layers depends on the nearest normals and on the
  /// number of layers, steeply; both have steps of single groups and pixels, which other methods'
  /// pixel filter evens out. The same filter here, as far as the tile reaches.
  void filter_nearest() {
    scratch_.filtered.resize(kTilePixels);
    for (int pixel = 0; pixel < kTilePixels; ++pixel) {
      const BlendedPixel& own = scratch_.pixels[pixel];
      BlendedPixel& out = scratch_.filtered[pixel];
      out = own;
      if (!(own.nearest.channel[kWeight] > 0)) continue;
      out.nearest = {};
      out.nearest.channel[kTag] = own.nearest.channel[kTag];
      for_each_around(tile_, pixel, [&](int around, float share) {
        const Fragment& other = scratch_.pixels[around].nearest;
        if (!(other.channel[kWeight] > 0)) return;
        // The mean of each pixel counts by the share alone.
        const float part = share / other.channel[kWeight];
        for (int c = 0; c <= kNormalZ; ++c) {
          if (c != kTag) out.nearest.channel[c] += part * other.channel[c];
        }
      });
    }
    scratch_.pixels.swap(scratch_.filtered);
  }

  void filter_layers() {
    scratch_.filtered = scratch_.pixels;
    for (int pixel = 0; pixel < kTilePixels; ++pixel) {
      if (!(scratch_.pixels[pixel].layers > 0)) continue;
      float layers = 0;
      float shares = 0;
      for_each_around(tile_, pixel, [&](int around, float share) {
        const float other = scratch_.pixels[around].layers;
        if (!(other > 0)) return;
        layers += share * other;
        shares += share;
      });
      scratch_.filtered[pixel].layers = layers / shares;
    }
    scratch_.pixels.swap(scratch_.filtered);
  }

  static void add(Fragment& sum, float weight, const Fragment& f) {
    const bool first = sum.channel[kWeight] == 0;
    const float tag = first ? f.channel[kTag] : sum.channel[kTag];
    for (int c = 0; c <= kNormalZ; ++c) sum.channel[c] += weight * f.channel[c];
    sum.channel[kTag] = tag;
  }

  const TileJob& job_;
  const LayerRule& rule_;
  const NearestLayer* masked_;
  const TileABuffer& tile_;
  LayerScratch& scratch_;
  std::uint64_t culled_ = 0;
};

}  // namespace

Fragment BlendedPixel::merged() const {
  if (!(layers > 0)) return {};
  Fragment out = nearest;
  for (const int c : {kNormalX, kNormalY, kNormalZ}) out.channel[c] /= nearest.channel[kWeight];
  out.channel[kWeight] = -layers;
  out.channel[kRed] = color.red;
  out.channel[kGreen] = color.green;
  out.channel[kBlue] = color.blue;
  out.channel[kAlpha] = color.alpha;
  return out;
}

void filter_normals(TileABuffer& tile, LayerScratch& scratch) {
  const auto sum_at = [&](int pixel) {
    return Vec3f(tile.at(0, kNormalX, pixel), tile.at(0, kNormalY, pixel),
                 tile.at(0, kNormalZ, pixel));
  };
  scratch.normals.resize(kTilePixels);
  for (int pixel = 0; pixel < kTilePixels; ++pixel) {
    const float weight = tile.at(0, kWeight, pixel);
    if (!(weight > 0)) continue;
    const Vec3f own = sum_at(pixel);
    Vec3f sum(0, 0, 0);
    float weights = 0;
    for_each_around(tile, pixel, [&](int around, float share) {
      const Vec3f other = sum_at(around);
      if (!alike(own, other) && around != pixel) return;
      sum += share * other;
      weights += share * tile.at(0, kWeight, around);
    });
    scratch.normals[pixel] = weight / weights * sum;
  }
  for (int pixel = 0; pixel < kTilePixels; ++pixel) {
    if (!(tile.at(0, kWeight, pixel) > 0)) continue;
    for (int c = 0; c < 3; ++c) tile.at(0, kNormalX + c, pixel) = scratch.normals[pixel][c];
  }
}

std::uint64_t blend_layers(const TileJob& job, const LayerRule& rule, int groups,
                           const NearestLayer* masked, const TileABuffer& weights,
                           LayerScratch& scratch) {
  return Blender(job, rule, masked, weights, scratch).run(groups);
}

}  // namespace surfel
#endif
