// Zhang, Pajarola, "Single-Pass Point Rendering and Transparent Shading", 2006: Algorithm 1.

#include <algorithm>
#include <bit>
#include <cmath>

#include <surfel/render/group_raster.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/render/group_raster.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <surfel/render/kernel_raster-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {
namespace {

/// Places of a splat's attributes among its floats.
constexpr int kSplatFloats = sizeof(Splat) / sizeof(float);
constexpr int kRedFloat = offsetof(Splat, red) / sizeof(float);
constexpr int kTagFloat = offsetof(Splat, tag) / sizeof(float);
constexpr int kNormalFloats = sizeof(SplatNormal) / sizeof(float);

float* at(GroupImages& images, int group, GroupImages::Channel channel, std::size_t pixel) {
  return images.plane(group, channel) + pixel;
}

/// Of every pixel, the depth that a splat must reach for something of it to be seen: that of the
/// nearest surface, where it covers the pixel; minus infinity where it does not. Returns the least.
float find_hidden(GroupImages& images, const TileABuffer& weights, const float* outside,
                  float* hidden) {
  const D d;
  V least = hn::Set(d, __builtin_inff());
  for (std::size_t pixel = 0; pixel < kTilePixels; pixel += hn::Lanes(d)) {
    V nearest = hn::Set(d, -__builtin_inff());
    for (int k = 0; k < images.groups(); ++k) {
      const M used = hn::Gt(hn::Load(d, at(images, k, GroupImages::kRho, pixel)), hn::Zero(d));
      const V depth = hn::Load(d, at(images, k, GroupImages::kDepth, pixel));
      nearest = hn::IfThenElse(used, hn::Max(nearest, depth), nearest);
    }
    V weight = hn::Zero(d);
    for (int k = 0; k < images.groups(); ++k) {
      const V rho = hn::Load(d, at(images, k, GroupImages::kRho, pixel));
      const V reach = hn::Load(d, at(images, k, GroupImages::kReach, pixel));
      weight = hn::Add(weight, hn::IfThenElseZero(hn::Ge(reach, nearest), rho));
    }
    const M covered = hn::Ge(weight, hn::Set(d, weights.edge_weight));
    const V h = hn::Max(hn::IfThenElse(covered, nearest, hn::Set(d, -__builtin_inff())),
                        hn::Load(d, outside + pixel));
    hn::Store(h, d, hidden + pixel);
    least = hn::Min(least, h);
  }
  return hn::GetLane(hn::MinOfLanes(d, least));
}

/// Number of the step of SP06 (6) that a depth is in, counted from the nearest.
HWY_INLINE V depth_step(const LayerRule& rule, V depth) {
  const D d;
  const V z = rule.orthographic ? hn::Neg(depth) : hn::Div(hn::Set(d, 1.0F), depth);
  return hn::Floor(
      hn::Mul(hn::Sub(z, hn::Set(d, rule.nearest)), hn::Set(d, rule.steps_per_unit)));
}

template <Voronoi kVoronoi>
void rasterize(const TileJob& job, const LayerRule& rule, bool skip_hidden,
               const TileABuffer& weights, GroupImages& images) {
  // A check costs as much as some dozen splats for every ten groups.
  constexpr std::size_t kCheckEvery = 256;
  const D d;
  const hn::RebindToUnsigned<D> du;
  const KernelRaster raster(job, weights.x0, weights.y0);
  const V cutoff = hn::Set(d, raster.cutoff());
  const V inv_cutoff = hn::Set(d, 1 / raster.cutoff());
  HWY_ALIGN float outside[kTilePixels];
  HWY_ALIGN float hidden[kTilePixels];
  for (int p = 0; p < kTilePixels; ++p) {
    const bool inside = tile_pixel_x(p) < weights.width && tile_pixel_y(p) < weights.height;
    hidden[p] = outside[p] = inside ? -__builtin_inff() : __builtin_inff();
  }
  float least = -__builtin_inff();
  for (std::size_t i = 0; i < job.count; ++i) {
    if (skip_hidden && i % kCheckEvery == kCheckEvery - 1) {
      least = find_hidden(images, weights, outside, hidden);
    }
    raster.prefetch(i);
    const std::uint32_t index = job.order[i];
    const Splat& splat = job.splats[index];
    if (splat.depth + (1 + job.depth_epsilon) * splat.depth_range < least) continue;
    const int group = job.groups[index];
    const std::uint32_t side = splat.tag & kFrontTag;
    const auto entry = hn::Set(du, index << 1 | side);
    float* image = images.plane(group, 0);
    raster.draw(index, [&](std::size_t pixel, V beta, V depth, V epsilon,
                           const auto& amplitude) HWY_ATTR {
      const V reach = hn::Add(depth, epsilon);
      const M inside = hn::And(hn::Lt(beta, cutoff), hn::Ge(reach, hn::LoadU(d, hidden + pixel)));
      if (hn::AllFalse(d, inside)) return;
      const auto plane = [&](int channel) { return image + channel * kTilePixels + pixel; };
      const V old_rho = hn::LoadU(d, plane(GroupImages::kRho));
      const V old_depth = hn::LoadU(d, plane(GroupImages::kDepth));
      M wins = hn::Gt(depth, old_depth);
      V key = hn::Zero(d);
      if constexpr (kVoronoi == Voronoi::kQuantised) {
        key = hn::Add(depth_step(rule, depth), hn::Sqrt(hn::Mul(beta, inv_cutoff)));
        wins = hn::Lt(key, hn::LoadU(d, plane(GroupImages::kKey)));
      } else if constexpr (kVoronoi == Voronoi::kWindowed) {
        key = beta;  // Its root orders fragments alike.
        const auto old_entry = hn::BitCast(du, hn::LoadU(d, plane(GroupImages::kEntry)));
        const M same_side = hn::RebindMask(
            d, hn::Eq(hn::And(hn::Xor(old_entry, entry), hn::Set(du, 1U)), hn::Zero(du)));
        const M near = hn::Lt(hn::Abs(hn::Sub(depth, old_depth)), epsilon);
        const M same = hn::And(same_side, near);
        const M closer = hn::Lt(key, hn::LoadU(d, plane(GroupImages::kKey)));
        wins = hn::Or(hn::And(same, closer), hn::AndNot(same, wins));
      }
      wins = hn::And(inside, hn::Or(wins, hn::Eq(old_rho, hn::Zero(d))));
      if (hn::AllFalse(d, wins)) return;
      const V rho = hn::Mul(amplitude(), raster.decay(inside, beta));
      const auto put = [&](int channel, V value) HWY_ATTR {
        hn::BlendedStore(value, wins, d, plane(channel));
      };
      put(GroupImages::kRho, rho);
      put(GroupImages::kDepth, depth);
      put(GroupImages::kReach, reach);
      if constexpr (kVoronoi != Voronoi::kOff) put(GroupImages::kKey, key);
      put(GroupImages::kEntry, hn::BitCast(d, entry));
    });
  }
}

template <bool kNormals, bool kOpaqueSplats>
void composite(const TileJob& job, GroupImages& images, TileABuffer& tile) {
  const D d;
  const hn::RebindToSigned<D> di;
  const hn::RebindToUnsigned<D> du;
  const auto* splats = reinterpret_cast<const float*>(job.splats);
  const auto* normals = reinterpret_cast<const float*>(job.normals);
  const V none = hn::Set(d, -__builtin_inff());
  const V groups = hn::Set(d, static_cast<float>(images.groups()));
  for (std::size_t pixel = 0; pixel < kTilePixels; pixel += hn::Lanes(d)) {
    M open = hn::Eq(none, none);
    V taken = hn::Zero(d);
    for (int layer = 0; layer < tile.layout.layers; ++layer) {
      V nearest = none;
      auto nearest_entry = hn::Zero(du);
      for (int k = 0; k < images.groups(); ++k) {
        const V rho = hn::Load(d, at(images, k, GroupImages::kRho, pixel));
        const V depth = hn::Load(d, at(images, k, GroupImages::kDepth, pixel));
        const auto entry =
            hn::BitCast(du, hn::Load(d, at(images, k, GroupImages::kEntry, pixel)));
        const M nearer = hn::And(hn::Gt(rho, hn::Zero(d)), hn::Gt(depth, nearest));
        nearest = hn::IfThenElse(nearer, depth, nearest);
        nearest_entry = hn::IfThenElse(hn::RebindMask(du, nearer), entry, nearest_entry);
      }
      open = hn::And(open, hn::Gt(nearest, none));
      if (hn::AllFalse(d, open)) break;
      const auto splat_at = [&](auto entry) HWY_ATTR {
        return hn::BitCast(di, hn::ShiftRight<1>(entry));
      };
      V sum[kNormalZ + 1];
      for (V& s : sum) s = hn::Zero(d);
      V joined = hn::Zero(d);
      for (int k = 0; k < images.groups(); ++k) {
        float* rhos = at(images, k, GroupImages::kRho, pixel);
        const V rho = hn::Load(d, rhos);
        const V depth = hn::Load(d, at(images, k, GroupImages::kDepth, pixel));
        const V reach = hn::Load(d, at(images, k, GroupImages::kReach, pixel));
        const auto entry =
            hn::BitCast(du, hn::Load(d, at(images, k, GroupImages::kEntry, pixel)));
        const M same_side = hn::RebindMask(
            d, hn::Eq(hn::And(hn::Xor(entry, nearest_entry), hn::Set(du, 1U)), hn::Zero(du)));
        const M joins = hn::And(hn::And(open, same_side),
                                hn::And(hn::Gt(rho, hn::Zero(d)), hn::Ge(reach, nearest)));
        if (hn::AllFalse(d, joins)) continue;
        hn::Store(hn::IfThenZeroElse(joins, rho), d, rhos);
        joined = hn::Add(joined, hn::IfThenElseZero(joins, hn::Set(d, 1.0F)));
        const V w = hn::IfThenElseZero(joins, rho);
        const auto splat = hn::IfThenElseZero(hn::RebindMask(di, joins), splat_at(entry));
        const auto place = hn::Mul(splat, hn::Set(di, kSplatFloats));
        const auto add = [&](int channel, V value) HWY_ATTR {
          sum[channel] = hn::MulAdd(w, value, sum[channel]);
        };
        sum[kWeight] = hn::Add(sum[kWeight], w);
        add(kDepth, depth);
        for (int c = 0; c < (kOpaqueSplats ? 3 : 4); ++c) {
          add(kRed + c, hn::GatherIndex(d, splats + kRedFloat + c, place));
        }
        if constexpr (kNormals) {
          const auto normal = hn::Mul(splat, hn::Set(di, kNormalFloats));
          for (int c = 0; c < kNormalFloats; ++c) {
            add(kNormalX + c, hn::GatherIndex(d, normals + c, normal));
          }
        }
      }
      // What the groups that a surface in front has won would have added, by the mean of the rest.
      const V left = hn::Max(hn::Sub(groups, taken), hn::Set(d, 1.0F));
      const V scale = hn::Div(groups, left);
      taken = hn::Add(taken, joined);
      const auto put = [&](int channel, V value) HWY_ATTR {
        hn::Store(hn::IfThenElseZero(open, value), d, &tile.at(layer, channel, 0) + pixel);
      };
      const int last = kNormals ? kNormalZ : kAlpha;
      for (int c = 0; c <= last; ++c) {
        if (c != kTag && c != kBack) put(c, hn::Mul(scale, sum[c]));
      }
      const auto nearest_place =
          hn::Mul(hn::IfThenElseZero(hn::RebindMask(di, open), splat_at(nearest_entry)),
                  hn::Set(di, kSplatFloats));
      put(kTag, hn::GatherIndex(d, splats + kTagFloat, nearest_place));
      open = hn::And(open, hn::Lt(sum[kWeight], hn::Set(d, tile.edge_weight)));
    }
  }
}

}  // namespace

