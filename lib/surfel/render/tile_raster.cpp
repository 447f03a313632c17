// Zwicker, Pfister, van Baar, Gross, "Surface Splatting", SIGGRAPH 2001: sections 4 and 6.

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <type_traits>
#include <utility>

#include <surfel/render/shading.h>
#include <surfel/render/tile_raster.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/render/tile_raster.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <surfel/base/lane_sums-inl.h>
#include <surfel/render/kernel_raster-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {
namespace {

/// Merged fragments through which nothing is seen.
HWY_INLINE M covers_merged(const float* fragment, V weight) {
  const D d;
  return hn::And(hn::Lt(weight, hn::Zero(d)),
                 hn::Ge(hn::Load(d, fragment + kAlpha * kPatchPixels), hn::Set(d, kOpaqueAlpha)));
}

/// A vector of CoveringDepths.
struct CoveringLanes {
  V nearest, alone;
};

template <bool kOpaqueSplats>
HWY_INLINE CoveringLanes covering_depth(const TileABuffer& tile, std::size_t pixel) {
  const D d;
  V nearest = hn::Set(d, -__builtin_inff());
  V alone = nearest;
  for (int layer = 0; layer < tile.layout.layers; ++layer) {
    const float* fragment = tile.fragment(layer, pixel);
    const V weight = hn::Load(d, fragment + kWeight * kPatchPixels);
    if (is_zero(weight)) break;
    const V depth = hn::Load(d, fragment + kDepth * kPatchPixels);
    const V alpha = hn::Load(d, fragment + kAlpha * kPatchPixels);
    M covering = covers<kOpaqueSplats>(weight, alpha, hn::Set(d, tile.edge_weight));
    const auto tags = hn::BitCast(Tags(), hn::Load(d, fragment + kTag * kPatchPixels));
    M has_no_edge = hn::Not(hn::RebindMask(d, hn::TestBit(tags, hn::Set(Tags(), kFilteredTag))));
    if (tile.layout.clips) {
      const V away = hn::Load(d, fragment + kCutAway * kPatchPixels);
      const V partial = hn::Load(d, fragment + kCutPartial * kPatchPixels);
      covering = hn::And(covering, is_whole(weight, away));
      has_no_edge = hn::Or(has_no_edge, hn::Gt(partial, hn::Zero(d)));
    }
    const V at = hn::IfThenElse(covering, hn::Div(depth, weight), hn::Set(d, -__builtin_inff()));
    nearest = hn::Max(nearest, at);
    alone = hn::IfThenElse(has_no_edge, hn::Max(alone, at), alone);
    nearest = hn::IfThenElse(covers_merged(fragment, weight), hn::Max(nearest, depth), nearest);
  }
  return {nearest, alone};
}

template <bool kOpaqueSplats>
void find_covering_depths(const TileABuffer& tile, CoveringDepths& depths) {
  for (std::size_t pixel = 0; pixel < kTilePixels; pixel += hn::MaxLanes(D())) {
    const CoveringLanes found = covering_depth<kOpaqueSplats>(tile, pixel);
    hn::StoreU(found.nearest, D(), depths.nearest.data() + pixel);
    hn::StoreU(found.alone, D(), depths.alone.data() + pixel);
  }
}

/// \tparam kClips  Some splats of the tile are cut by half-planes.
template <bool kNormals, bool kOpaqueSplats, bool kClips>
class Rasterizer {
 public:
  Rasterizer(const TileJob& job, TileABuffer& tile)
      : job_(job),
        tile_(tile),
        raster_(job, tile.x0, tile.y0),
        stride_(tile.layout.layer_stride()),
        layers_(tile.layout.layers),
        channels_(tile.layout.channels()),
        cover_(hn::Set(D(), tile.edge_weight)) {}

  void run() {
    for (std::size_t v = 0; v < kVectors && job_.sheets; ++v) {
      next_sheet_[v] = job_.sheets_begin[patch_of(v)];
    }
    // A check costs about as much as a dozen splats.
    for (std::size_t begin = 0; begin < job_.count; begin += kHiddenEvery) {
      const std::size_t end = std::min(begin + kHiddenEvery, job_.count);
      find_hidden();
      least_.reset();
      drawn_ = {begin, end};
      raster_.for_each_vector(begin, end, hidden_.data(),
                              [&](const PixelSplats& list) HWY_ATTR { draw_all(list); });
    }
    if (job_.sheets) {
      find_hidden();
      for (std::size_t v = 0; v < kVectors; ++v) {
        if (v + 1 < kVectors) prefetch_sheets(v + 1);
        draw_sheets(v * hn::MaxLanes(D()), -infinity());
      }
    }
    tile_.merges.late_weight += late_weight_.total();
  }

