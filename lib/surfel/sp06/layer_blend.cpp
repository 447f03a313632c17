// Zhang, Pajarola, "Single-Pass Point Rendering and Transparent Shading", 2006: Algorithm 2.

#include <algorithm>
#include <bit>
#include <cmath>
#include <iterator>
#include <limits>
#include <numeric>

#include <surfel/render/shading.h>
#include <surfel/sp06/layer_blend.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/sp06/layer_blend.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <surfel/base/fused-inl.h>

// After the above, which decides on the target.
#include <surfel/render/kernel_raster-inl.h>
#include <surfel/sp06/layer_parts-inl.h>
#include <surfel/sp06/layer_rule-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {
namespace {

/// Places of the samples from a pixel's centre, pixels: one in each row and each column of a grid.
/// Groups of odd numbers have them mirrored.
constexpr float kSampleX[LayerImages::kSamples] = {-0.125F, 0.375F, -0.375F, 0.125F};
constexpr float kSampleY[LayerImages::kSamples] = {-0.375F, -0.125F, 0.125F, 0.375F};
constexpr float kSampleReach = 0.396F;  ///< No sample is further from the centre.

/// The share of a pixel that some of its samples are.
HWY_INLINE V share_of(Bits samples) {
  const hn::RebindToSigned<D> di;
  return hn::Mul(hn::ConvertTo(D(), hn::BitCast(di, hn::PopulationCount(samples))),
                 hn::Set(D(), 1.0F / LayerImages::kSamples));
}

/// Draws the splats of a tile, farthest first, into the images of their groups.
class LayerRaster {
 public:
  LayerRaster(const TileJob& job, const LayerRule& rule, const TileABuffer& tile,
              LayerScratch& scratch)
      : job_(job),
        rule_(rule),
        shading_(job, tile, scratch.shaded),
        images_(scratch.images),
        hidden_(scratch.hidden.planes.data()),
        raster_(job, tile.x0, tile.y0) {}

  /// Returns how many fragments were culled.
  std::uint64_t run() {
    raster_.for_each_vector(0, job_.count, nullptr, [&](const PixelSplats& list) HWY_ATTR {
      const SplatSampler sampler = raster_.sampler();
      FragmentCounter fragments;
      for (const std::uint32_t* index = list.begin; index < list.end; ++index) {
        const Sample s = sampler.at(*index, list.x, list.y);
        const Bits samples = samples_of(sampler, *index, list.x, list.y, s.beta);
        const M covered = any_bit(samples);
        fragments.add(covered);
        if (!hn::AllFalse(D(), covered)) take(*index, list.pixel, s, samples);
      }
      raster_.count(fragments);
    });
    return culled_;
  }

  /// Blends the layers that are pending, all or all but every group's nearest.
  void finish(bool all) {
    for (int group = 0; group < images_.groups(); ++group) {
      for (std::size_t pixel = 0; pixel < kTilePixels; pixel += hn::Lanes(D())) {
        if (images_.used(group, pixel)) finish(images_.at(group, pixel), pixel, all);
      }
    }
  }

 private:
  /// The samples of pixels that a splat's disc covers.
  /// \param beta  the pixels' own.
  HWY_INLINE Bits samples_of(const SplatSampler& sampler, std::uint32_t index, V x, V y,
                             V beta) const {
    const D d;
    const V cutoff = hn::Set(d, job_.rules->cutoff);
    // Most vectors lie inside of the disc, or outside. The root of beta is a norm, which grows by
    // no more than this between a pixel's centre and its samples.
    const Splat& splat = job_.splats[index];
    const V root = hn::Sqrt(beta);
    const float largest = splat.k * (1 + splat.m * splat.m) + splat.q;  // Bounds the eigenvalues.
    const float step = kSampleReach * std::sqrt(largest);
    const float rim = std::sqrt(job_.rules->cutoff);
    const M inside = hn::Lt(root, hn::Set(d, rim - step));
    const M outside = hn::Gt(root, hn::Set(d, rim + step));
    if (splat.k >= 0 && !sampler.is_clipped(index) && hn::AllTrue(d, hn::Or(inside, outside))) {
      return bits_where(inside, hn::Set(Tags(), (1U << LayerImages::kSamples) - 1));
    }
    const float mirrored = (job_.groups[index] & 1) != 0 ? -1.0F : 1.0F;
    Bits samples = hn::Zero(Tags());
    for (int i = 0; i < LayerImages::kSamples; ++i) {
      const V at_sample = sampler
                              .at(index, hn::Add(x, hn::Set(d, mirrored * kSampleX[i])),
                                  hn::Add(y, hn::Set(d, kSampleY[i])))
                              .beta;
      samples = hn::Or(samples, bits_where(hn::Lt(at_sample, cutoff), hn::Set(Tags(), 1U << i)));
    }
    return samples;
  }