void rasterize_groups_simd(const TileJob& job, const LayerRule& rule, bool nearest_only,
                           const TileABuffer& weights, GroupImages& images) {
  const bool skip_hidden = job.opaque || nearest_only;
  switch (rule.voronoi) {
    case Voronoi::kOff:
      return rasterize<Voronoi::kOff>(job, rule, skip_hidden, weights, images);
    case Voronoi::kQuantised:
      return rasterize<Voronoi::kQuantised>(job, rule, skip_hidden, weights, images);
    case Voronoi::kWindowed:
      return rasterize<Voronoi::kWindowed>(job, rule, skip_hidden, weights, images);
  }
}

void composite_groups_simd(const TileJob& job, GroupImages& images, TileABuffer& tile) {
  if (job.normals) {
    job.opaque ? composite<true, true>(job, images, tile) : composite<true, false>(job, images, tile);
  } else {
    job.opaque ? composite<false, true>(job, images, tile)
               : composite<false, false>(job, images, tile);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {

HWY_EXPORT(rasterize_groups_simd);
HWY_EXPORT(composite_groups_simd);

void GroupImages::reset(int groups) {
  groups_ = groups;
  data_.resize(static_cast<std::size_t>(groups) * kChannels * kTilePixels);
  for (int k = 0; k < groups; ++k) std::fill_n(plane(k, kRho), kTilePixels, 0.0F);
}

void rasterize_groups(const TileJob& job, const LayerRule& rule, bool nearest_only,
                      const TileABuffer& weights, GroupImages& images) {
  HWY_DYNAMIC_DISPATCH(rasterize_groups_simd)(job, rule, nearest_only, weights, images);
}

void composite_groups(const TileJob& job, GroupImages& images, TileABuffer& tile) {
  HWY_DYNAMIC_DISPATCH(composite_groups_simd)(job, images, tile);
}

}  // namespace surfel
#endif
