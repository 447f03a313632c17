// SP06 sections 3.3 and 5.2 for a vector of fragments at a time: the parts that both ways of
// telling layers share. Included once for each target, see Highway's documentation.

#if defined(SURFEL_SP06_LAYER_PARTS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SURFEL_SP06_LAYER_PARTS_INL_H_
#undef SURFEL_SP06_LAYER_PARTS_INL_H_
#else
#define SURFEL_SP06_LAYER_PARTS_INL_H_
#endif

#include <cstddef>
#include <cstdint>

#include <hwy/highway.h>
#include <surfel/render/kernel_raster-inl.h>
#include <surfel/render/lamps-inl.h>
#include <surfel/render/shading.h>
#include <surfel/sp06/layer_parts.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {

using Bits = hn::Vec<Tags>;

/// A vector of pixels of a layer's channel.
HWY_INLINE V layer_channel(const float* layer, int channel) {
  return hn::Load(D(), layer + channel * kPatchPixels);
}
HWY_INLINE Bits layer_bits(const float* layer, int channel) {
  return hn::BitCast(Tags(), layer_channel(layer, channel));
}
HWY_INLINE void put_layer_channel(float* layer, int channel, V value, M where) {
  hn::BlendedStore(value, where, D(), layer + channel * kPatchPixels);
}
HWY_INLINE void put_layer_bits(float* layer, int channel, Bits bits, M where) {
  put_layer_channel(layer, channel, hn::BitCast(D(), bits), where);
}
HWY_INLINE M any_bit(Bits bits) { return hn::RebindMask(D(), hn::Ne(bits, hn::Zero(Tags()))); }
HWY_INLINE Bits bits_where(M where, Bits bits) {
  return hn::IfThenElseZero(hn::RebindMask(Tags(), where), bits);
}

/// The fragments that are not hidden.
/// \param hidden  the first pixel's depth in HiddenLayers.
HWY_INLINE M seen_layers(const float* hidden, const Sample& s, std::uint32_t side) {
  const D d;
  const V depth = hn::Load(d, hidden);
  const M same_side =
      hn::Eq(hn::Load(d, hidden + kTilePixels), hn::Set(d, static_cast<float>(side)));
  const M reaches = hn::And(same_side, hn::Ge(hn::Add(s.depth, s.epsilon), depth));
  return hn::Not(hn::Or(hn::Ge(s.depth, depth), reaches));
}

/// Premultiplied colours of a vector of pixels.
struct LayerColors {
  V channel[4];  ///< R G B A.
};

/// Colours the fragments of layers.
class LayerShading {
 public:
  LayerShading(const TileJob& job, const TileABuffer& tile, ShadedSplats& shaded)
      : job_(job), tile_(tile), shader_(*tile.shader), shaded_(shaded) {}

  /// Colours of the fragments of some lanes, each of another splat.
  HWY_INLINE LayerColors colors(std::size_t pixel, Bits splats, V depth, M lanes) const {
    if (shader_.has_environment()) return reflecting(pixel, splats, depth, lanes);
    const auto place = hn::ShiftLeft<kSplatShift>(hn::BitCast(Ints(), splats));
    const auto* const fields = reinterpret_cast<const float*>(job_.splats);
    const LayerColors plain = gather(fields + offsetof(Splat, red) / sizeof(float), place);
    if (!shader_.lit()) return plain;
    return lit(pixel, splats, depth, lanes, plain);
  }

 private:
  /// Four floats from each of some places.
  static HWY_INLINE LayerColors gather(const float* from, hn::Vec<Ints> place) {
    const D d;
    return {{hn::GatherIndex(d, from, place), hn::GatherIndex(d, from + 1, place),
             hn::GatherIndex(d, from + 2, place), hn::GatherIndex(d, from + 3, place)}};
  }

