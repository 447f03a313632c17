// Zhang, Pajarola, "Single-Pass Point Rendering and Transparent Shading", 2006: Algorithm 1.

#include <algorithm>
#include <bit>
#include <cmath>

#include <surfel/sp06/group_raster.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/sp06/group_raster.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <surfel/base/fused-inl.h>
#include <surfel/render/kernel_raster-inl.h>
#include <surfel/sp06/layer_rule-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {

namespace {

/// Places of a splat's attributes among its floats.
constexpr int kSplatFloats = sizeof(Splat) / sizeof(float);
constexpr int kRedFloat = offsetof(Splat, red) / sizeof(float);
constexpr int kTagFloat = offsetof(Splat, tag) / sizeof(float);
constexpr int kNormalFloats = sizeof(SplatNormal) / sizeof(float);

float* at(GroupImages& images, int image, GroupImages::Channel channel, std::size_t pixel) {
  return images.plane(image, channel) + pixel;
}

/// Whether two fragments show the same side of their surface.
template <class Entry>
HWY_INLINE M same_side(Entry a, Entry b) {
  const hn::RebindToUnsigned<D> du;
  return hn::RebindMask(D(), hn::Eq(hn::And(hn::Xor(a, b), hn::Set(du, kFrontTag)), hn::Zero(du)));
}

HWY_INLINE hn::Vec<Tags> entries(GroupImages& images, int image, std::size_t pixel) {
  return hn::BitCast(Tags(), hn::Load(D(), at(images, image, GroupImages::kEntry, pixel)));
}

/// The nearest fragments of a vector of pixels.
struct NearestFragments {
  V depth;  ///< Minus infinity where there are none.
  hn::Vec<Tags> entry;
};

/// Looks through the first `count` images.
HWY_INLINE NearestFragments nearest_of(GroupImages& images, int count, std::size_t pixel) {
  const D d;
  NearestFragments nearest{hn::Set(d, -__builtin_inff()), hn::Zero(Tags())};
  for (int k = 0; k < count; ++k) {
    const V sum = hn::Load(d, at(images, k, GroupImages::kSum, pixel));
    const V depth = hn::Load(d, at(images, k, GroupImages::kNearness, pixel));
    const M nearer = hn::And(hn::Gt(sum, hn::Zero(d)), hn::Gt(depth, nearest.depth));
    nearest.depth = hn::IfThenElse(nearer, depth, nearest.depth);
    nearest.entry =
        hn::IfThenElse(hn::RebindMask(Tags(), nearer), entries(images, k, pixel), nearest.entry);
  }
  return nearest;
}

/// For every pixel the depth that a splat must reach to be seen: the nearest surface's, where it
/// covers the pixel; minus infinity where it does not.
void find_hidden(GroupImages& images, const TileABuffer& weights, const float* outside,
                 float* hidden) {
  const D d;
  for (std::size_t pixel = 0; pixel < kTilePixels; pixel += hn::Lanes(d)) {
    const auto [nearest, nearest_entry] = nearest_of(images, images.groups(), pixel);
    V weight = hn::Zero(d);
    for (int k = 0; k < images.groups(); ++k) {
      const V sum = hn::Load(d, at(images, k, GroupImages::kSum, pixel));
      const V reach = hn::Load(d, at(images, k, GroupImages::kReach, pixel));
      const M joins =
          hn::And(hn::Ge(reach, nearest), same_side(entries(images, k, pixel), nearest_entry));
      weight = hn::Add(weight, hn::IfThenElseZero(joins, sum));
    }
    const M covered = hn::Ge(weight, hn::Set(d, weights.edge_weight));
    hn::Store(hn::Max(hn::IfThenElse(covered, nearest, hn::Set(d, -__builtin_inff())),
                      hn::Load(d, outside + pixel)),
              d, hidden + pixel);
  }
}

/// Fragments of a group's image, a vector of them: see GroupImages::Channel.
struct GroupFragments {
  V sum, rho, depth, reach, key, entry;
};

/// Puts fragments where they belong among the layers of a group.
template <Voronoi kVoronoi>
HWY_INLINE void insert(GroupImages& images, int group, std::size_t pixel, M open,
                       GroupFragments f) {
  const D d;
  const hn::RebindToUnsigned<D> du;
  for (int layer = 0; layer < images.layers(); ++layer) {
    float* fragment = images.plane(images.image(group, layer), 0) + pixel;
    const auto load = [&](GroupImages::Channel c)
                          HWY_ATTR { return hn::Load(d, fragment + c * kTilePixels); };
    const auto store = [&](GroupImages::Channel c, V value, M where) HWY_ATTR {
      hn::BlendedStore(value, where, d, fragment + c * kTilePixels);
    };
    const GroupFragments old{load(GroupImages::kSum),      load(GroupImages::kRho),
                             load(GroupImages::kNearness), load(GroupImages::kReach),
                             load(GroupImages::kKey),      load(GroupImages::kEntry)};
    const M used = hn::Gt(old.sum, hn::Zero(d));
    const M near = hn::Lt(hn::Abs(hn::Sub(f.depth, old.depth)), hn::Sub(f.reach, f.depth));
    const M same = hn::And(near, same_side(hn::BitCast(du, old.entry), hn::BitCast(du, f.entry)));
    M nearer = hn::Gt(f.depth, old.depth);
    M wins = nearer;
    if constexpr (kVoronoi != Voronoi::kOff) wins = hn::Lt(f.key, old.key);
    if constexpr (kVoronoi == Voronoi::kQuantised) nearer = wins;
    const M merges = hn::And(open, hn::And(used, same));
    const M free = hn::AndNot(used, open);
    const M pushes = hn::And(hn::And(open, used), hn::AndNot(same, nearer));
    const M puts = hn::Or(hn::Or(free, pushes), hn::And(merges, wins));
    const M changes = hn::Or(puts, merges);
    if (!hn::AllFalse(d, changes)) {
      store(GroupImages::kSum, hn::Add(hn::IfThenElseZero(merges, old.sum), f.sum), changes);
      store(GroupImages::kRho, f.rho, puts);
      store(GroupImages::kNearness, f.depth, puts);
      store(GroupImages::kReach, f.reach, puts);
      store(GroupImages::kKey, f.key, puts);
      store(GroupImages::kEntry, f.entry, puts);
    }
    open = hn::AndNot(hn::Or(free, merges), open);
    if (hn::AllFalse(d, open)) return;
    // The fragment that has been pushed out goes on to the next layer.
    const auto carry = [&](V& value, V pushed)
                           HWY_ATTR { value = hn::IfThenElse(pushes, pushed, value); };
    carry(f.sum, old.sum);
    carry(f.rho, old.rho);
    carry(f.depth, old.depth);
    carry(f.reach, old.reach);
    carry(f.key, old.key);
    carry(f.entry, old.entry);
  }
}

template <Voronoi kVoronoi>
void rasterize(const TileJob& job, const LayerRule& rule, bool skip_hidden,
               const TileABuffer& weights, GroupImages& images) {
  // A check costs as much as some dozen splats for every ten groups.
  constexpr std::size_t kCheckEvery = 256;
  const D d;
  const hn::RebindToUnsigned<D> du;
  const KernelRaster raster(job, weights.x0, weights.y0);
  const V cutoff = hn::Set(d, job.rules->cutoff);
  const V inv_cutoff = hn::Set(d, 1 / job.rules->cutoff);
  HWY_ALIGN float outside[kTilePixels];
  HWY_ALIGN float hidden[kTilePixels];
  for (int p = 0; p < kTilePixels; ++p) {
    const bool inside = tile_pixel_x(p) < weights.width && tile_pixel_y(p) < weights.height;
    hidden[p] = outside[p] = inside ? -__builtin_inff() : __builtin_inff();
  }
  for (std::size_t begin = 0; begin < job.count; begin += kCheckEvery) {
    if (skip_hidden && begin > 0) find_hidden(images, weights, outside, hidden);
    raster.draw(begin, std::min(begin + kCheckEvery, job.count), hidden,
                [&](std::uint32_t index, std::size_t pixel, const Sample& s) HWY_ATTR {
                  const V reach = hn::Add(s.depth, s.epsilon);
                  const M inside =
                      hn::And(hn::Lt(s.beta, cutoff), hn::Ge(reach, hn::Load(d, hidden + pixel)));
                  if (hn::AllFalse(d, inside)) return;
                  const V rho = hn::Mul(s.amplitude, raster.sampler().decay(s.beta));
                  V key = s.beta;  // Its root orders fragments alike.
                  if constexpr (kVoronoi == Voronoi::kQuantised) {
                    key = hn::Add(depth_step(rule, s.depth), hn::Sqrt(hn::Mul(s.beta, inv_cutoff)));
                  }
                  const std::uint32_t side = job.splats[index].tag & kFrontTag;
                  const V entry = hn::BitCast(d, hn::Set(du, index << 1 | side));
                  insert<kVoronoi>(images, job.groups[index], pixel, inside,
                                   {rho, rho, s.depth, reach, key, entry});
                });
  }
}

/// Composites the images of a tile: see composite_groups().
template <bool kNormals, bool kOpaqueSplats>
class ImageCompositor {
 public:
  ImageCompositor(const TileJob& job, GroupImages& images, TileABuffer& tile)
      : splats_(reinterpret_cast<const float*>(job.splats)),
        normals_(reinterpret_cast<const float*>(job.normals)),
        images_(images),
        tile_(tile) {}

