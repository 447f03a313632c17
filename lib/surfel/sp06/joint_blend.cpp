// Zhang, Pajarola, "Single-Pass Point Rendering and Transparent Shading", 2006: Algorithm 2.

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include <surfel/base/function_ref.h>
#include <surfel/render/shading.h>
#include <surfel/sp06/joint_blend.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/sp06/joint_blend.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <surfel/base/fused-inl.h>

// After the above, which decides on the target.
#include <surfel/render/kernel_raster-inl.h>
#include <surfel/sp06/layer_parts-inl.h>

#ifndef SURFEL_SP06_JOINT_BLEND_ONCE
#define SURFEL_SP06_JOINT_BLEND_ONCE
namespace surfel {
namespace {

/// Planes of kPatchPixels floats of a group's image in a patch.
enum JointImageChannel : int {
  kImageColor = 0,    ///< R G B A of the layers that have been blended.
  kImageTouched = 4,  ///< Share of the pixel that these cover.
  // The nearest layer, which is not blended where there is an environment.
  kImageEntry = 5,  ///< As JointLayers::kMemberEntry; 0: there is none.
  kImageCoverage,   ///< Share of the pixel that it covers.
  kImageDepth,
  kImageKey,  ///< As JointLayers::kMemberKey.
  kImageChannels
};

}  // namespace
}  // namespace surfel
#endif

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {
namespace {

/// Tells the layers of a tile.
class JointRaster {
 public:
  JointRaster(const TileABuffer& tile, JointScratch& scratch)
      : tile_(tile),
        hidden_(scratch.hidden.planes.data()),
        layers_(scratch.layers),
        holes_(scratch.holes) {}

  /// Makes layers of the surface's discs. Returns how many fragments were culled.
  std::uint64_t make(const TileJob& discs) const {
    constexpr std::ptrdiff_t kBatch = 32;  // Its contributions stay in the first-level cache.
    const KernelRaster raster(discs, tile_.x0, tile_.y0);
    std::uint64_t culled = 0;
    raster.for_each_vector(0, discs.count, nullptr, [&](const PixelSplats& list) HWY_ATTR {
      Contribution batch[kBatch];
      for (const std::uint32_t* begin = list.begin; begin < list.end; begin += kBatch) {
        const std::uint32_t* end = begin + std::min(kBatch, list.end - begin);
        std::size_t left = evaluate(discs, raster, list, begin, end, batch);
        for (int layer = 0; left > 0; ++layer) {
          if (layer == layers_.count(list.pixel)) layers_.add(list.pixel);
          left = join(discs, layers_.at(layer, list.pixel), batch, left, culled);
        }
      }
    });
    end();
    return culled;
  }

  /// Fills the places that groups leave in layers.
  void fill(const TileJob& added) {
    const D d;
    const KernelRaster raster(added, tile_.x0, tile_.y0);
    const V cutoff = hn::Set(d, added.rules->cutoff);
    raster.for_each_vector(0, added.count, nullptr, [&](const PixelSplats& list) HWY_ATTR {
      if (!find_holes(list.pixel)) return;
      const SplatSampler sampler = raster.sampler();
      FragmentCounter fragments;
      for (const std::uint32_t* index = list.begin; index < list.end; ++index) {
        if (holes_[added.groups[*index]] == 0) continue;
        const Sample s = sampler.at(*index, list.x, list.y);
        const M inside = hn::Lt(s.beta, cutoff);
        fragments.add(inside);
        if (!hn::AllFalse(d, inside)) fill_with(added, *index, list.pixel, s, inside);
      }
      raster.count(fragments);
    });
  }

 private:
  /// A splat's contribution to a vector of pixels.
  struct Contribution {
    V rho, depth, epsilon;
    V key;  ///< kNoKey in pixels that it does not add to.
    std::uint32_t splat;
  };

  /// Evaluates the splats [begin, end) where they are seen. Returns the number of contributions.
  HWY_INLINE std::size_t evaluate(const TileJob& job, const KernelRaster& raster,
                                  const PixelSplats& list, const std::uint32_t* begin,
                                  const std::uint32_t* end, Contribution* out) const {
    const D d;
    const SplatSampler sampler = raster.sampler();
    const V x = list.x;
    const V y = list.y;
    const V cutoff = hn::Set(d, job.rules->cutoff);
    const V inv_cutoff = hn::Set(d, 1 / job.rules->cutoff);
    const V none = hn::Set(d, JointLayers::kNoKey);
    FragmentCounter fragments;
    std::size_t left = 0;
    for (; begin < end; ++begin) {
      const Sample s = sampler.at(*begin, x, y);
      const M inside = hn::Lt(s.beta, cutoff);
      fragments.add(inside);
      const M open =
          hn::And(inside, seen_layers(hidden_ + list.pixel, s, job.splats[*begin].tag & kFrontTag));
      Contribution& to = out[left];
      to.rho = hn::Mul(s.amplitude, sampler.decay(s.beta));
      to.depth = s.depth;
      to.epsilon = s.epsilon;
      to.key = hn::IfThenElse(open, hn::Sqrt(hn::Mul(s.beta, inv_cutoff)), none);
      to.splat = *begin;
      left += hn::AllFalse(d, open) ? 0 : 1;
    }
    raster.count(fragments);
    return left;
  }

  /// Adds contributions to a layer where they are of its surface, or it is free. Leaves the others
  /// and returns their number.
  HWY_NOINLINE std::size_t join(const TileJob& job, float* layer, Contribution* batch,
                                std::size_t count, std::uint64_t& culled) const {
    const D d;
    const V none = hn::Set(d, JointLayers::kNoKey);
    const V least = hn::Set(d, kLeastRho);
    V sum = layer_channel(layer, JointLayers::kLayerSum);
    V weighted_depth = layer_channel(layer, JointLayers::kLayerDepth);
    V side = layer_channel(layer, JointLayers::kLayerSide);
    FragmentCounter lost;
    std::size_t left = 0;
    for (std::size_t i = 0; i < count; ++i) {
      // Field by field: as a whole it would go through memory once more.
      const V rho = batch[i].rho;
      const V depth = batch[i].depth;
      const V epsilon = batch[i].epsilon;
      const V key = batch[i].key;
      const std::uint32_t splat = batch[i].splat;
      const V own_side = hn::Set(d, JointLayers::side(job.splats[splat].tag));
      const M open = hn::Lt(key, none);
      const M free = hn::Eq(side, hn::Zero(d));
      // The difference of depths, times the layer's weight, to save the division.
      const V behind = mul_sub(depth, sum, weighted_depth);
      const M near = hn::Lt(hn::Abs(behind), hn::Mul(epsilon, sum));
      const M joins = hn::And(open, hn::Or(free, hn::And(near, hn::Eq(side, own_side))));
      const V weight = hn::IfThenElseZero(joins, hn::Max(rho, least));
      sum = hn::Add(sum, weight);
      weighted_depth = mul_add(weight, depth, weighted_depth);
      side = hn::IfThenElse(hn::And(joins, free), own_side, side);
      float* const group =
          layer + JointLayers::group_channel(job.groups[splat]) * std::size_t{kPatchPixels};
      const V best = layer_channel(group, JointLayers::kMemberKey);
      lost.add(hn::And(joins, hn::Lt(best, none)));
      put_member(group, key, hn::Set(Tags(), splat + 1), hn::And(joins, hn::Lt(key, best)));
      Contribution& to = batch[left];
      to.rho = rho;
      to.depth = depth;
      to.epsilon = epsilon;
      to.key = hn::IfThenElse(joins, none, key);
      to.splat = splat;
      left += hn::AllFalse(d, hn::AndNot(joins, open)) ? 0 : 1;
    }
    const M all = hn::FirstN(d, hn::Lanes(d));
    put_layer_channel(layer, JointLayers::kLayerSum, sum, all);
    put_layer_channel(layer, JointLayers::kLayerDepth, weighted_depth, all);
    put_layer_channel(layer, JointLayers::kLayerSide, side, all);
    culled += lost.total();
    return left;
  }

  HWY_INLINE static void put_member(float* group, V key, Bits entry, M where) {
    put_layer_channel(group, JointLayers::kMemberKey, key, where);
    put_layer_bits(group, JointLayers::kMemberEntry, entry, where);
  }

  /// Turns the sums of depths to means.
  void end() const {
    const D d;
    for (std::size_t pixel = 0; pixel < kTilePixels; pixel += hn::Lanes(d)) {
      for (int i = 0; i < layers_.count(pixel); ++i) {
        float* const layer = layers_.at(i, pixel);
        const V sum = layer_channel(layer, JointLayers::kLayerSum);
        put_layer_channel(layer, JointLayers::kLayerDepth,
                          hn::Div(layer_channel(layer, JointLayers::kLayerDepth), sum),
                          hn::Gt(sum, hn::Zero(d)));
      }
    }
  }

  /// Notes which groups have no fragment of their discs in some layer of a vector of pixels.
  /// Returns whether there are any.
  bool find_holes(std::size_t pixel) {
    const D d;
    bool found = false;
    holes_.assign(static_cast<std::size_t>(layers_.groups()), 0);
    for (int i = 0; i < layers_.count(pixel); ++i) {
      const float* const layer = layers_.at(i, pixel);
      const M used = hn::Gt(layer_channel(layer, JointLayers::kLayerSide), hn::Zero(d));
      for (int group = 0; group < layers_.groups(); ++group) {
        const V key =
            layer_channel(layer, JointLayers::group_channel(group) + JointLayers::kMemberKey);
        const M hole = hn::And(used, hn::Gt(key, hn::Set(d, JointLayers::kAddedKey)));
        if (hn::AllFalse(d, hole)) continue;
        holes_[static_cast<std::size_t>(group)] = 1;
        found = true;
      }
    }
    return found;
  }

  /// Takes a splat's fragments for the layer of its side that lies nearest, if any does within
  /// epsilon.
  HWY_INLINE void fill_with(const TileJob& added, std::uint32_t index, std::size_t pixel,
                            const Sample& s, M inside) const {
    const D d;
    const V own_side = hn::Set(d, JointLayers::side(added.splats[index].tag));
    V least = hn::IfThenElse(inside, s.epsilon, hn::Set(d, -1));
    V nearest = hn::Set(d, -1);
    for (int i = 0; i < layers_.count(pixel); ++i) {
      const float* const layer = layers_.at(i, pixel);
      const V distance = hn::Abs(hn::Sub(s.depth, layer_channel(layer, JointLayers::kLayerDepth)));
      const M nearer = hn::And(hn::Lt(distance, least),
                               hn::Eq(layer_channel(layer, JointLayers::kLayerSide), own_side));
      least = hn::IfThenElse(nearer, distance, least);
      nearest = hn::IfThenElse(nearer, hn::Set(d, static_cast<float>(i)), nearest);
    }
    if (hn::AllTrue(d, hn::Lt(nearest, hn::Zero(d)))) return;
    const V key = hn::Add(hn::Sqrt(hn::Mul(s.beta, hn::Set(d, 1 / added.rules->cutoff))),
                          hn::Set(d, JointLayers::kAddedKey));
    for (int i = 0; i < layers_.count(pixel); ++i) {
      float* const group = layers_.at(i, pixel) + JointLayers::group_channel(added.groups[index]) *
                                                      std::size_t{kPatchPixels};
      const M here = hn::Eq(nearest, hn::Set(d, static_cast<float>(i)));
      const M wins = hn::And(here, hn::Lt(key, layer_channel(group, JointLayers::kMemberKey)));
      if (hn::AllFalse(d, wins)) continue;
      put_member(group, key, hn::Set(Tags(), (index + 1) | JointLayers::kAddedEntry), wins);
    }
  }

  /// Least weight of a fragment in a mean depth: kernels may be 0 at their rim.
  static constexpr float kLeastRho = 1e-12F;

  const TileABuffer& tile_;
  const float* hidden_;
  JointLayers& layers_;
  std::vector<std::uint8_t>& holes_;  ///< By group.
};

/// Blends the layers of a tile.
class JointBlender {
 public:
  JointBlender(const JointJobs& jobs, const TileABuffer& tile, JointScratch& scratch)
      : layers_(scratch.layers),
        left_(scratch.left),
        images_(scratch.images),
        full_(hn::Set(D(), tile.full_weight)),
        pending_(tile.shader->has_environment()),
        discs_(*jobs.discs, tile, scratch.shaded),
        added_(jobs.added ? *jobs.added : *jobs.discs, tile, scratch.shaded_added) {
    images_.resize(static_cast<std::size_t>(layers_.groups()) * kImageChannels * kPatchPixels);
  }

  /// Blends the layers of a vector of pixels, farthest first; where there is an environment, all
  /// but each group's nearest. Returns the number of layers, each counted by its coverage.
  V run(std::size_t pixel) {
    const D d;
    const int count = layers_.count(pixel);
    std::fill(images_.begin(), images_.end(), 0.0F);
    begin(pixel, count);
    V layers = hn::Zero(d);
    for (int i = 0; i < count; ++i) {
      const Farthest farthest = take_farthest(count);
      if (hn::AllFalse(d, farthest.exists)) break;
      const float* const base = layers_.at(0, pixel);
      const auto place = hn::Add(
          hn::Mul(farthest.layer, hn::Set(Ints(), static_cast<std::int32_t>(layers_.stride()))),
          hn::Iota(Ints(), 0));
      const V sum = hn::GatherIndex(d, base + JointLayers::kLayerSum * kPatchPixels, place);
      const V coverage =
          hn::IfThenElseZero(farthest.exists, hn::Min(hn::Div(sum, full_), hn::Set(d, 1)));
      layers = hn::Add(layers, coverage);
      for (int group = 0; group < layers_.groups(); ++group) {
        const float* const member =
            base + JointLayers::group_channel(group) * std::size_t{kPatchPixels};
        const Bits entry = hn::BitCast(
            Tags(), hn::GatherIndex(d, member + JointLayers::kMemberEntry * kPatchPixels, place));
        const M has = hn::And(farthest.exists, any_bit(entry));
        if (hn::AllFalse(d, has)) continue;
        if (!pending_) {
          blend(group, pixel, entry, farthest.depth, coverage, has);
          continue;
        }
        float* const image = this->image(group);
        const Bits before = bits_where(has, layer_bits(image, kImageEntry));
        if (!hn::AllFalse(d, any_bit(before))) {
          blend(group, pixel, before, layer_channel(image, kImageDepth),
                layer_channel(image, kImageCoverage), any_bit(before));
        }
        put_layer_bits(image, kImageEntry, entry, has);
        put_layer_channel(image, kImageCoverage, coverage, has);
        put_layer_channel(image, kImageDepth, farthest.depth, has);
        put_layer_channel(
            image, kImageKey,
            hn::GatherIndex(d, member + JointLayers::kMemberKey * kPatchPixels, place), has);
      }
    }
    return layers;
  }

  /// Stores the means of the groups' images, which are whole, as merged fragments.
  void store(V layers, Fragment* out) {
    const D d;
    LayerColors sum{{hn::Zero(d), hn::Zero(d), hn::Zero(d), hn::Zero(d)}};
    for (int group = 0; group < layers_.groups(); ++group) {
      for (int c = 0; c < 4; ++c) {
        sum.channel[c] = hn::Add(sum.channel[c], layer_channel(image(group), kImageColor + c));
      }
    }
    store_mean(sum, static_cast<float>(layers_.groups()), hn::Gt(layers, hn::Zero(d)), out);
  }

 private:
  /// The farthest of the layers left.
  struct Farthest {
    hn::Vec<Ints> layer;
    V depth;
    M exists;
  };

  float* image(int group) {
    return images_.data() + static_cast<std::size_t>(group) * kImageChannels * kPatchPixels;
  }

  void begin(std::size_t pixel, int count) {
    const D d;
    left_.resize(static_cast<std::size_t>(count) * kPatchPixels);
    for (int i = 0; i < count; ++i) {
      const float* const layer = layers_.at(i, pixel);
      const M free = hn::Eq(layer_channel(layer, JointLayers::kLayerSide), hn::Zero(d));
      hn::Store(hn::IfThenElse(free, hn::Set(d, std::numeric_limits<float>::infinity()),
                               layer_channel(layer, JointLayers::kLayerDepth)),
                d, left_.data() + i * kPatchPixels);
    }
  }

  HWY_INLINE Farthest take_farthest(int count) {
    const D d;
    const V none = hn::Set(d, std::numeric_limits<float>::infinity());
    Farthest out{hn::Zero(Ints()), none, hn::FirstN(d, 0)};
    for (int i = 0; i < count; ++i) {
      const V depth = hn::Load(d, left_.data() + i * kPatchPixels);
      const M farther = hn::Lt(depth, out.depth);
      out.depth = hn::IfThenElse(farther, depth, out.depth);
      out.layer = hn::IfThenElse(hn::RebindMask(Ints(), farther), hn::Set(Ints(), i), out.layer);
    }
    out.exists = hn::Lt(out.depth, none);
    for (int i = 0; i < count; ++i) {
      const M taken = hn::RebindMask(d, hn::Eq(out.layer, hn::Set(Ints(), i)));
      hn::BlendedStore(none, taken, d, left_.data() + i * kPatchPixels);
    }
    return out;
  }

  /// Blends fragments over a group's image.
  HWY_INLINE void blend(int group, std::size_t pixel, Bits entry, V depth, V coverage, M lanes) {
    const D d;
    const LayerColors color = colors(pixel, entry, depth, lanes);
    float* const to = image(group);
    const V share = hn::IfThenElseZero(lanes, coverage);
    const V left = neg_mul_add(share, color.channel[3], hn::Set(d, 1));
    for (int c = 0; c < 4; ++c) {
      const V old = layer_channel(to, kImageColor + c);
      hn::Store(mul_add(share, hn::IfThenElseZero(lanes, color.channel[c]), hn::Mul(left, old)), d,
                to + (kImageColor + c) * kPatchPixels);
    }
    const V touched = layer_channel(to, kImageTouched);
    hn::Store(mul_add(share, hn::Sub(hn::Set(d, 1), touched), touched), d,
              to + kImageTouched * kPatchPixels);
  }

  /// Colours of the entries of some lanes.
  HWY_INLINE LayerColors colors(std::size_t pixel, Bits entry, V depth, M lanes) const {
    const D d;
    const auto added_flag = hn::Set(Tags(), JointLayers::kAddedEntry);
    const M added = hn::And(lanes, any_bit(hn::And(entry, added_flag)));
    const M surface = hn::AndNot(added, lanes);
    const Bits index = hn::Sub(hn::AndNot(added_flag, entry), hn::Set(Tags(), 1));
    const auto of = [&](const LayerShading& shading, M where) HWY_ATTR {
      return shading.colors(pixel, bits_where(where, index), depth, where);
    };
    if (hn::AllFalse(d, added)) return of(discs_, surface);
    LayerColors out = of(added_, added);
    if (hn::AllFalse(d, surface)) return out;
    const LayerColors others = of(discs_, surface);
    for (int c = 0; c < 4; ++c) {
      out.channel[c] = hn::IfThenElse(added, out.channel[c], others.channel[c]);
    }
    return out;
  }

  JointLayers& layers_;
  Array<float>& left_;
  Array<float>& images_;
  const V full_;
  const bool pending_;
  const LayerShading discs_, added_;
};

}  // namespace

std::uint64_t tell_layers_simd(const JointJobs& jobs, const TileABuffer& tile,
                               JointScratch& scratch) {
  JointRaster raster(tile, scratch);
  const std::uint64_t culled = raster.make(*jobs.discs);
  if (jobs.added) raster.fill(*jobs.added);
  return culled;
}

/// Blends the layers into scratch.merged; where there is an environment, calls take(first pixel,
/// number of pixels, layers) for vectors of pixels, of which only the nearest layers are left to
/// blend.
void blend_layers_simd(const JointJobs& jobs, const TileABuffer& tile, JointScratch& scratch,
                       FunctionRef<void(std::size_t, std::size_t, const float*)> take) {
  const D d;
  JointBlender blender(jobs, tile, scratch);
  for (std::size_t pixel = 0; pixel < kTilePixels; pixel += hn::Lanes(d)) {
    if (!tile.shader->has_environment()) {
      if (scratch.layers.count(pixel) == 0) continue;
      const V layers = blender.run(pixel);
      blender.store(layers, scratch.merged.data() + pixel);
      continue;
    }
    HWY_ALIGN float layers[kTileSize];
    hn::Store(blender.run(pixel), d, layers);
    take(pixel, hn::Lanes(d), layers);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {
namespace {

HWY_EXPORT(tell_layers_simd);
HWY_EXPORT(blend_layers_simd);

/// Collects the groups' images of single pixels, where there is an environment.
class JointCollector {
 public:
  JointCollector(const JointJobs& jobs, const TileABuffer& tile, PictureLayers& picture,
                 JointScratch& scratch)
      : jobs_(jobs), tile_(tile), picture_(picture), scratch_(scratch) {}

  void take(std::size_t first, std::size_t count, const float* layers) {
    for (std::size_t lane = 0; lane < count; ++lane) {
      const auto pixel = static_cast<int>(first + lane);
      const int x = tile_pixel_x(pixel);
      const int y = tile_pixel_y(pixel);
      if (x < tile_.width && y < tile_.height) {
        picture_.nearest(tile_.x0 + x, tile_.y0 + y) = collect(lane);
        picture_.layers(tile_.x0 + x, tile_.y0 + y) = layers[lane];
      }
      scratch_.groups.end_pixel(first + lane);
    }
  }

 private:
  /// Adds the groups that have a layer. Returns the sum over their nearest.
  PictureLayers::Surface collect(std::size_t lane) {
    PictureLayers::Surface surface{0, Vec3f(0, 0, 0)};
    for (int group = 0; group < scratch_.layers.groups(); ++group) {
      const float* const image = scratch_.images.data() + lane +
                                 static_cast<std::size_t>(group) * kImageChannels * kPatchPixels;
      const auto at = [&](int channel) { return image[channel * kPatchPixels]; };
      const auto entry = std::bit_cast<std::uint32_t>(at(kImageEntry));
      if (entry == 0) continue;
      const bool added = (entry & JointLayers::kAddedEntry) != 0;
      const TileJob& job = added ? *jobs_.added : *jobs_.discs;
      const std::uint32_t splat = (entry & ~JointLayers::kAddedEntry) - 1;
      const float covered = at(kImageCoverage);
      const auto part = [&](float share) {
        return Rgba{share * at(0), share * at(1), share * at(2), share * at(3)};
      };
      scratch_.groups.groups.push_back({layer_fragment(job, splat, at(kImageDepth)), part(covered),
                                        part(1 - covered), covered,
                                        covered + (1 - covered) * at(kImageTouched)});
      const float weight = nearest_weight(at(kImageKey) - (added ? JointLayers::kAddedKey : 0));
      const SplatNormal& normal = job.normals[splat];
      surface.weight += weight;
      surface.normal += weight * Vec3f(normal.x, normal.y, normal.z);
    }
    return surface;
  }

  const JointJobs& jobs_;
  const TileABuffer& tile_;
  PictureLayers& picture_;
  JointScratch& scratch_;
};

}  // namespace

std::uint64_t blend_joint_layers(const JointJobs& jobs, PictureLayers& picture,
                                 const NearestLayer* masked, const TileABuffer& tile,
                                 JointScratch& scratch) {
  scratch.layers.reset(picture.groups());
  scratch.hidden.set(tile, masked);
  scratch.merged.assign(kTilePixels, Fragment{});
  scratch.groups.clear();
  if (tile.shader->has_environment()) {
    scratch.shaded.reserve(*jobs.discs);
    if (jobs.added) scratch.shaded_added.reserve(*jobs.added);
  }
  const std::uint64_t culled = HWY_DYNAMIC_DISPATCH(tell_layers_simd)(jobs, tile, scratch);
  JointCollector collector(jobs, tile, picture, scratch);
  HWY_DYNAMIC_DISPATCH(blend_layers_simd)
  (jobs, tile, scratch, [&](std::size_t first, std::size_t count, const float* layers) {
    collector.take(first, count, layers);
  });
  if (tile.shader->has_environment()) merge_groups(scratch.groups, tile, picture, scratch.merged);
  return culled;
}

}  // namespace surfel
#endif