  /// Lights fragments where there is no environment.
  HWY_NOINLINE LayerColors lit(std::size_t pixel, Bits splats, V depth, M lanes,
                               const LayerColors& plain) const {
    const D d;
    const V zero = hn::Zero(d);
    const auto splat = hn::BitCast(Ints(), splats);
    const auto* const fields = reinterpret_cast<const float*>(job_.splats);
    const auto* const normals = reinterpret_cast<const float*>(job_.normals);
    const auto normal = hn::Mul(splat, hn::Set(Ints(), sizeof(SplatNormal) / sizeof(float)));
    const V alpha = plain.channel[3];
    const Fragments at{
        hn::Set(d, 1),
        depth,
        {plain.channel[0], plain.channel[1], plain.channel[2]},
        alpha,
        hn::GatherIndex(d, fields + offsetof(Splat, tag) / sizeof(float),
                        hn::ShiftLeft<kSplatShift>(splat)),
        {hn::GatherIndex(d, normals, normal), hn::GatherIndex(d, normals + 1, normal),
         hn::GatherIndex(d, normals + 2, normal)}};
    const Lamps lamps(*shader_.lighting(), tile_);
    V3 color{zero, zero, zero};
    // A fragment without a colour of its own is not seen.
    M open = hn::And(lanes, hn::Gt(alpha, zero));
    for (std::intptr_t first; (first = hn::FindFirstTrue(d, open)) >= 0;) {
      const std::uint32_t tag =
          hn::ExtractLane(hn::BitCast(Tags(), at.tag), static_cast<std::size_t>(first));
      const M same = hn::And(open, of_material(at.tag, tag));
      color = select(same, alpha * lamps.light(at, pixel, lamps.material(tag)), color);
      open = hn::AndNot(same, open);
    }
    return {{color.x, color.y, color.z, alpha}};
  }

  /// Shades fragments that reflect an environment.
  HWY_NOINLINE LayerColors reflecting(std::size_t pixel, Bits splats, V depth, M lanes) const {
    const D d;
    HWY_ALIGN std::uint32_t indices[kTileSize];
    HWY_ALIGN float taken[kTileSize];
    HWY_ALIGN float depths[kTileSize];
    hn::Store(splats, Tags(), indices);
    hn::Store(hn::IfThenElseZero(lanes, hn::Set(d, 1)), d, taken);
    hn::Store(depth, d, depths);
    for (std::size_t lane = 0; lane < hn::Lanes(d); ++lane) {
      if (taken[lane] == 0) continue;
      shade(indices[lane], static_cast<int>(pixel + lane), depths[lane]);
    }
    return gather(&shaded_.colors.front().red, hn::ShiftLeft<2>(hn::BitCast(Ints(), splats)));
  }

  /// Shades a splat at its centre, once a load, as it is flat and its pixels' colours hardly
  /// differ. Splats with an exact kernel, which are large and whose centre is not known, are shaded
  /// anew for every pixel.
  void shade(std::uint32_t index, int pixel, float depth) const {
    const Splat& splat = job_.splats[index];
    const bool exact = splat.k < 0;
    if (!exact && shaded_.loads[index] == job_.load) return;
    shaded_.loads[index] = job_.load;
    const float x = static_cast<float>(tile_.x0 + tile_pixel_x(pixel)) + 0.5F;
    const float y = static_cast<float>(tile_.y0 + tile_pixel_y(pixel)) + 0.5F;
    const Fragment fragment = layer_fragment(job_, index, exact ? depth : splat.depth);
    shaded_.colors[index] = shader_.shade(fragment, exact ? x : splat.x, exact ? y : splat.y, 1);
  }

  const TileJob& job_;
  const TileABuffer& tile_;
  const Shader& shader_;
  ShadedSplats& shaded_;
};

/// Stores a vector of pixels without an environment as merged fragments.
/// \param color  sums over `groups` groups' pixels.
HWY_INLINE void store_mean(const LayerColors& color, float groups, M touched, Fragment* out) {
  const D d;
  HWY_ALIGN float values[4][kTileSize];
  for (int c = 0; c < 4; ++c) {
    hn::Store(hn::Div(color.channel[c], hn::Set(d, groups)), d, values[c]);
  }
  HWY_ALIGN float weights[kTileSize];
  hn::Store(hn::IfThenElseZero(touched, hn::Set(d, -1)), d, weights);
  for (std::size_t lane = 0; lane < hn::Lanes(d); ++lane) {
    float* const channel = out[lane].channel;
    channel[kWeight] = weights[lane];
    for (int c = 0; c < 4; ++c) channel[kRed + c] = values[c][lane];
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#endif