  void run() const {
    const D d;
    const V none = hn::Set(d, -__builtin_inff());
    for (std::size_t pixel = 0; pixel < kTilePixels; pixel += hn::Lanes(d)) {
      M open = hn::Eq(none, none);
      for (int layer = 0; layer < tile_.layout.layers; ++layer) {
        // The fragment in front of all is among the nearest of each group.
        const int count = images_.groups() * (layer == 0 ? 1 : images_.layers());
        const NearestFragments nearest = nearest_of(images_, count, pixel);
        open = hn::And(open, hn::Gt(nearest.depth, none));
        if (hn::AllFalse(d, open)) break;
        const Surface surface = take_surface(count, pixel, open, nearest);
        store(layer, pixel, open, nearest, surface);
        open = hn::And(open, hn::Lt(surface.weight, hn::Set(d, tile_.edge_weight)));
      }
    }
  }

 private:
  /// Surface fragments of a vector of pixels.
  struct Surface {
    V sum[kNormalZ + 1];  ///< By FragmentChannel; weighted by the rho of the winning fragments.
    V weight;             ///< Sum of all kernels.
    V other_weight;       ///< Sum of rho of the materials other than the nearest fragment's ...
    hn::Vec<Tags> other;  ///< ... and the last one's number.
  };

  static HWY_INLINE hn::Vec<Ints> splat_of(hn::Vec<Tags> entry) {
    return hn::BitCast(Ints(), hn::ShiftRight<1>(entry));
  }