 private:
  static float infinity() { return __builtin_inff(); }

  /// rho of the least contribution that merges, of the splats being drawn.
  float least_to_merge() {
    if (job_.replay) return job_.replay->least_to_merge;
    if (!least_) {
      least_ =
          std::min(kMergingShare * tile_.full_weight, kMergingShareOfLargest * largest_amplitude());
    }
    return *least_;
  }

  /// Largest amplitude of the splats being drawn.
  float largest_amplitude() const {
    float largest = 0;
    for (std::size_t i = drawn_.first; i < drawn_.second; ++i) {
      const Splat& splat = job_.splats[job_.order[i]];
      // Exact splats are large on the screen, so that a few make a surface.
      largest = std::max(largest, splat.k < 0 ? tile_.full_weight : splat.amplitude);
    }
    return largest;
  }

  void find_hidden() {
    if (job_.replay) {
      hidden_.fill(job_.replay->hidden);
    } else {
      CoveringDepths covering;
      find_covering_depths<kOpaqueSplats>(tile_, covering);
      hidden_ = hidden_in_patches(tile_, covering);
    }
  }

  /// What is added to a vector of pixels.
  struct Newcomer {
    V rho;  ///< 0 in pixels that it does not add to.
    V depth, epsilon;
  };
  /// A splat's contribution.
  struct Contribution : Newcomer {
    std::uint32_t splat;
  };
  /// With what half-planes cut off from it; their splats alone have that.
  struct CutOff : Contribution {
    CutContribution cut;
  };
  using Waiting = std::conditional_t<kClips, CutOff, Contribution>;

  bool is_clipped(std::uint32_t splat) const {
    return kClips && (job_.splats[splat].tag & kClippedTag) != 0;
  }

  using Layer = FragmentLayer<kNormals, kOpaqueSplats, kClips>;

  const SplatNormal* normal_of(std::uint32_t splat) const {
    return kNormals ? job_.normals + splat : nullptr;
  }

  static constexpr std::size_t kVectors = kTilePixels / hn::MaxLanes(D());
  static std::size_t patch_of(std::size_t vector) {
    return vector * hn::MaxLanes(D()) / kPatchPixels;
  }

  /// Adds splats, and the sheets between them, to a vector of pixels.
  HWY_INLINE void draw_all(PixelSplats list) {
    if (!job_.sheets) {
      draw(list);
      return;
    }
    const std::size_t vector = list.pixel / hn::MaxLanes(D());
    const std::uint32_t* const last = list.end;
    while (list.begin < last) {
      list.end = list.begin;
      const bool more = next_sheet_[vector] < job_.sheets_begin[patch_of(vector) + 1];
      const float depth = more ? job_.sheets[next_sheet_[vector]].depth : -infinity();
      while (list.end < last && job_.splats[*list.end].depth >= depth) ++list.end;
      draw(list);
      if (list.end < last) draw_sheets(list.pixel, job_.splats[*list.end].depth);
      list.begin = list.end;
    }
  }

  const float* sums_of(const SheetPatch& sheet) const {
    return job_.sheet_sums + std::size_t{kPatchPixels} * sheet.sums;
  }

  HWY_INLINE void prefetch_sheets(std::size_t vector) const {
    constexpr std::size_t kSize = (kNormals ? kNormalZ : kSheetEpsilon) * kPatchPixels;
    const std::uint32_t end = job_.sheets_begin[patch_of(vector) + 1];
    for (std::uint32_t i = next_sheet_[vector]; i < end; ++i) {
      const float* sums = sums_of(job_.sheets[i]);
      for (std::size_t place = 0; place <= kSize; place += kPatchPixels) {
        hwy::Prefetch(sums + place);
      }
    }
  }

  /// Adds the sheets that are nearer than `depth` to a vector of pixels.
  HWY_NOINLINE void draw_sheets(std::size_t pixel, float depth) {
    const std::size_t vector = pixel / hn::MaxLanes(D());
    const std::uint32_t end = job_.sheets_begin[patch_of(vector) + 1];
    std::uint32_t& next = next_sheet_[vector];
    for (; next < end && job_.sheets[next].depth > depth; ++next) {
      draw_sheet(pixel, job_.sheets[next]);
    }
  }

