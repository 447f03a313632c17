#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

#include <surfel/render/plain_pixels.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/render/plain_pixels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <surfel/base/fused-inl.h>
#include <surfel/base/lane_sums-inl.h>

// After the above, which decides on the target.
#include <surfel/render/kernel_raster-inl.h>
#include <surfel/render/lamps-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {
namespace {

/// A channel of a layer's fragments in a vector of pixels.
HWY_INLINE V channel(const TileABuffer& tile, int layer, std::size_t pixel, FragmentChannel c) {
  return hn::Load(D(), tile.fragment(layer, pixel) + c * kPatchPixels);
}
HWY_INLINE V3 channels(const TileABuffer& tile, int layer, std::size_t pixel,
                       FragmentChannel first) {
  const float* from = tile.fragment(layer, pixel) + first * kPatchPixels;
  const D d;
  return {hn::Load(d, from), hn::Load(d, from + kPatchPixels),
          hn::Load(d, from + 2 * kPatchPixels)};
}

/// Fragments of a vector of pixels.
struct FragmentCount {
  V count;         ///< Every pixel's number of fragments.
  V sum;           ///< Sum of the weights of every pixel's unmerged fragments.
  int layers = 0;  ///< Layers that some of the pixels use.
};

FragmentCount count_fragments(const TileABuffer& tile, std::size_t pixel) {
  const D d;
  const V zero = hn::Zero(d);
  FragmentCount out{zero, zero};
  for (; out.layers < tile.layout.layers; ++out.layers) {
    const V weight = channel(tile, out.layers, pixel, kWeight);
    const M used = hn::Ne(weight, zero);
    if (hn::AllFalse(d, used)) break;
    out.count = hn::Add(out.count, hn::IfThenElseZero(used, hn::Set(d, 1)));
    out.sum = hn::Add(out.sum, hn::Max(weight, zero));
  }
  return out;
}

/// The pixels none of whose fragments has a second material.
M with_one_material(const TileABuffer& tile, std::size_t pixel, int layers) {
  const D d;
  const V zero = hn::Zero(d);
  M one = hn::Eq(zero, zero);
  for (int layer = 0; layer < layers; ++layer) {
    const M unmerged = hn::Gt(channel(tile, layer, pixel, kWeight), zero);
    one = hn::AndNot(hn::And(unmerged, hn::Gt(channel(tile, layer, pixel, kOther), zero)), one);
  }
  return one;
}

/// What half-planes cut off from fragments: the channels from kCutAway on.
struct CutSums {
  V away, partial;
  V out_x, out_y;
};

/// The nearest fragments behind some depths.
/// \param cut  gets what half-planes cut off from them, in pictures with such surfels.
Fragments nearest_behind(const TileABuffer& tile, std::size_t pixel, int layers, V depths,
                         CutSums& cut) {
  const D d;
  const V zero = hn::Zero(d);
  const V3 none{zero, zero, zero};
  Fragments out{zero, hn::Set(d, -__builtin_inff()), none, zero, zero, none};
  for (int layer = 0; layer < layers; ++layer) {
    const V weight = channel(tile, layer, pixel, kWeight);
    const M merged = hn::Lt(weight, zero);
    const V weighted_depth = channel(tile, layer, pixel, kDepth);
    const V depth = hn::IfThenElse(merged, weighted_depth, hn::Div(weighted_depth, weight));
    const M nearer =
        hn::And(hn::And(hn::Ne(weight, zero), hn::Lt(depth, depths)), hn::Gt(depth, out.depth));
    V alpha = channel(tile, layer, pixel, kAlpha);
    if (tile.layout.opaque) alpha = hn::IfThenElse(merged, alpha, weight);
    out.weight = hn::IfThenElse(nearer, weight, out.weight);
    out.depth = hn::IfThenElse(nearer, depth, out.depth);
    out.color = select(nearer, channels(tile, layer, pixel, kRed), out.color);
    out.alpha = hn::IfThenElse(nearer, alpha, out.alpha);
    out.tag = hn::IfThenElse(nearer, channel(tile, layer, pixel, kTag), out.tag);
    if (tile.layout.normals) {
      out.normal = select(nearer, channels(tile, layer, pixel, kNormalX), out.normal);
    }
    if (tile.layout.clips) {
      const auto take = [&](V& sum, FragmentChannel c) HWY_ATTR {
        sum = hn::IfThenElse(nearer, channel(tile, layer, pixel, c), sum);
      };
      take(cut.away, kCutAway);
      take(cut.partial, kCutPartial);
      take(cut.out_x, kCutX);
      take(cut.out_y, kCutY);
    }
  }
  return out;
}

/// TileABuffer::full_weight_of_cut() away from edges.
V full_weight_of_cut(const TileABuffer& tile, const Fragments& at, const CutSums& cut) {
  using Tile = TileABuffer;
  const D d;
  const V zero = hn::Zero(d);
  const V one = hn::Set(d, 1);
  const V length = hn::Sqrt(mul_add(cut.out_x, cut.out_x, hn::Mul(cut.out_y, cut.out_y)));
  const V aligned = hn::Div(length, cut.partial);
  const auto ramp = [&](V x, float from, float to) HWY_ATTR {
    const V t = hn::Mul(hn::Sub(x, hn::Set(d, from)), hn::Set(d, 1 / (to - from)));
    return hn::Min(hn::Max(t, zero), one);
  };
  const V corner = hn::Mul(
      ramp(at.weight, Tile::kUncovered * tile.mean_weight, Tile::kCovered * tile.mean_weight),
      ramp(aligned, Tile::kOneSide, Tile::kCorner));
  const V one_side = hn::Mul(ramp(aligned, Tile::kTwoSides, Tile::kOneSide), hn::Sub(one, corner));
  const M filtered = hn::RebindMask(d, hn::Ne(tag_bits(at.tag, kFilteredTag), hn::Zero(Tags())));
  const V sum = hn::Add(at.weight, cut.away);
  const V uncut = hn::IfThenElse(filtered, hn::Min(sum, hn::Set(d, tile.mean_weight)), sum);
  const V full = hn::Set(d, tile.full_weight);
  return mul_add(one_side, hn::Max(zero, hn::Sub(uncut, full)), full);
}

/// Finds out about PlainPixels::inside.
void look_inside(const TileABuffer& tile, PlainPixels& out) {
  const D d;
  out.inside = TileInside::kNo;
  if (tile.width < kTileSize || tile.height < kTileSize) return;
  const auto side = tag_bits(channel(tile, 0, 0, kTag), kFrontTag);
  const auto coarse = hn::Set(Tags(), std::uint32_t{kCoarseStep} << kSpacingShift);
  auto closest = coarse;             // The least spacing_step() ...
  auto furthest = hn::Zero(Tags());  // ... and the largest.
  V least = channel(tile, 0, 0, kWeight);
  for (std::size_t pixel = 0; pixel < kTilePixels; pixel += hn::Lanes(d)) {
    least = hn::Min(least, channel(tile, 0, pixel, kWeight));
    const V behind = tile.layout.layers > 1 ? channel(tile, 1, pixel, kWeight) : hn::Zero(d);
    const auto tags = hn::BitCast(Tags(), channel(tile, 0, pixel, kTag));
    const auto other_side = hn::Xor(side, hn::And(tags, hn::Set(Tags(), kFrontTag)));
    closest = hn::Min(closest, hn::And(tags, coarse));
    furthest = hn::Max(furthest, hn::And(tags, coarse));
    if (!hn::AllTrue(d, hn::Eq(behind, hn::Zero(d))) ||
        !hn::AllTrue(Tags(), hn::Eq(other_side, hn::Zero(Tags())))) {
      return;
    }
  }
  const int step = spacing_step(hn::GetLane(hn::MinOfLanes(Tags(), closest)));
  const float whole = EdgeFilter::least_inside(step) * tile.mean_weight;
  if (!(hn::GetLane(hn::MinOfLanes(d, least)) >= whole)) return;
  out.inside = hn::GetLane(side) != 0 ? TileInside::kFront : TileInside::kBack;
  out.inside_fine = spacing_step(hn::GetLane(hn::MaxOfLanes(Tags(), furthest))) < kCoarseStep;
}

/// 1 for the pixels of a tile within kEdgeReach of its border, 0 for the others.
alignas(64) constexpr std::array<float, kTilePixels> kNearBorder = [] {
  std::array<float, kTilePixels> near{};
  for (int pixel = 0; pixel < kTilePixels; ++pixel) {
    const auto is_near = [](int x) { return x < kEdgeReach || x >= kTileSize - kEdgeReach; };
    near[pixel] = is_near(tile_pixel_x(pixel)) || is_near(tile_pixel_y(pixel)) ? 1.0F : 0.0F;
  }
  return near;
}();

/// Stores premultiplied colours over the background.
void store_over(const V3& color, V opacity, const Rgba& background, Rgba& first) {
  const D d;
  const V transmitted = hn::Sub(hn::Set(d, 1), opacity);
  const auto over = [&](V front, float back)
                        HWY_ATTR { return mul_add(transmitted, hn::Set(d, back), front); };
  hn::StoreInterleaved4(over(color.x, background.red), over(color.y, background.green),
                        over(color.z, background.blue), over(opacity, background.alpha), d,
                        &first.red);
}

}  // namespace