  /// Figure 5 goes by the nearest fragment, which lets the far fragments of a steep or noisy
  /// surface fall off as another layer; the mean depth of the fragments that the nearest one joins
  /// does not.
  HWY_INLINE V anchor(int count, std::size_t pixel, const NearestFragments& nearest) const {
    const D d;
    V weight = hn::Zero(d);
    V weighted_depth = hn::Zero(d);
    for (int k = 0; k < count; ++k) {
      const V rho = hn::Load(d, at(images_, k, GroupImages::kRho, pixel));
      const V depth = hn::Load(d, at(images_, k, GroupImages::kNearness, pixel));
      const M joins = joining(k, pixel, nearest, nearest.depth);
      const V w = hn::IfThenElseZero(joins, rho);
      weight = hn::Add(weight, w);
      weighted_depth = mul_add(w, hn::IfThenElseZero(joins, depth), weighted_depth);
    }
    return hn::Min(nearest.depth, hn::Div(weighted_depth, weight));
  }

  /// The fragments of an image that show the nearest fragment's side and lie within their epsilon
  /// of a depth.
  HWY_INLINE M joining(int image, std::size_t pixel, const NearestFragments& nearest,
                       V depth) const {
    const D d;
    const V sum = hn::Load(d, at(images_, image, GroupImages::kSum, pixel));
    const V reach = hn::Load(d, at(images_, image, GroupImages::kReach, pixel));
    return hn::And(same_side(entries(images_, image, pixel), nearest.entry),
                   hn::And(hn::Gt(sum, hn::Zero(d)), hn::Ge(reach, depth)));
  }