  HWY_INLINE void draw_sheet(std::size_t pixel, const SheetPatch& sheet) {
    const D d;
    const float* const from = sums_of(sheet) + pixel % kPatchPixels;
    const FragmentSums<kNormals, kOpaqueSplats> sums(from);
    const V hidden = hn::Load(d, hidden_.data() + pixel);
    const M drawn = hn::Gt(sums.weight, hn::Zero(d));
    const V each = hn::Div(hn::Set(d, 1.0F), sums.weight);
    const V depth = hn::Mul(sums.depth, each);
    const V epsilon = hn::Mul(hn::Load(d, from + kSheetEpsilon * kPatchPixels), each);
    const M seen = hn::And(drawn, hn::Ge(hn::Add(depth, epsilon), hidden));
    V rho = hn::IfThenElseZero(seen, sums.weight);
    for (int which = 0; which < layers_; ++which) {
      if (is_zero(rho)) return;
      Layer layer(tile_.fragment(which, pixel), channels_, cover_);
      const V left = layer.take(rho, depth, epsilon, sheet.tag, sums);
      if (layer.joined()) layer.store();
      rho = left;
    }
    if (is_zero(rho)) return;
    const Newcomer newcomer{rho, hn::IfThenElseZero(drawn, depth), epsilon};
    const auto merge = [&](M open) HWY_ATTR {
      if constexpr (kMergesVectors) return merge_covering(pixel, open, depth, sums, sheet.tag);
      return open;
    };
    const auto fragment_at = [&](std::size_t lane) {
      Fragment fresh{};
      for (const int c : {kWeight, kDepth, kRed, kGreen, kBlue, kAlpha}) {
        fresh.channel[c] = from[c * kPatchPixels + lane];
      }
      for (int c = kNormalX; c <= kNormalZ && kNormals; ++c) {
        fresh.channel[c] = from[c * kPatchPixels + lane];
      }
      fresh.channel[kTag] = std::bit_cast<float>(sheet.tag);
      return fresh;
    };
    add_without_layer(pixel, newcomer, kMergingShare * tile_.full_weight, merge, fragment_at);
  }

  /// Pictures whose fragments are merged by vectors of pixels: their colours need no light.
  static constexpr bool kMergesVectors = !kNormals && !kOpaqueSplats && !kClips;