void resolve_plain_pixels_simd(TileABuffer& tile, const Lighting* lighting, const Rgba& background,
                               PlainPixels& out) {
  const D d;
  const V zero = hn::Zero(d);
  const V one = hn::Set(d, 1);
  const V half = hn::Set(d, 0.5F);
  const V full_weight = hn::Set(d, tile.full_weight);
  look_inside(tile, out);
  out.lone.fill(0);
  const V edge_weight = hn::Set(d, tile.edge_weight);
  const V mean_weight = hn::Set(d, tile.mean_weight);
  const V several_weight = hn::Set(d, kSeveralSurfaces * tile.mean_weight);
  const M whole = hn::Eq(zero, zero);
  // Rounding makes a sum of rho * alpha for all alpha = 1 no less than this.
  const V opaque = hn::Set(d, 1 - 1e-5F);
  LaneSums<D, kPatchPixels> sum;
  for (std::size_t pixel = 0; pixel < kTilePixels; pixel += hn::Lanes(d)) {
    const FragmentCount fragments = count_fragments(tile, pixel);
    M lone = hn::Eq(fragments.count, one);
    if (!tile.edges_later) lone = hn::And(lone, hn::Ne(hn::Load(d, &kNearBorder[pixel]), zero));
    M plain = whole;
    if (lighting && lighting->material_count > 1) {
      plain = with_one_material(tile, pixel, fragments.layers);
    }
    V left = fragments.count;  // Fragments that nothing hides.
    V behind = hn::Set(d, __builtin_inff());
    V3 color{zero, zero, zero};
    V opacity = zero;
    V nearness = hn::Set(d, -__builtin_inff());
    M waits = hn::Ne(zero, zero);  // Other tiles decide whether these are at an edge.
    M loose_back = waits;   // The last fragment shows a back that may lie beyond a silhouette ...
    M rim = waits;          // ... or a front's part of the pixel at one.
    M beside_line = waits;  // A fragment covers the part of the pixel that a line leaves of it.
    M partly = waits;       // A fragment covers a part of the pixel.
    for (int i = 0; i < fragments.layers; ++i) {
      M open = hn::And(plain, hn::Gt(left, zero));
      if (hn::AllFalse(d, open)) break;
      CutSums cut{zero, zero, zero, zero};
      const Fragments at = nearest_behind(tile, pixel, fragments.layers, behind, cut);
      const M merged = hn::Lt(at.weight, zero);
      const M unmerged = hn::Gt(at.weight, zero);
      const M not_filtered =
          hn::RebindMask(d, hn::Eq(tag_bits(at.tag, kFilteredTag), hn::Zero(Tags())));
      const M is_cut = hn::And(unmerged, hn::Gt(cut.partial, zero));
      V full = full_weight;
      if (tile.layout.clips && !hn::AllFalse(d, is_cut)) {
        full = hn::IfThenElse(is_cut, full_weight_of_cut(tile, at, cut), full);
      }
      // Inside a tile that lies inside a surface there is no edge.
      const M last = hn::Le(left, one);
      const M ends = tile.layout.opaque ? last : whole;
      const M known =
          hn::Or(not_filtered, hn::And(ends, hn::Ge(at.weight, hn::Set(d, tile.inside_weight))));
      const M may_wait = hn::AndNot(is_cut, lone);
      const M not_at_edge =
          out.inside == TileInside::kNo ? may_wait : hn::AndNot(hn::And(is_cut, lone), whole);
      M no_edge = hn::Or(known, not_at_edge);
      if (tile.layout.opaque && fragments.layers > 1) {
        // It may share what it covers with others.
        const M even = hn::RebindMask(d, hn::Ne(tag_bits(at.tag, kEvenTag), hn::Zero(Tags())));
        const V whole_sum = hn::IfThenElse(even, edge_weight, mean_weight);
        const M several =
            hn::And(hn::Gt(fragments.count, one), hn::Lt(fragments.sum, several_weight));
        no_edge = hn::And(
            no_edge, hn::Or(not_filtered, hn::Or(hn::Not(several), hn::Ge(at.weight, whole_sum))));
      }
      if (i == 0) waits = hn::AndNot(known, hn::And(may_wait, unmerged));
      // Of equally near fragments only one lies behind the depths before, so that the pixel is
      // left.
      open = hn::And(open, hn::Or(merged, hn::And(unmerged, no_edge)));
      const V inv_weight = hn::Div(one, hn::IfThenElse(unmerged, at.weight, one));
      const V coverage = hn::IfThenElse(unmerged, hn::Min(one, hn::Div(at.weight, full)), one);
      // Parts of pixels beside lines may lie one in the other, or exclude each other.
      open = hn::AndNot(hn::And(is_cut, beside_line), open);
      beside_line = hn::Or(beside_line, hn::And(is_cut, hn::Lt(coverage, one)));
      if (fragments.layers > 1) {
        // Where a back lies in front of a front, and both cover a part of the pixel or are seen at
        // a grazing angle, depth may not be the order in which they are seen; where a back lies
        // behind a front, they may be the two sides of one body.
        const V share = tile.layout.opaque ? hn::IfThenElse(merged, at.alpha, coverage) : coverage;
        const M part = hn::Lt(share, one);
        const M shows_front =
            hn::RebindMask(d, hn::Ne(tag_bits(at.tag, kFrontTag), hn::Zero(Tags())));
        const M grazing =
            hn::RebindMask(d, hn::Ne(tag_bits(at.tag, kGrazingTag), hn::Zero(Tags())));
        const M loose = hn::Or(part, grazing);
        open = hn::AndNot(hn::And(loose_back, hn::And(loose, shows_front)), open);
        // A back with less than a whole sum, or behind a part of a pixel, may be the far side of a
        // body.
        if (tile.layout.opaque) {
          const M in_part = hn::Or(partly, beside_line);
          const M doubtful = hn::And(unmerged, hn::Or(in_part, hn::Lt(at.weight, edge_weight)));
          const M alone = hn::Eq(fragments.count, one);
          open = hn::AndNot(hn::AndNot(shows_front, hn::AndNot(alone, doubtful)), open);
        }
        // What is behind a back that covers the pixel is not looked at here.
        open = hn::AndNot(hn::AndNot(shows_front, hn::AndNot(part, grazing)), open);
        open = hn::AndNot(hn::And(rim, hn::AndNot(shows_front, grazing)), open);
        loose_back = hn::AndNot(shows_front, loose);
        rim = hn::And(shows_front, hn::And(part, grazing));
        partly = hn::Or(partly, part);
      }
      const V alpha = hn::Mul(at.alpha, inv_weight);
      const V front = hn::Mul(alpha, coverage);
      V3 shade = hn::Mul(inv_weight, coverage) * at.color;
      const std::intptr_t first = hn::FindFirstTrue(d, hn::And(open, unmerged));
      if (lighting && first >= 0) {
        // Fragments of one material are shaded; pixels with other materials are left.
        const std::uint32_t tag =
            hn::ExtractLane(hn::BitCast(Tags(), at.tag), static_cast<std::size_t>(first));
        open = hn::And(open, hn::Or(merged, of_material(at.tag, tag)));
        const Lamps lamps(*lighting, tile);
        // A fragment without a colour of its own is not seen.
        const M colored = hn::And(unmerged, hn::Gt(at.alpha, zero));
        const V3 lit = select(colored, front * lamps.light(at, pixel, lamps.material(tag)),
                              {zero, zero, zero});
        shade = select(unmerged, lit, shade);
      }
      // SS01 (12)
      const V transmitted = hn::IfThenElseZero(open, hn::Sub(one, opacity));
      color = color + transmitted * select(open, shade, color);
      const M below = hn::Lt(opacity, half);
      opacity = mul_add(transmitted, hn::IfThenElseZero(open, front), opacity);
      const M passes = hn::And(below, hn::Ge(opacity, half));
      nearness = hn::IfThenElse(i == 0 ? whole : passes, at.depth, nearness);
      plain = hn::And(plain, hn::Or(open, hn::Le(left, zero)));
      const M hides = hn::And(hn::Ge(at.weight, full), hn::Ge(alpha, opaque));
      left = hn::IfThenZeroElse(hides, hn::Sub(left, one));
      behind = at.depth;
    }
    sum.add(pixel, hn::IfThenElseZero(plain, fragments.sum));
    store_over(color, opacity, background, out.color[pixel]);
    hn::Store(opacity, d, &out.opacity[pixel]);
    hn::Store(nearness, d, &out.nearness[pixel]);
    hn::Store(hn::IfThenZeroElse(plain, one), d, &out.left[pixel]);
    std::uint8_t bits[8] = {};  // StoreMaskBits() may write as many.
    hn::StoreMaskBits(d, hn::And(plain, waits), bits);
    out.lone[pixel / kPatchPixels] |=
        static_cast<std::uint16_t>((bits[0] | bits[1] << 8U) << pixel % kPatchPixels);
  }
  tile.merges.total_weight += sum.total();
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {

HWY_EXPORT(resolve_plain_pixels_simd);

PlainPixels resolve_plain_pixels(TileABuffer& tile, const Lighting* lighting,
                                 const Rgba& background) {
  PlainPixels out;
  HWY_DYNAMIC_DISPATCH(resolve_plain_pixels_simd)(tile, lighting, background, out);
  return out;
}

}  // namespace surfel
#endif
