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

/// Calls take(splat's index, the splat's fragment) for all fragments of a tile; the fragments of a
/// pixel come in the job's order of splats.
void for_each_fragment_simd(
    const TileJob& job, int x0, int y0,
    FunctionRef<void(std::uint32_t index, const LayerFragment& fragment)> take) {
  const D d;
  const KernelRaster raster(job, x0, y0);
  const V cutoff = hn::Set(d, job.rules->cutoff);
  const V inv_cutoff = hn::Set(d, 1 / job.rules->cutoff);
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
using State = LayerScratch::State;

/// Weight of a nearest fragment at its splat's rim, where a fragment at the centre has 1. It is not
/// 0, so that a pixel without other fragments has a normal.
constexpr float kLeastWeight = 1e-3F;

/// Calls visit(pixel of the tile, x, y) for the tile's pixels in the picture.
template <class Visit>
void for_each_pixel(const TileABuffer& tile, const Visit& visit) {
  for (int pixel = 0; pixel < kTilePixels; ++pixel) {
    const int x = tile_pixel_x(pixel);
    const int y = tile_pixel_y(pixel);
    if (x < tile.width && y < tile.height) visit(pixel, tile.x0 + x, tile.y0 + y);
  }
}

class Blender {
 public:
  Blender(const TileJob& job, const LayerRule& rule, const NearestLayer* masked,
          const TileABuffer& tile, LayerScratch& scratch)
      : job_(job), rule_(rule), masked_(masked), tile_(tile), scratch_(scratch) {}

  std::uint64_t run(PictureLayers& picture) {
    groups_ = picture.groups();
    scratch_.states.assign(static_cast<std::size_t>(groups_) * kTilePixels, State{});
    scratch_.merged.assign(kTilePixels, Fragment{});
    scratch_.order.assign(std::make_reverse_iterator(job_.order + job_.count),
                          std::make_reverse_iterator(job_.order));
    scratch_.order.resize(job_.count + kTileSize);
    TileJob back_to_front = job_;
    back_to_front.order = scratch_.order.data();
    HWY_DYNAMIC_DISPATCH(for_each_fragment_simd)
    (back_to_front, tile_.x0, tile_.y0,
     [&](std::uint32_t index, const LayerFragment& fragment) { take(index, fragment); });
    const bool environment = tile_.shader->has_environment();
    if (environment) {
      for_each_pixel(tile_, [&](int pixel, int x, int y) {
        sum_nearest(pixel, picture.nearest(x, y), picture.layers(x, y));
      });
    }
    for_each_pixel(tile_, [&](int pixel, int x, int y) {
      collect_groups(pixel);
      if (environment && picture.at_border(x, y)) {
        picture.keep(x, y, scratch_.groups);
      } else {
        scratch_.merged[pixel] = picture.merged(*tile_.shader, x, y, scratch_.groups);
      }
    });
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
        // The splat's centre lies in front of the layer behind, but this fragment does not.
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
      // The layer is over, and so are the other side's layers behind it.
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

  Rgba shaded(std::uint32_t index, int pixel, float depth) const {
    return tile_.shader->shade(fragment(index, depth),
                               static_cast<float>(tile_.x0 + tile_pixel_x(pixel)) + 0.5F,
                               static_cast<float>(tile_.y0 + tile_pixel_y(pixel)) + 0.5F, 1);
  }

  /// Blends all pending layers except the nearest one, which is returned; null if none is pending.
  const Pending* nearest(State& s, int pixel) {
    Pending& back = s.side[0];
    Pending& front = s.side[1];
    if (back.splat >= 0 && front.splat >= 0)
      flush(s, back.depth > front.depth ? front : back, pixel);
    if (back.splat >= 0) return &back;
    return front.splat >= 0 ? &front : nullptr;
  }

  /// The groups' nearest layers together, and the number of the pixel's layers.
  void sum_nearest(int pixel, PictureLayers::Surface& surface, float& layers) {
    surface = {0, Vec3f(0, 0, 0)};
    std::vector<int>& counts = scratch_.counts;
    counts.clear();
    for (int group = 0; group < groups_; ++group) {
      State& s = state(group, pixel);
      const Pending* near = nearest(s, pixel);
      counts.push_back(s.layers + (near ? 1 : 0));
      if (!near) continue;
      // Fragments count most near their splat's centre and nothing at its rim: the groups' splats
      // are flat, and the mean normal and the refracted light are to have no steps there.
      const float inside = 1 - near->key * near->key;
      const float weight = std::max(kLeastWeight, inside * inside);
      const SplatNormal& normal = job_.normals[near->splat];
      surface.weight += weight;
      surface.normal += weight * Vec3f(normal.x, normal.y, normal.z);
    }
    layers = mean_count(counts);
  }

  /// The mean number of layers of the groups, without the quarter of the groups that has the fewest
  /// and the quarter that has the most: a single large disc that sticks out of a bent surface is a
  /// layer more, and refraction by one layer more goes elsewhere. Where this mean is 0, all groups
  /// are taken.
  static float mean_count(std::vector<int>& counts) {
    const auto groups = static_cast<std::ptrdiff_t>(counts.size());
    const std::ptrdiff_t cut = groups / 4;
    if (cut > 0) std::sort(counts.begin(), counts.end());
    const auto mean = [&](std::ptrdiff_t left_out) {
      const int sum = std::accumulate(counts.begin() + left_out, counts.end() - left_out, 0);
      return static_cast<float>(sum) / static_cast<float>(groups - 2 * left_out);
    };
    const float inner = mean(cut);
    return inner > 0 ? inner : mean(0);
  }

  void collect_groups(int pixel) {
    scratch_.groups.clear();
    for (int group = 0; group < groups_; ++group) {
      State& s = state(group, pixel);
      const Pending* near = nearest(s, pixel);
      if (!near) continue;
      scratch_.groups.push_back(
          {fragment(static_cast<std::uint32_t>(near->splat), near->depth), s.color});
    }
  }

  const TileJob& job_;
  const LayerRule& rule_;
  const NearestLayer* masked_;
  const TileABuffer& tile_;
  LayerScratch& scratch_;
  int groups_ = 0;
  std::uint64_t culled_ = 0;
};

}  // namespace

void filter_surfaces(TileABuffer& tile, PictureLayers& picture) {
  const auto normal_at = [&](int pixel) {
    return tile.fragment(0, pixel) + kNormalX * kPatchPixels;
  };
  for_each_pixel(tile, [&](int pixel, int x, int y) {
    const float* normal = normal_at(pixel);
    picture.surface(x, y) = {tile.at(0, kWeight, pixel),
                             Vec3f(normal[0], normal[kPatchPixels], normal[2 * kPatchPixels])};
  });
  for_each_pixel(tile, [&](int pixel, int x, int y) {
    if (!(tile.at(0, kWeight, pixel) > 0) || picture.at_border(x, y)) return;
    const Vec3f filtered = picture.filtered_normal(x, y);
    for (int c = 0; c < 3; ++c) normal_at(pixel)[c * kPatchPixels] = filtered[c];
  });
}

std::uint64_t blend_layers(const TileJob& job, const LayerRule& rule, PictureLayers& picture,
                           const NearestLayer* masked, const TileABuffer& tile,
                           LayerScratch& scratch) {
  return Blender(job, rule, masked, tile, scratch).run(picture);
}

}  // namespace surfel
#endif