  /// insert_by_merging() of a sheet, in the pixels among `open` where two fragments which cover the
  /// pixel are to be merged, so that they are composited as they are (12). Returns the other
  /// pixels.
  HWY_NOINLINE M merge_covering(std::size_t pixel, M open, V depth,
                                const FragmentSums<kNormals, kOpaqueSplats>& fresh,
                                std::uint32_t tag) {
    const D d;
    const Tags dt;
    const M all = open;
    constexpr int kFewLayers = 8;
    if (layers_ < 3 || layers_ > kFewLayers || tile_.shader->has_environment()) return open;
    const V zero = hn::Zero(d);
    const V one = hn::Set(d, 1.0F);
    // Depths of the two nearest fragments, and of the two farthest ones.
    V first = hn::Set(d, -infinity());
    V second = first;
    V last = hn::Set(d, infinity());
    V before_last = last;
    V in_front = zero;  // How many fragments are nearer than the newcomer.
    V at[kFewLayers];
    for (int layer = 0; layer < layers_; ++layer) {
      const float* fragment = tile_.fragment(layer, pixel);
      const V weight = hn::Load(d, fragment + kWeight * kPatchPixels);
      const V weighted = hn::Load(d, fragment + kDepth * kPatchPixels);
      const auto tags = hn::BitCast(dt, hn::Load(d, fragment + kTag * kPatchPixels));
      const M is_merged = hn::Lt(weight, zero);
      const V z = hn::IfThenElse(is_merged, weighted, hn::Div(weighted, weight));
      at[layer] = z;
      second = hn::Max(second, hn::Min(first, z));
      first = hn::Max(first, z);
      before_last = hn::Min(before_last, hn::Max(last, z));
      last = hn::Min(last, z);
      in_front = hn::Add(in_front, hn::IfThenElseZero(hn::Ge(z, depth), one));
      // The newcomer may be one more slab of a surface that does not cover the pixel yet.
      const auto side = hn::And(hn::Xor(tags, hn::Set(dt, tag)), hn::Set(dt, kFrontTag));
      const M same_side = hn::RebindMask(d, hn::Eq(side, hn::Zero(dt)));
      const M partial =
          hn::And(hn::Ge(weight, zero), hn::Lt(weight, hn::Set(d, tile_.full_weight)));
      open = hn::AndNot(hn::And(partial, same_side), open);
    }
    const M nearest = hn::Ge(in_front, hn::Set(d, 2.0F));
    const V front_at = hn::IfThenElse(nearest, first, before_last);
    const V back_at = hn::IfThenElse(nearest, second, last);
    struct Covering {
      V weight, red, green, blue, alpha, tag, back;
    };
    Covering front{};
    Covering back{};
    V found = zero;
    const auto pick = [&](const float* fragment, M is, Covering& to) HWY_ATTR {
      const auto channel = [&](int which, V& value) HWY_ATTR {
        value = hn::IfThenElse(is, hn::Load(d, fragment + which * kPatchPixels), value);
      };
      channel(kWeight, to.weight);
      channel(kRed, to.red);
      channel(kGreen, to.green);
      channel(kBlue, to.blue);
      channel(kAlpha, to.alpha);
      channel(kTag, to.tag);
      channel(kBack, to.back);
      found = hn::Add(found, hn::IfThenElseZero(is, one));
    };
    front.weight = front.red = front.green = front.blue = front.alpha = front.tag = front.back =
        zero;
    back = front;
    for (int layer = 0; layer < layers_; ++layer) {
      const float* fragment = tile_.fragment(layer, pixel);
      pick(fragment, hn::Eq(at[layer], front_at), front);
      pick(fragment, hn::Eq(at[layer], back_at), back);
    }
    // Depths may be equal.
    open = hn::And(open, hn::Eq(found, hn::Set(d, 2.0F)));
    const auto has = [&](V tags, std::uint32_t flag) HWY_ATTR {
      return hn::RebindMask(d, hn::TestBit(hn::BitCast(dt, tags), hn::Set(dt, flag)));
    };
    // As merged() sees them: filtered splats are taken to be near to an edge.
    const V inside = hn::Set(d, tile_.weight_at_edge(0));
    const V at_edge = hn::Set(d, tile_.weight_at_edge(kMergedEdge));
    for (Covering* f : {&front, &back}) {
      const V full = hn::IfThenElse(has(f->tag, kFilteredTag), at_edge, inside);
      const M is_merged = hn::Lt(f->weight, zero);
      open = hn::And(open, hn::Or(is_merged, hn::Ge(f->weight, full)));
      open = hn::AndNot(has(f->tag, kGrazingTag), open);
      const V scale = hn::IfThenElse(is_merged, one, hn::Div(one, f->weight));
      for (V* channel : {&f->red, &f->green, &f->blue, &f->alpha})
        *channel = hn::Mul(*channel, scale);
    }
    if (hn::AllFalse(d, open)) return all;
    tile_.merges.merged += hn::CountTrue(d, open);
    const V through = hn::Sub(one, front.alpha);
    const auto over = [&](V a, V b) HWY_ATTR { return mul_add(through, b, a); };
    const V back_most = hn::IfThenElse(hn::Lt(back.weight, zero), back.back, back_at);
    const V tag_bits = hn::BitCast(d, hn::Set(dt, tag));
    const std::pair<int, std::pair<V, V>> channels[] = {
        {kWeight, {hn::Set(d, -1.0F), fresh.weight}},
        {kDepth, {front_at, fresh.depth}},
        {kRed, {over(front.red, back.red), fresh.red}},
        {kGreen, {over(front.green, back.green), fresh.green}},
        {kBlue, {over(front.blue, back.blue), fresh.blue}},
        {kAlpha, {over(front.alpha, back.alpha), fresh.alpha}},
        {kTag, {front.tag, tag_bits}},
        {kBack, {back_most, zero}}};
    for (int layer = 0; layer < layers_; ++layer) {
      float* fragment = tile_.fragment(layer, pixel);
      const M to_pair = hn::And(open, hn::Eq(at[layer], front_at));
      const M to_newcomer = hn::And(open, hn::Eq(at[layer], back_at));
      if (hn::AllFalse(d, hn::Or(to_pair, to_newcomer))) continue;
      for (const auto& [which, values] : channels) {
        float* place = fragment + which * kPatchPixels;
        const V kept = hn::Load(d, place);
        hn::Store(
            hn::IfThenElse(to_pair, values.first, hn::IfThenElse(to_newcomer, values.second, kept)),
            d, place);
      }
    }
    return hn::AndNot(open, all);
  }

  /// Adds splats to a vector of pixels, in steps over some of them at a time, layer by layer: a
  /// layer's sums depend only on contributions that no layer before it has taken. A splat that
  /// waits, or a branch guessed wrong, costs no more than its own step.
  HWY_NOINLINE void draw(const PixelSplats& list) {
    // Their contributions stay in the first-level cache.
    constexpr auto kBatch = static_cast<std::ptrdiff_t>(kOfferedTogether);
    Waiting batch[kBatch];
    if (job_.replay && job_.replay->epsilon) note_epsilon(list);
    for (const std::uint32_t* begin = list.begin; begin < list.end; begin += kBatch) {
      const std::uint32_t* end = begin + std::min(kBatch, list.end - begin);
      const Layers open = open_layers(list.pixel, list.reach);
      const int first = open == 0 ? 0 : std::countr_zero(open);
      const std::size_t left = join_first(list, begin, end, first, batch);
      place(list, open & ~(Layers{1} << first), batch, left);
    }
  }