  HWY_INLINE M same_layer(V depth, V other, V epsilon) const {
    const D d;
    switch (rule_.voronoi) {
      case Voronoi::kOff:
        return hn::FirstN(d, 0);
      case Voronoi::kQuantised:
        return hn::Eq(depth_step(rule_, depth), depth_step(rule_, other));
      case Voronoi::kWindowed:
        break;
    }
    return hn::Lt(hn::Abs(hn::Sub(depth, other)), epsilon);
  }

  HWY_INLINE void take(std::uint32_t index, std::size_t pixel, const Sample& s, Bits covered) {
    using Images = LayerImages;
    const D d;
    const std::uint32_t front = job_.splats[index].tag & kFrontTag;
    const int side = static_cast<int>(front);
    const Bits samples = bits_where(seen_layers(hidden_ + pixel, s, front), covered);
    const M open = any_bit(samples);
    if (hn::AllFalse(d, open)) return;
    float* const image = images_.use(job_.groups[index], pixel);
    const V depth = layer_channel(image, Images::kPendingDepth + side);
    const M pending = hn::And(open, any_bit(layer_bits(image, Images::kEntry + side)));
    const M same = hn::And(pending, same_layer(s.depth, depth, s.epsilon));
    culled_ += hn::CountTrue(d, same);
    const M other = hn::AndNot(same, pending);
    M puts = hn::AndNot(pending, open);
    if (!hn::AllFalse(d, other)) {
      const M behind = hn::And(other, hn::Lt(s.depth, depth));
      if (!hn::AllFalse(d, behind))
        take_behind(image, pixel, index, s, bits_where(behind, samples));
      const M over = hn::AndNot(behind, other);
      end_layer(image, pixel, side, over);
      puts = hn::Or(puts, over);
    }
    const V key = hn::Sqrt(hn::Mul(s.beta, hn::Set(d, 1 / job_.rules->cutoff)));
    const M nearer = hn::Lt(key, layer_channel(image, Images::kKey + side));
    const M wins = hn::Or(puts, hn::And(same, nearer));
    put_layer_channel(image, Images::kPendingDepth + side, s.depth, wins);
    put_layer_channel(image, Images::kKey + side, key, wins);
    put_layer_bits(image, Images::kEntry + side, hn::Set(Tags(), index + 1), wins);
    const Bits before = bits_where(same, layer_bits(image, Images::kPendingSamples + side));
    put_layer_bits(image, Images::kPendingSamples + side, hn::Or(before, samples),
                   hn::Or(puts, same));
  }

  /// Blends a side's pending layers, which are over, and the other side's layers behind them.
  HWY_INLINE void end_layer(float* image, std::size_t pixel, int side, M over) {
    if (hn::AllFalse(D(), over)) return;
    const M first =
        hn::And(hn::And(over, any_bit(layer_bits(image, LayerImages::kEntry + 1 - side))),
                hn::Lt(layer_channel(image, LayerImages::kPendingDepth + 1 - side),
                       layer_channel(image, LayerImages::kPendingDepth + side)));
    flush(image, pixel, 1 - side, first);
    flush(image, pixel, side, over);
  }