  /// Sums up the fragments of the nearest surface and takes them out of their images.
  HWY_INLINE Surface take_surface(int count, std::size_t pixel, M open,
                                  const NearestFragments& nearest) const {
    const D d;
    const Ints di;
    const V anchor_depth = anchor(count, pixel, nearest);
    const auto material = material_of(hn::RebindMask(di, open), splat_of(nearest.entry));
    Surface out;
    out.other_weight = hn::Zero(d);
    out.other = hn::Zero(Tags());
    for (V& s : out.sum) s = hn::Zero(d);
    out.weight = hn::Zero(d);
    for (int k = 0; k < count; ++k) {
      const M joins = hn::And(open, joining(k, pixel, nearest, anchor_depth));
      if (hn::AllFalse(d, joins)) continue;
      float* const group_sums = at(images_, k, GroupImages::kSum, pixel);
      const V group_sum = hn::Load(d, group_sums);
      hn::Store(hn::IfThenZeroElse(joins, group_sum), d, group_sums);
      out.weight = hn::Add(out.weight, hn::IfThenElseZero(joins, group_sum));
      const V w = hn::IfThenElseZero(joins, hn::Load(d, at(images_, k, GroupImages::kRho, pixel)));
      const auto splat =
          hn::IfThenElseZero(hn::RebindMask(di, joins), splat_of(entries(images_, k, pixel)));
      const auto place = hn::Mul(splat, hn::Set(di, kSplatFloats));
      // Values are masked, as the fragment of a pixel that does not join may hold any bits, and 0
      // times them may be NaN.
      const auto add = [&](int channel, V value) HWY_ATTR {
        out.sum[channel] = mul_add(w, hn::IfThenElseZero(joins, value), out.sum[channel]);
      };
      out.sum[kWeight] = hn::Add(out.sum[kWeight], w);
      add(kDepth, hn::Load(d, at(images_, k, GroupImages::kNearness, pixel)));
      for (int c = 0; c < (kOpaqueSplats ? 3 : 4); ++c) {
        add(kRed + c, hn::GatherIndex(d, splats_ + kRedFloat + c, place));
      }
      if constexpr (kNormals) {
        const auto normal = hn::Mul(splat, hn::Set(di, kNormalFloats));
        for (int c = 0; c < kNormalFloats; ++c) {
          add(kNormalX + c, hn::GatherIndex(d, normals_ + c, normal));
        }
      }
      if constexpr (kNormals && !kOpaqueSplats) {
        const auto own = material_of(hn::RebindMask(di, joins), splat);
        const auto differs = hn::And(hn::RebindMask(Tags(), joins), hn::Ne(own, material));
        out.other = hn::IfThenElse(differs, own, out.other);
        out.other_weight =
            hn::Add(out.other_weight, hn::IfThenElseZero(hn::RebindMask(d, differs), w));
      }
    }
    return out;
  }