  /// Stores the epsilons of the first splat of a list.
  HWY_NOINLINE void note_epsilon(const PixelSplats& list) const {
    const Sample s = raster_.sampler().uncut_at(*list.begin, list.x, list.y);
    hn::StoreU(s.epsilon, D(), job_.replay->epsilon + list.pixel);
  }

  /// Layers, as bits.
  using Layers = std::uint64_t;
  static_assert(kMostLayers <= std::numeric_limits<Layers>::digits);

  /// Layers that may take a contribution that is not nearer than `reach`: not the layers
  /// that have been merged, nor layers that lie in front of it everywhere.
  Layers open_layers(std::size_t pixel, float reach) const {
    const D d;
    const V zero = hn::Zero(d);
    Layers open = 0;
    for (int layer = 0; layer < layers_; ++layer) {
      const float* fragment = tile_.fragment(layer, pixel);
      const V weight = hn::Load(d, fragment + kWeight * kPatchPixels);
      const V depth = hn::Load(d, fragment + kDepth * kPatchPixels);
      const M beyond =
          hn::And(hn::Gt(weight, zero), hn::Lt(hn::Mul(hn::Set(d, reach), weight), depth));
      if (hn::AllFalse(d, hn::AndNot(beyond, hn::Ge(weight, zero)))) continue;
      open |= Layers{1} << layer;
    }
    return open;
  }

  /// Adds contributions that the first open layer did not take; `open` are the other layers.
  HWY_INLINE void place(const PixelSplats& list, Layers open, Waiting* batch, std::size_t count) {
    const std::size_t left = join_layers(list.pixel, open, batch, count);
    const D d;
    M made = hn::Lt(hn::Zero(d), hn::Zero(d));
    for (std::size_t i = 0; i < left; ++i) {
      if (!hn::AllFalse(d, made)) {
        // Contributions take longer one by one, but must be added so in the pixels where one has
        // made a layer for the next; in no others, which must not depend on their neighbours.
        const V rho = batch[i].rho;
        batch[i].rho = hn::IfThenElseZero(made, rho);
        join_layers(list.pixel, open, batch + i, 1);
        batch[i].rho = hn::IfThenElse(made, batch[i].rho, rho);
        if (is_zero(batch[i].rho)) continue;
      }
      const M made_here = add_without_layer(list.pixel, batch[i]);
      if (hn::AllFalse(d, made_here)) continue;
      made = hn::Or(made, made_here);
      open = open_layers(list.pixel, list.reach);
    }
  }

  /// Evaluates the splats [begin, end) where they are seen, and adds them to a layer. Leaves the
  /// contributions of other surfaces in `out`, and returns their number.
  HWY_INLINE std::size_t join_first(const PixelSplats& list, const std::uint32_t* begin,
                                    const std::uint32_t* end, int which, Waiting* out) const {
    const D d;
    const SplatSampler sampler = raster_.sampler();
    const Splat* const splats = job_.splats;
    const V x = list.x;
    const V y = list.y;
    const V cutoff = hn::Set(d, job_.rules->cutoff);
    const V hidden = hn::Load(d, hidden_.data() + list.pixel);
    Layer layer(tile_.fragment(which, list.pixel), channels_, cover_);
    FragmentCounter fragments;
    std::size_t left = 0;
    for (; begin < end; ++begin) {
      const bool has_clip = is_clipped(*begin);
      V clip[2];
      const Sample s = sampler.uncut_at(*begin, x, y, has_clip ? clip : nullptr);
      M inside = hn::Lt(s.beta, cutoff);
      V least = hn::Set(d, kWholeClip);
      if (has_clip) {
        least = hn::Min(clip[0], clip[1]);
        inside = hn::And(inside, hn::Ge(least, hn::Set(d, kLeastClip)));
      }
      fragments.add(inside);
      // A contribution within epsilon of the hiding surface may belong to it.
      const M seen = hn::Ge(hn::Add(s.depth, s.epsilon), hidden);
      const M open = hn::And(seen, inside);
      if (has_clip && hn::AllFalse(d, open)) continue;
      // Does a line leave a part of the splat somewhere?
      const bool is_cut =
          has_clip && !hn::AllFalse(d, hn::And(open, hn::Lt(least, hn::Set(d, kWholeClip))));
      V rho = hn::IfThenElseZero(open, hn::Mul(s.amplitude, sampler.decay(s.beta)));
      CutContribution cut{hn::Zero(d), {hn::Zero(d), hn::Zero(d)}};
      if (is_cut) cut = sampler.cut(*begin, clip[0], clip[1], rho);
      Waiting& to = out[left];
      to.depth = s.depth;
      to.epsilon = s.epsilon;
      to.splat = *begin;
      to.rho = layer.take(rho, s.depth, s.epsilon, splats[*begin], normal_of(*begin));
      const bool waits = !is_zero(to.rho);
      if constexpr (kClips) {
        if (is_cut) layer.add_cut(job_.clips[*begin], cut);
        // Whether it waits is known late: a branch guessed wrong costs more than to store it.
        if (has_clip) to.cut = cut;
      }
      left += waits ? 1 : 0;
    }
    layer.store();
    raster_.count(fragments);
    return left;
  }