  /// Takes fragments whose splat's centre lies in front of the pending layer, but which do not.
  HWY_NOINLINE void take_behind(float* image, std::size_t pixel, std::uint32_t index,
                                const Sample& s, Bits samples) {
    using Images = LayerImages;
    const D d;
    const int side = static_cast<int>(job_.splats[index].tag & kFrontTag);
    const M behind = any_bit(samples);
    const Bits before = layer_bits(image, Images::kBlendedSamples + side);
    const V depth = layer_channel(image, Images::kBlended + side);
    const M same = hn::And(hn::And(behind, any_bit(before)), same_layer(s.depth, depth, s.epsilon));
    culled_ += hn::CountTrue(d, same);
    // Of the layer that has been blended only the samples that it left open are added.
    const Bits added = hn::AndNot(bits_where(same, before), samples);
    const M front = hn::And(behind, hn::Or(hn::Not(any_bit(before)), hn::Ge(s.depth, depth)));
    const M adds = any_bit(added);
    if (!hn::AllFalse(d, adds)) {
      const LayerColors color = shading_.colors(pixel, hn::Set(Tags(), index), s.depth, adds);
      blend<false>(image, color, added, front);
      count(image, added);
    }
    const M next = hn::AndNot(same, front);
    put_layer_channel(image, Images::kBlended + side, s.depth, next);
    put_layer_bits(image, Images::kBlendedSamples + side, hn::Or(bits_where(same, before), samples),
                   hn::Or(next, same));
  }

  /// Blends pending layers of one side.
  HWY_NOINLINE void flush(float* image, std::size_t pixel, int side, M lanes) {
    using Images = LayerImages;
    if (hn::AllFalse(D(), lanes)) return;
    const Bits entry = bits_where(lanes, layer_bits(image, Images::kEntry + side));
    const auto one = hn::Set(Tags(), 1);
    const Bits splat = hn::Sub(hn::Max(entry, one), one);
    const V depth = layer_channel(image, Images::kPendingDepth + side);
    const Bits samples = bits_where(lanes, layer_bits(image, Images::kPendingSamples + side));
    blend<true>(image, shading_.colors(pixel, splat, depth, lanes), samples, lanes);
    count(image, samples);
    put_layer_channel(image, Images::kBlended + side, depth, lanes);
    put_layer_bits(image, Images::kBlendedSamples + side, samples, lanes);
    put_layer_bits(image, Images::kEntry + side, hn::Zero(Tags()), lanes);
  }

  /// Counts layers by the samples that they cover.
  HWY_INLINE static void count(float* image, Bits samples) {
    const M all = hn::FirstN(D(), hn::Lanes(D()));
    const V layers = layer_channel(image, LayerImages::kLayers);
    put_layer_channel(image, LayerImages::kLayers, hn::Add(layers, share_of(samples)), all);
    put_layer_bits(image, LayerImages::kTouched,
                   hn::Or(layer_bits(image, LayerImages::kTouched), samples), all);
  }

  /// Composites colours with some samples of an image, over them, or beneath where not in `over`.
  template <bool kOver>
  HWY_INLINE static void blend(float* image, const LayerColors& color, Bits samples, M over) {
    const D d;
    const V one = hn::Set(d, 1);
    for (int i = 0; i < LayerImages::kSamples; ++i) {
      const M covered = any_bit(hn::And(samples, hn::Set(Tags(), 1U << i)));
      float* const sample = image + (LayerImages::kColors + 4 * i) * kPatchPixels;
      const V left = hn::Sub(one, color.channel[3]);
      const V open = hn::Sub(one, layer_channel(sample, 3));
      for (int c = 0; c < 4; ++c) {
        const V old = layer_channel(sample, c);
        V sum = mul_add(left, old, color.channel[c]);
        if constexpr (!kOver) {
          sum = hn::IfThenElse(over, sum, mul_add(open, color.channel[c], old));
        }
        hn::Store(hn::IfThenElse(covered, sum, old), d, sample + c * kPatchPixels);
      }
    }
  }

  void finish(float* image, std::size_t pixel, bool all) {
    const M back = any_bit(layer_bits(image, LayerImages::kEntry));
    const M front = any_bit(layer_bits(image, LayerImages::kEntry + 1));
    const M both = hn::And(back, front);
    const M front_first = hn::Lt(layer_channel(image, LayerImages::kPendingDepth + 1),
                                 layer_channel(image, LayerImages::kPendingDepth));
    flush(image, pixel, 1, hn::And(both, front_first));
    flush(image, pixel, 0, hn::AndNot(front_first, both));
    if (!all) return;
    flush(image, pixel, 0, any_bit(layer_bits(image, LayerImages::kEntry)));
    flush(image, pixel, 1, any_bit(layer_bits(image, LayerImages::kEntry + 1)));
  }

