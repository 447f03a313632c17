// Zwicker, Pfister, van Baar, Gross, "Surface Splatting", SIGGRAPH 2001: section 6, step 3, and
// (12), for vectors of pixels; included once for each target, see Highway's documentation.

#if defined(SURFEL_RENDER_LAYER_MERGE_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SURFEL_RENDER_LAYER_MERGE_INL_H_
#undef SURFEL_RENDER_LAYER_MERGE_INL_H_
#else
#define SURFEL_RENDER_LAYER_MERGE_INL_H_
#endif

#include <cstddef>

#include <hwy/highway.h>
#include <surfel/render/a_buffer.h>
#include <surfel/render/kernel_raster-inl.h>
#include <surfel/render/shading.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {

/// Whether merge_plainly() can do anything in a tile: fragments need no shading, nothing but
/// fragments is seen behind them, and their coverage does not depend on what is merged in them.
inline bool merges_plainly(const TileABuffer& tile) {
  return !tile.shader->lit() && !tile.shader->has_environment() && !tile.layout.opaque &&
         !tile.layout.clips && tile.layout.layers >= 3;
}

/// Merges a pair of fragments for contributions to a vector of pixels whose layers are all taken,
/// as insert_by_merging() does, in the pixels where the pair is composited in the order of its
/// depths, and the two surfaces cover independent parts of the pixel.
template <bool kNormals>
class PlainMerge {
 public:
  /// \param pixel  the first one of the vector.
  PlainMerge(TileABuffer& tile, std::size_t pixel) : tile_(tile), pixel_(pixel) {}

  /// Returns the pixels of `lanes` in which that has been done.
  HWY_INLINE M insert(M lanes, V rho, V depth, const Splat& splat, const SplatNormal* normal) {
    const D d;
    const V zero = hn::Zero(d);
    const int layers = tile_.layout.layers;
    // How many fragments are nearer than the newcomer, and the nearest ones on either side of it.
    const V infinity = hn::Set(d, __builtin_inff());
    V in_front = zero;
    V before = infinity;
    V behind = hn::Neg(infinity);
    for (int layer = 0; layer < layers; ++layer) {
      const V at = front_depth(layer);
      hn::Store(at, d, depths_[layer]);
      const M nearer = hn::Ge(at, depth);
      in_front = hn::Add(in_front, hn::IfThenElseZero(nearer, hn::Set(d, 1.0F)));
      before = hn::IfThenElse(nearer, hn::Min(before, at), before);
      behind = hn::IfThenElse(nearer, behind, hn::Max(behind, at));
    }
    // The pair is the nearest one where two are nearer than the newcomer, else the farthest one.
    const M nearest = hn::Ge(in_front, hn::Set(d, 2.0F));
    const auto least = hn::Neg(infinity);
    V first = least;
    V second = least;
    V first_layer = zero;
    V second_layer = zero;
    const auto splat_tag = hn::Set(Tags(), splat.tag);
    for (int layer = 0; layer < layers; ++layer) {
      const V at = hn::Load(d, depths_[layer]);
      const V number = hn::Set(d, static_cast<float>(layer));
      const V key = hn::IfThenElse(nearest, at, hn::Neg(at));
      const M is_first = hn::Gt(key, first);
      const M is_second = hn::AndNot(is_first, hn::Gt(key, second));
      second = hn::IfThenElse(is_first, first, hn::IfThenElse(is_second, key, second));
      second_layer =
          hn::IfThenElse(is_first, first_layer, hn::IfThenElse(is_second, number, second_layer));
      first = hn::IfThenElse(is_first, key, first);
      first_layer = hn::IfThenElse(is_first, number, first_layer);
      // A slab of the newcomer's own surface is for insert_by_merging().
      const V weight = channel(layer, kWeight);
      const M beside = hn::Or(hn::Eq(at, before), hn::Eq(at, behind));
      const M incomplete =
          hn::And(hn::Gt(weight, zero), hn::Lt(weight, hn::Set(d, tile_.full_weight)));
      const auto sides = hn::Xor(hn::BitCast(Tags(), channel(layer, kTag)), splat_tag);
      const M same_side =
          hn::RebindMask(d, hn::Eq(hn::And(sides, hn::Set(Tags(), kFrontTag)), hn::Zero(Tags())));
      lanes = hn::AndNot(hn::And(beside, hn::And(incomplete, same_side)), lanes);
    }
    front_layer_ = hn::IfThenElse(nearest, first_layer, second_layer);
    back_layer_ = hn::IfThenElse(nearest, second_layer, first_layer);
    const Seen front(*this, front_layer_);
    const Seen back(*this, back_layer_);
    // Near the silhouette of a body depth may not be the order in which its two sides are seen, and
    // they cover the same part of the pixel.
    const M may_swap = hn::AndNot(front.shows_front, hn::And(back.shows_front, front.loose));
    const M one_body = hn::AndNot(back.shows_front, hn::And(front.shows_front, front.part));
    lanes = hn::AndNot(hn::Or(may_swap, one_body), lanes);
    if (hn::AllFalse(d, lanes)) return lanes;
    store_merged(lanes, front, back);
    store_fresh(lanes, rho, depth, splat, normal);
    tile_.merges.merged += hn::CountTrue(d, lanes);
    return lanes;
  }

 private:
  using Tags = hn::RebindToUnsigned<D>;