  /// Adds contributions to some layers. Leaves contributions for which there is no layer, in the
  /// pixels where there is none, and returns their number.
  HWY_INLINE std::size_t join_layers(std::size_t pixel, Layers open, Waiting* batch,
                                     std::size_t count) const {
    const Splat* const splats = job_.splats;
    for (; open != 0 && count > 0; open &= open - 1) {
      Layer layer(tile_.fragment(std::countr_zero(open), pixel), channels_, cover_);
      std::size_t left = 0;
      for (std::size_t i = 0; i < count; ++i) {
        // Field by field: as a whole it would go through memory once more.
        const V rho = batch[i].rho;
        const V depth = batch[i].depth;
        const V epsilon = batch[i].epsilon;
        const std::uint32_t splat = batch[i].splat;
        Waiting& to = batch[left];
        if constexpr (kClips) {
          if (is_clipped(splat)) to.cut = batch[i].cut;
        }
        to.depth = depth;
        to.epsilon = epsilon;
        to.splat = splat;
        to.rho = layer.take(rho, depth, epsilon, splats[splat], normal_of(splat));
        if constexpr (kClips) {
          if (is_clipped(splat)) layer.add_cut(job_.clips[splat], to.cut);
        }
        left += is_zero(to.rho) ? 0 : 1;
      }
      layer.store();
      count = left;
    }
    return count;
  }

  /// Adds a contribution for which no layer is left in its pixels. Returns the pixels in which that
  /// has made a layer.
  HWY_NOINLINE M add_without_layer(std::size_t pixel, const Waiting& c) {
    HWY_ALIGN float rhos[kTileSize];
    HWY_ALIGN float depths[kTileSize];
    HWY_ALIGN float cuts[4][kTileSize] = {};
    const D d;
    hn::Store(c.rho, d, rhos);
    hn::Store(c.depth, d, depths);
    if constexpr (kClips) {
      if (is_clipped(c.splat)) {
        hn::Store(c.cut.away, d, cuts[0]);
        hn::Store(c.cut.all_partial(), d, cuts[1]);
        for (int axis = 0; axis < 2; ++axis) {
          hn::Store(c.cut.outward(job_.clips[c.splat], axis), d, cuts[2 + axis]);
        }
      }
    }
    const auto merge = [](M open) HWY_ATTR { return open; };
    return add_without_layer(pixel, c, least_to_merge(), merge, [&](std::size_t lane) {
      return unmerged({rhos[lane],
                       depths[lane],
                       job_.splats[c.splat],
                       normal_of(c.splat),
                       {cuts[0][lane], cuts[1][lane], cuts[2][lane], cuts[3][lane]}});
    });
  }