  const TileJob& job_;
  const LayerRule& rule_;
  const LayerShading shading_;
  LayerImages& images_;
  const float* hidden_;
  const KernelRaster raster_;
  std::uint64_t culled_ = 0;
};

/// Averages the groups' images, whose layers are all blended, to merged fragments.
void average(LayerImages& images, std::size_t pixel, Fragment* out) {
  const D d;
  LayerColors sum{{hn::Zero(d), hn::Zero(d), hn::Zero(d), hn::Zero(d)}};
  Bits touched = hn::Zero(Tags());
  for (int group = 0; group < images.groups(); ++group) {
    if (!images.used(group, pixel)) continue;
    const float* const image = images.at(group, pixel);
    touched = hn::Or(touched, layer_bits(image, LayerImages::kTouched));
    for (int i = 0; i < 4 * LayerImages::kSamples; ++i) {
      V& color = sum.channel[i % 4];
      color = hn::Add(color, layer_channel(image, LayerImages::kColors + i));
    }
  }
  store_mean(sum, static_cast<float>(images.groups() * LayerImages::kSamples), any_bit(touched),
             out);
}

}  // namespace

/// Draws a tile's layers. Where there is an environment, the nearest layer of every group is left
/// pending; else `merged` gets the mean of the groups.
std::uint64_t draw_layers_simd(const TileJob& job, const LayerRule& rule, const TileABuffer& tile,
                               LayerScratch& scratch) {
  LayerRaster raster(job, rule, tile, scratch);
  const std::uint64_t culled = raster.run();
  const bool all = !tile.shader->has_environment();
  raster.finish(all);
  if (all) {
    for (std::size_t pixel = 0; pixel < kTilePixels; pixel += hn::Lanes(D())) {
      average(scratch.images, pixel, scratch.merged.data() + pixel);
    }
  }
  return culled;
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {
namespace {

HWY_EXPORT(draw_layers_simd);

using Images = LayerImages;

/// Calls visit(pixel of the tile, x, y) for the tile's pixels in the picture.
template <class Visit>
void for_each_pixel(const TileABuffer& tile, const Visit& visit) {
  for (int pixel = 0; pixel < kTilePixels; ++pixel) {
    const int x = tile_pixel_x(pixel);
    const int y = tile_pixel_y(pixel);
    if (x < tile.width && y < tile.height) visit(pixel, tile.x0 + x, tile.y0 + y);
  }
}

std::uint32_t bits_at(const float* image, int channel) {
  return std::bit_cast<std::uint32_t>(image[channel * kPatchPixels]);
}

float share_of_samples(std::uint32_t samples) {
  return static_cast<float>(std::popcount(samples)) / Images::kSamples;
}

/// Collects the images of a tile's groups where there is an environment.
class Collector {
 public:
  Collector(const TileJob& job, LayerScratch& scratch)
      : job_(job), scratch_(scratch), images_(scratch.images) {}

  void run(const TileABuffer& tile, PictureLayers& picture) {
    scratch_.groups.clear();
    for (int pixel = 0; pixel < kTilePixels; ++pixel) {
      const int x = tile_pixel_x(pixel);
      const int y = tile_pixel_y(pixel);
      if (x < tile.width && y < tile.height) {
        sum_nearest(pixel, picture.nearest(tile.x0 + x, tile.y0 + y),
                    picture.layers(tile.x0 + x, tile.y0 + y));
        collect(pixel);
      }
      scratch_.groups.end_pixel(static_cast<std::size_t>(pixel));
    }
  }

 private:
  /// A group's nearest layer in a pixel.
  struct Nearest {
    const float* image;  ///< The pixel's channels; null: there is no layer.
    int side;
    std::uint32_t splat() const { return bits_at(image, Images::kEntry + side) - 1; }
    std::uint32_t samples() const { return bits_at(image, Images::kPendingSamples + side); }
    float depth() const { return image[(Images::kPendingDepth + side) * kPatchPixels]; }
    float key() const { return image[(Images::kKey + side) * kPatchPixels]; }
  };
  Nearest nearest(int group, int pixel) {
    const auto at = static_cast<std::size_t>(pixel);
    if (!images_.used(group, at)) return {nullptr, 0};
    const float* const image = images_.at(group, at);
    for (const int side : {0, 1}) {
      if (bits_at(image, Images::kEntry + side) != 0) return {image, side};
    }
    return {nullptr, 0};
  }

  /// The groups' nearest layers together, and the number of the pixel's layers.
  void sum_nearest(int pixel, PictureLayers::Surface& surface, float& layers) {
    surface = {0, Vec3f(0, 0, 0)};
    std::vector<float>& counts = scratch_.counts;
    counts.clear();
    for (int group = 0; group < images_.groups(); ++group) {
      const Nearest near = nearest(group, pixel);
      counts.push_back(0);
      if (!near.image) continue;
      const float share = share_of_samples(near.samples());
      counts.back() = near.image[Images::kLayers * kPatchPixels] + share;
      const float weight = share * nearest_weight(near.key());
      const SplatNormal& normal = job_.normals[near.splat()];
      surface.weight += weight;
      surface.normal += weight * Vec3f(normal.x, normal.y, normal.z);
    }
    layers = mean_count(counts);
  }

  /// The mean number of layers of the groups, without the quarter of the groups that has the fewest
  /// and the quarter that has the most: a single large disc that sticks out of a bent surface is a
  /// layer more, and refraction by one layer more goes elsewhere. Where this mean is 0, all groups
  /// are taken.
  static float mean_count(std::vector<float>& counts) {
    const auto groups = static_cast<std::ptrdiff_t>(counts.size());
    const std::ptrdiff_t cut = groups / 4;
    if (cut > 0) std::sort(counts.begin(), counts.end());
    const auto mean = [&](std::ptrdiff_t left_out) {
      const float sum = std::accumulate(counts.begin() + left_out, counts.end() - left_out, 0.0F);
      return sum / static_cast<float>(groups - 2 * left_out);
    };
    const float inner = mean(cut);
    return inner > 0 ? inner : mean(0);
  }

  /// Adds the groups that have a layer in a pixel.
  void collect(int pixel) {
    for (int group = 0; group < images_.groups(); ++group) {
      const Nearest near = nearest(group, pixel);
      if (!near.image) continue;
      PictureLayers::GroupPixel out{layer_fragment(job_, near.splat(), near.depth()), {}, {}, 0, 0};
      const std::uint32_t samples = near.samples();
      out.coverage = share_of_samples(samples);
      out.touched = share_of_samples(samples | bits_at(near.image, Images::kTouched));
      for (int i = 0; i < Images::kSamples; ++i) {
        Rgba& to = (samples >> i & 1U) != 0 ? out.beneath : out.beside;
        const float* const c = near.image + (Images::kColors + 4 * i) * kPatchPixels;
        constexpr float kShare = 1.0F / Images::kSamples;
        to.red += kShare * c[0];
        to.green += kShare * c[kPatchPixels];
        to.blue += kShare * c[2 * kPatchPixels];
        to.alpha += kShare * c[3 * kPatchPixels];
      }
      scratch_.groups.groups.push_back(out);
    }
  }

  const TileJob& job_;
  LayerScratch& scratch_;
  LayerImages& images_;
};

}  // namespace

void LayerImages::reset(int groups) {
  groups_ = groups;
  used_.assign(static_cast<std::size_t>(groups) * (kTilePixels / kPatchPixels), 0);
  data_.resize(used_.size() * kChannels * kPatchPixels);
}

float* LayerImages::use(int group, std::size_t pixel) {
  std::uint8_t& used = used_[place(group, pixel)];
  if (used == 0) {
    used = 1;
    std::fill_n(at(group, pixel) - pixel % kPatchPixels, kChannels * kPatchPixels, 0.0F);
  }
  return at(group, pixel);
}

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
  scratch.images.reset(picture.groups());
  scratch.merged.assign(kTilePixels, Fragment{});
  scratch.order.assign(std::make_reverse_iterator(job.order + job.count),
                       std::make_reverse_iterator(job.order));
  scratch.order.resize(job.count + kTileSize);
  scratch.hidden.set(tile, masked);
  TileJob back_to_front = job;
  back_to_front.order = scratch.order.data();
  if (tile.shader->has_environment()) scratch.shaded.reserve(job);
  const std::uint64_t culled =
      HWY_DYNAMIC_DISPATCH(draw_layers_simd)(back_to_front, rule, tile, scratch);
  if (tile.shader->has_environment()) {
    Collector(job, scratch).run(tile, picture);
    merge_groups(scratch.groups, tile, picture, scratch.merged);
  }
  return culled;
}

}  // namespace surfel
#endif