  HWY_INLINE V channel(int layer, int c) const {
    return hn::Load(D(), tile_.fragment(layer, pixel_) + c * kPatchPixels);
  }
  HWY_INLINE V front_depth(int layer) const {
    const V weight = channel(layer, kWeight);
    const V depth = channel(layer, kDepth);
    return hn::IfThenElse(hn::Lt(weight, hn::Zero(D())), depth, hn::Div(depth, weight));
  }
  /// The value that `of(layer)` has for the layer that `which` numbers in every pixel.
  template <class Values>
  HWY_INLINE V select_of(V which, const Values& of) const {
    const D d;
    V out = of(0);
    for (int layer = 1; layer < tile_.layout.layers; ++layer) {
      const M here = hn::Eq(which, hn::Set(d, static_cast<float>(layer)));
      out = hn::IfThenElse(here, of(layer), out);
    }
    return out;
  }
  HWY_INLINE V select(V which, int c) const {
    return select_of(which, [&](int layer) HWY_ATTR { return channel(layer, c); });
  }

  /// A fragment of the pair, as it is seen.
  struct Seen {
    V red, green, blue, alpha;  ///< What SS01 (12) composites.
    V front_depth, back_depth, tag;
    V normal[3];
    M shows_front;
    M part;   ///< It does not cover the pixel.
    M loose;  ///< Nor does it, or it is seen at a grazing angle.

    HWY_INLINE Seen(const PlainMerge& from, V layer) {
      const D d;
      const V one = hn::Set(d, 1.0F);
      const V weight = from.select(layer, kWeight);
      const M merged = hn::Lt(weight, hn::Zero(d));
      const V inv_weight = hn::IfThenElse(merged, one, hn::Div(one, weight));
      tag = from.select(layer, kTag);
      const auto flags = [&](std::uint32_t bit) HWY_ATTR {
        const auto of_tag = hn::And(hn::BitCast(Tags(), tag), hn::Set(Tags(), bit));
        return hn::RebindMask(d, hn::Ne(of_tag, hn::Zero(Tags())));
      };
      shows_front = flags(kFrontTag);
      // As in merged() of a_buffer.cpp.
      const V inv_full = hn::IfThenElse(flags(kFilteredTag),
                                        hn::Set(d, 1 / from.tile_.weight_at_edge(kEdgeOfMerged)),
                                        hn::Set(d, 1 / from.tile_.full_weight));
      const V coverage = hn::IfThenElse(merged, one, hn::Min(one, hn::Mul(weight, inv_full)));
      part = hn::Lt(coverage, one);
      loose = hn::Or(part, flags(kGrazingTag));
      const V scale = hn::Mul(inv_weight, coverage);
      red = hn::Mul(from.select(layer, kRed), scale);
      green = hn::Mul(from.select(layer, kGreen), scale);
      blue = hn::Mul(from.select(layer, kBlue), scale);
      alpha = hn::Mul(from.select(layer, kAlpha), scale);
      front_depth =
          from.select_of(layer, [&](int i) HWY_ATTR { return hn::Load(d, from.depths_[i]); });
      back_depth = hn::IfThenElse(merged, from.select(layer, kBack), front_depth);
      if constexpr (kNormals) {
        for (int axis = 0; axis < 3; ++axis) {
          normal[axis] = hn::Mul(from.select(layer, kNormalX + axis), inv_weight);
        }
      }
    }
  };

  /// Stores values of a channel in every pixel's layer of a number.
  HWY_INLINE void store(M lanes, V which, int c, V values) {
    const D d;
    for (int layer = 0; layer < tile_.layout.layers; ++layer) {
      const M here = hn::And(lanes, hn::Eq(which, hn::Set(d, static_cast<float>(layer))));
      hn::BlendedStore(values, here, d, tile_.fragment(layer, pixel_) + c * kPatchPixels);
    }
  }

  HWY_INLINE void store_merged(M lanes, const Seen& front, const Seen& back) {
    const D d;
    const V transmitted = hn::Sub(hn::Set(d, 1.0F), front.alpha);
    const auto put = [&](int c, V values) HWY_ATTR { store(lanes, front_layer_, c, values); };
    const auto over = [&](V a, V b) HWY_ATTR { return mul_add(transmitted, b, a); };
    put(kWeight, hn::Set(d, -1.0F));
    put(kDepth, front.front_depth);
    put(kRed, over(front.red, back.red));
    put(kGreen, over(front.green, back.green));
    put(kBlue, over(front.blue, back.blue));
    put(kAlpha, over(front.alpha, back.alpha));
    put(kTag, front.tag);
    put(kBack, back.back_depth);
    if constexpr (kNormals) {
      for (int axis = 0; axis < 3; ++axis) put(kNormalX + axis, front.normal[axis]);
    }
  }

  HWY_INLINE void store_fresh(M lanes, V rho, V depth, const Splat& splat,
                              const SplatNormal* normal) {
    const D d;
    const auto put = [&](int c, V values) HWY_ATTR { store(lanes, back_layer_, c, values); };
    const auto put_sum = [&](int c, float value)
                             HWY_ATTR { put(c, hn::Mul(rho, hn::Set(d, value))); };
    put(kWeight, rho);
    put(kDepth, hn::Mul(rho, depth));
    put_sum(kRed, splat.red);
    put_sum(kGreen, splat.green);
    put_sum(kBlue, splat.blue);
    put_sum(kAlpha, splat.alpha);
    put(kTag, hn::BitCast(d, hn::Set(Tags(), splat.tag)));
    put(kBack, hn::Zero(d));
    if constexpr (kNormals) {
      put_sum(kNormalX, normal->x);
      put_sum(kNormalY, normal->y);
      put_sum(kNormalZ, normal->z);
    }
  }

  TileABuffer& tile_;
  std::size_t pixel_;
  HWY_ALIGN float depths_[kMostLayers][kTileSize];  ///< The layers' nearest depths.
  V front_layer_, back_layer_;  ///< The pair's layers: the farther one becomes the newcomer's.
};

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#endif