  /// \param least  the least sum of rho that merges.
  /// \param merge  merges in some of the pixels of a mask, and returns the others.
  /// \param fragment_at  makes the fragment of a lane.
  template <class Merge, class FragmentAt>
  HWY_INLINE M add_without_layer(std::size_t pixel, const Newcomer& c, float least,
                                 const Merge& merge, const FragmentAt& fragment_at) {
    const D d;
    const V rho = c.rho;
    const V depth = c.depth;
    M open = hn::Gt(rho, hn::Zero(d));
    if (layers_ == 1) {
      // The nearer surface stays, and most come front to back.
      const float* fragment = tile_.fragment(0, pixel);
      const V weight = hn::Load(d, fragment + kWeight * kPatchPixels);
      const V weighted_depth = hn::Load(d, fragment + kDepth * kPatchPixels);
      open = hn::And(open, hn::Gt(hn::Mul(depth, weight), weighted_depth));
      if (hn::AllFalse(d, open)) return open;
    }
    // A contribution that nobody sees, or that something covers, is not worth merging two surfaces
    // for.
    open = hn::And(open, hn::Ge(rho, hn::Set(d, least)));
    const V covering = covering_depth<kOpaqueSplats>(tile_, pixel).nearest;
    const M covered = hn::And(open, hn::Lt(depth, covering));
    M made = hn::FirstN(d, 0);
    if (kOpaqueSplats && !hn::AllFalse(d, covered)) {
      HWY_ALIGN float depths[kTileSize];
      HWY_ALIGN float replaced[kTileSize] = {};
      hn::Store(covering, d, depths);
      for_each_lane(covered, [&](std::size_t lane) {
        const int at = static_cast<int>(pixel + lane);
        replaced[lane] = replace_back(tile_, at, fragment_at(lane), depths[lane]) ? 1.0F : 0.0F;
      });
      made = hn::Ne(hn::Load(d, replaced), hn::Zero(d));
    }
    open = hn::AndNot(covered, open);
    if (hn::AllFalse(d, open)) return made;
    open = add_to_merged(pixel, open, c, fragment_at);
    if (hn::AllFalse(d, open)) return made;
    HWY_ALIGN float depths[kTileSize];
    hn::Store(depth, d, depths);
    for_each_lane(merge(open), [&](std::size_t lane) {
      insert_by_merging(tile_, static_cast<int>(pixel + lane), fragment_at(lane), depths[lane]);
    });
    return hn::Or(open, made);
  }

  /// Treats contributions that come after their surface has been merged: behind an opaque pair they
  /// are not seen; within a pair they fill the share that it leaves open if all is opaque, and are
  /// dropped otherwise, as their place in the pair is not known. Returns the other contributions.
  template <class FragmentAt>
  HWY_INLINE M add_to_merged(std::size_t pixel, M open, const Newcomer& c,
                             const FragmentAt& fragment_at) {
    const D d;
    const V depth = c.depth;
    const V epsilon = c.epsilon;
    const float* fragment = tile_.fragment(0, pixel);
    for (int layer = 0; layer < layers_; ++layer, fragment += stride_) {
      if (hn::AllFalse(d, open)) break;
      const V weight = hn::Load(d, fragment + kWeight * kPatchPixels);
      const V front = hn::Load(d, fragment + kDepth * kPatchPixels);
      const V back = hn::Load(d, fragment + kBack * kPatchPixels);
      open = hn::AndNot(hn::And(covers_merged(fragment, weight), hn::Lt(depth, front)), open);
      const M within = hn::And(
          hn::And(open, hn::Lt(weight, hn::Zero(d))),
          hn::And(hn::Lt(hn::Sub(depth, epsilon), front), hn::Gt(hn::Add(depth, epsilon), back)));
      if (hn::AllFalse(d, within)) continue;
      tile_.merges.late += hn::CountTrue(d, within);
      late_weight_.add(pixel, hn::IfThenElseZero(within, c.rho));
      open = hn::AndNot(within, open);
      if constexpr (kOpaqueSplats) {
        for_each_lane(within, [&](std::size_t lane) {
          add_to_merged_layer(tile_, layer, static_cast<int>(pixel + lane), fragment_at(lane));
        });
      }
    }
    return open;
  }

  /// Calls `function(lane)` for the lanes of the mask, in order.
  template <class Function>
  static HWY_INLINE void for_each_lane(M lanes, const Function& function) {
    std::uint8_t bytes[8] = {};  // StoreMaskBits() may write as many.
    hn::StoreMaskBits(D(), lanes, bytes);
    for (unsigned left = bytes[0] | bytes[1] << 8U; left != 0; left &= left - 1) {
      function(static_cast<std::size_t>(std::countr_zero(left)));
    }
  }

  const TileJob& job_;
  TileABuffer& tile_;
  const KernelRaster raster_;
  const std::size_t stride_;
  const int layers_;
  const int channels_;
  const V cover_;
  std::pair<std::size_t, std::size_t> drawn_{0, 0};  ///< Range of the order that is being drawn.
  std::optional<float> least_;                       ///< See least_to_merge().
  LaneSums<D, kPatchPixels> late_weight_;
  std::uint32_t next_sheet_[kVectors];  ///< Of every vector of pixels, the sheet to draw next.
  alignas(64) PixelDepths hidden_;      ///< Behind these nothing is seen.
};

}  // namespace