  /// The fragment's weight is the sum of all kernels, and its other sums are scaled to it.
  HWY_INLINE void store(int layer, std::size_t pixel, M open, const NearestFragments& nearest,
                        const Surface& surface) const {
    const D d;
    const Ints di;
    const V scale = hn::Div(surface.weight, surface.sum[kWeight]);
    const auto put = [&](int channel, V value) HWY_ATTR {
      hn::Store(hn::IfThenElseZero(open, value), d,
                tile_.fragment(layer, pixel) + channel * kPatchPixels);
    };
    const int last = kNormals ? kNormalZ : kAlpha;
    for (int c = 0; c <= last; ++c) {
      if (c != kTag && c != kBack) put(c, hn::Mul(scale, surface.sum[c]));
    }
    const auto tag = tag_of(hn::RebindMask(di, open), splat_of(nearest.entry));
    put(kTag, hn::BitCast(d, tag));
    if constexpr (kNormals && !kOpaqueSplats) {
      // Of two materials the tag has the one that has more weight.
      const V share = hn::Div(surface.other_weight, surface.sum[kWeight]);
      const M mixed = hn::And(open, hn::Gt(share, hn::Zero(d)));
      if (hn::AllFalse(d, mixed)) return;
      const M more = hn::Gt(share, hn::Set(d, 0.5F));
      const auto swapped = hn::RebindMask(Tags(), more);
      const auto own = hn::ShiftRight<kMaterialShift>(tag);
      const auto flags = hn::And(tag, hn::Set(Tags(), (1U << kMaterialShift) - 1));
      const auto most = hn::IfThenElse(swapped, surface.other, own);
      const auto least = hn::IfThenElse(swapped, own, surface.other);
      put(kTag, hn::BitCast(d, hn::Or(flags, hn::ShiftLeft<kMaterialShift>(most))));
      const V number = hn::ConvertTo(d, hn::BitCast(di, least));
      const V least_share = hn::IfThenElse(more, hn::Sub(hn::Set(d, 1), share), share);
      put(kOther, hn::IfThenElseZero(mixed, hn::Add(number, least_share)));
    }
  }

  template <class Mask>
  HWY_INLINE hn::Vec<Tags> tag_of(Mask where, hn::Vec<Ints> splat) const {
    const auto place = hn::Mul(hn::IfThenElseZero(where, splat), hn::Set(Ints(), kSplatFloats));
    return hn::BitCast(Tags(), hn::GatherIndex(D(), splats_ + kTagFloat, place));
  }
  /// Numbers of splats' materials.
  template <class Mask>
  HWY_INLINE hn::Vec<Tags> material_of(Mask where, hn::Vec<Ints> splat) const {
    return hn::ShiftRight<kMaterialShift>(tag_of(where, splat));
  }

  const float* splats_;
  const float* normals_;
  GroupImages& images_;
  TileABuffer& tile_;
};

template <bool kNormals, bool kOpaqueSplats>
void composite(const TileJob& job, GroupImages& images, TileABuffer& tile) {
  ImageCompositor<kNormals, kOpaqueSplats>(job, images, tile).run();
}

}  // namespace

void rasterize_groups_simd(const TileJob& job, const LayerRule& rule, const TileABuffer& weights,
                           GroupImages& images) {
  const bool skip_hidden = job.rules->opaque || images.layers() == 1;
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
    job.rules->opaque ? composite<true, true>(job, images, tile)
                      : composite<true, false>(job, images, tile);
  } else {
    job.rules->opaque ? composite<false, true>(job, images, tile)
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

void GroupImages::reset(int groups, int layers) {
  groups_ = groups;
  layers_ = layers;
  data_.resize(static_cast<std::size_t>(groups) * layers * kChannels * kTilePixels);
  for (int i = 0; i < groups * layers; ++i) std::fill_n(plane(i, kSum), kTilePixels, 0.0F);
}

void rasterize_groups(const TileJob& job, const LayerRule& rule, const TileABuffer& weights,
                      GroupImages& images) {
  HWY_DYNAMIC_DISPATCH(rasterize_groups_simd)(job, rule, weights, images);
}

void composite_groups(const TileJob& job, GroupImages& images, TileABuffer& tile) {
  HWY_DYNAMIC_DISPATCH(composite_groups_simd)(job, images, tile);
}

}  // namespace surfel
#endif