template <bool kClips>
void rasterize(const TileJob& job, TileABuffer& tile) {
  if (job.normals) {
    job.rules->opaque ? Rasterizer<true, true, kClips>(job, tile).run()
                      : Rasterizer<true, false, kClips>(job, tile).run();
  } else {
    job.rules->opaque ? Rasterizer<false, true, kClips>(job, tile).run()
                      : Rasterizer<false, false, kClips>(job, tile).run();
  }
}

void rasterize_tile_simd(const TileJob& job, TileABuffer& tile) {
  job.clips ? rasterize<true>(job, tile) : rasterize<false>(job, tile);
}

void find_covering_simd(const TileABuffer& tile, CoveringDepths& depths) {
  tile.layout.opaque ? find_covering_depths<true>(tile, depths)
                     : find_covering_depths<false>(tile, depths);
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {

HWY_EXPORT(rasterize_tile_simd);
HWY_EXPORT(find_covering_simd);

void rasterize_tile(const TileJob& job, TileABuffer& tile) {
  HWY_DYNAMIC_DISPATCH(rasterize_tile_simd)(job, tile);
}

namespace {

CoveringDepths covering_depths(const TileABuffer& tile) {
  CoveringDepths depths;
  HWY_DYNAMIC_DISPATCH(find_covering_simd)(tile, depths);
  return depths;
}

/// TileABuffer::hidden_behind() of the pixels from (x0, y0) to (x1, y1), those left out that are
/// not of the tile or not of the picture.
float hidden_within(const TileABuffer& tile, const PixelDepths& covering, int x0, int y0, int x1,
                    int y1) {
  float nearest = -std::numeric_limits<float>::infinity();
  float farthest = -nearest;
  for (int x = std::max(0, x0); x <= std::min(x1, tile.width - 1); ++x) {
    for (int y = std::max(0, y0); y <= std::min(y1, tile.height - 1); ++y) {
      const float depth = covering[static_cast<std::size_t>(tile_pixel(x, y))];
      nearest = std::max(nearest, depth);
      farthest = std::min(farthest, depth);
    }
  }
  return tile.hidden_behind(nearest, farthest);
}

}  // namespace

PixelDepths hidden_in_patches(const TileABuffer& tile, const CoveringDepths& covering) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  const auto is_inside = [&](int pixel) {
    return tile_pixel_x(pixel) < tile.width && tile_pixel_y(pixel) < tile.height;
  };
  const bool whole = is_inside(kTilePixels - 1);
  // Two layers have no room for what may be seen behind an edge.
  constexpr int kFewLayers = 2;
  PixelDepths hidden = covering.nearest;
  for (int first = 0; first < kTilePixels; first += kPatchPixels) {
    if (tile.layout.layers <= kFewLayers) break;
    float nearest = -kInfinity;
    float farthest = kInfinity;
    for (int pixel = first; pixel < first + kPatchPixels; ++pixel) {
      if (!whole && !is_inside(pixel)) continue;
      const float depth = covering.nearest[static_cast<std::size_t>(pixel)];
      nearest = std::max(nearest, depth);
      farthest = std::min(farthest, depth);
    }
    const float behind = tile.hidden_behind(nearest, farthest);
    for (int pixel = first; pixel < first + kPatchPixels; ++pixel) {
      const auto place = static_cast<std::size_t>(pixel);
      hidden[place] = std::max(behind, covering.alone[place]);
    }
  }
  for (int pixel = 0; pixel < kTilePixels && !whole; ++pixel) {
    if (!is_inside(pixel)) hidden[static_cast<std::size_t>(pixel)] = kInfinity;
  }
  return hidden;
}

PixelDepths find_hidden(const TileABuffer& tile) {
  return hidden_in_patches(tile, covering_depths(tile));
}

void drop_hidden(TileABuffer& tile) {
  if (tile.layout.layers < 2) return;
  constexpr int kAround = 2;
  std::optional<CoveringDepths> covering;
  PixelDepths hidden;
  for (int pixel = 0; pixel < kTilePixels; ++pixel) {
    if (tile.at(1, kWeight, pixel) == 0) continue;
    if (!covering) {
      covering = covering_depths(tile);
      hidden = hidden_in_patches(tile, *covering);
    }
    const auto place = static_cast<std::size_t>(pixel);
    drop_behind(tile, pixel, hidden[place], covering->nearest[place]);
    if (tile.at(1, kWeight, pixel) == 0) continue;
    const int x = tile_pixel_x(pixel);
    const int y = tile_pixel_y(pixel);
    const float around =
        hidden_within(tile, covering->nearest, x - kAround, y - kAround, x + kAround, y + kAround);
    drop_behind(tile, pixel, around, around);
  }
}

}  // namespace surfel
#endif
