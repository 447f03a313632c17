#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

#include <surfel/render/plain_pixels.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/render/plain_pixels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

// After the above, which decides on the target.
#include <hwy/contrib/math/math-inl.h>
#include <surfel/render/kernel_raster-inl.h>
#include <surfel/render/lighting-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {
namespace {

using Tags = hn::RebindToUnsigned<D>;

struct V3 {
  V x, y, z;
};
HWY_INLINE V3 set(const float* v) {
  return {hn::Set(D(), v[0]), hn::Set(D(), v[1]), hn::Set(D(), v[2])};
}
HWY_INLINE V3 operator+(const V3& a, const V3& b) {
  return {hn::Add(a.x, b.x), hn::Add(a.y, b.y), hn::Add(a.z, b.z)};
}
HWY_INLINE V3 operator-(const V3& a, const V3& b) {
  return {hn::Sub(a.x, b.x), hn::Sub(a.y, b.y), hn::Sub(a.z, b.z)};
}
HWY_INLINE V3 operator*(V s, const V3& a) {
  return {hn::Mul(s, a.x), hn::Mul(s, a.y), hn::Mul(s, a.z)};
}
HWY_INLINE V3 operator*(const V3& a, const V3& b) {
  return {hn::Mul(a.x, b.x), hn::Mul(a.y, b.y), hn::Mul(a.z, b.z)};
}
HWY_INLINE V dot(const V3& a, const V3& b) {
  return hn::MulAdd(a.x, b.x, hn::MulAdd(a.y, b.y, hn::Mul(a.z, b.z)));
}
HWY_INLINE V3 normalized(const V3& a) { return hn::Div(hn::Set(D(), 1), hn::Sqrt(dot(a, a))) * a; }
HWY_INLINE V3 select(M mask, const V3& yes, const V3& no) {
  return {hn::IfThenElse(mask, yes.x, no.x), hn::IfThenElse(mask, yes.y, no.y),
          hn::IfThenElse(mask, yes.z, no.z)};
}

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

HWY_INLINE hn::Vec<Tags> tag_bits(V tag, std::uint32_t bits) {
  return hn::And(hn::BitCast(Tags(), tag), hn::Set(Tags(), bits));
}

/// Fragments of a vector of pixels, one of each.
struct Fragments {
  V weight;  ///< 0: the pixel has none; negative: merged.
  V depth;
  V3 color;
  V alpha, tag;
  V3 normal;  ///< Only in shaded pictures.
};

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

/// The nearest fragments behind some depths.
Fragments nearest_behind(const TileABuffer& tile, std::size_t pixel, int layers, V depths) {
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
  }
  return out;
}

TileInside inside_of(const TileABuffer& tile) {
  const D d;
  if (tile.width < kTileSize || tile.height < kTileSize) return TileInside::kNo;
  const auto side = tag_bits(channel(tile, 0, 0, kTag), kFrontTag);
  V least = channel(tile, 0, 0, kWeight);
  for (std::size_t pixel = 0; pixel < kTilePixels; pixel += hn::Lanes(d)) {
    const V weight = channel(tile, 0, pixel, kWeight);
    least = hn::Min(least, weight);
    const V behind = tile.layout.layers > 1 ? channel(tile, 1, pixel, kWeight) : hn::Zero(d);
    const auto other_side = hn::Xor(side, tag_bits(channel(tile, 0, pixel, kTag), kFrontTag));
    if (!hn::AllTrue(d, hn::Eq(behind, hn::Zero(d))) ||
        !hn::AllTrue(Tags(), hn::Eq(other_side, hn::Zero(Tags())))) {
      return TileInside::kNo;
    }
  }
  const float low = hn::GetLane(hn::MinOfLanes(d, least));
  if (!(low > 0 && low >= kInsideShare * tile.full_weight)) return TileInside::kNo;
  return hn::GetLane(side) != 0 ? TileInside::kFront : TileInside::kBack;
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

/// See lit_color().
struct LaneOps {
  static HWY_INLINE V3 set(const float* v) { return HWY_NAMESPACE::set(v); }
  static HWY_INLINE V dot(const V3& a, const V3& b) { return HWY_NAMESPACE::dot(a, b); }
  static HWY_INLINE V length(const V3& a) { return hn::Sqrt(dot(a, a)); }
  static HWY_INLINE V3 normalized(const V3& a) { return HWY_NAMESPACE::normalized(a); }
  static HWY_INLINE V positive_part(V x) { return hn::Max(x, hn::Zero(D())); }
  static HWY_INLINE V highlight(V cosine, V half_cosine, float shininess) {
    if (shininess == 0) return hn::IfThenElseZero(lit(cosine), hn::Set(D(), 1));
    return hn::IfThenElseZero(lit(cosine), pow(half_cosine, hn::Set(D(), shininess)));
  }
  static HWY_INLINE V mean_highlight(V cosine, V half_cosine, V length, float shininess) {
    const D d;
    const V one = hn::Set(d, 1);
    const V s = hn::Set(d, shininess);
    const V exponent = hn::Div(hn::Mul(s, length), hn::MulAdd(s, hn::Sub(one, length), length));
    const V scale = hn::Div(hn::Add(one, exponent), hn::Add(one, s));
    const V lobe = shininess == 0 ? one : pow(hn::Div(half_cosine, length), exponent);
    return hn::IfThenElseZero(lit(cosine), hn::Mul(scale, lobe));
  }

 private:
  static M lit(V cosine) { return hn::Gt(cosine, hn::Zero(D())); }
  /// x to an exponent > 0, of x from 0 to 1; less counts as 0.
  static V pow(V x, V exponent) {
    const D d;
    const M above = hn::Gt(x, hn::Zero(d));
    const V log = hn::Log(d, hn::IfThenElse(above, x, hn::Set(d, 1)));
    return hn::IfThenElseZero(above, hn::Exp(d, hn::Mul(exponent, log)));
  }
};

/// Lights fragments of a vector of pixels as Shader::shade() does.
class Lamps {
 public:
  Lamps(const Lighting& lighting, const TileABuffer& tile)
      : lighting_(lighting),
        right_(column(0)),
        down_(column(1)),
        forward_(column(2)),
        x_(static_cast<float>(tile.x0) + 0.5F - lighting.center_x),
        y_(static_cast<float>(tile.y0) + 0.5F - lighting.center_y) {}

  const Lighting::Reflection& material(std::uint32_t tag) const {
    return lighting_
        .materials[std::min<std::size_t>(tag >> kMaterialShift, lighting_.material_count - 1)];
  }

  /// The fragments' colours, unpremultiplied.
  V3 light(const Fragments& at, std::size_t pixel, const Lighting::Reflection& material) const {
    const D d;
    const V zero = hn::Zero(d);
    const auto first = static_cast<int>(pixel);
    const V x = hn::Add(hn::Load(d, kColumnOfLane),
                        hn::Set(d, x_ + static_cast<float>(tile_pixel_x(first))));
    const V y =
        hn::Add(hn::Load(d, kRowOfLane), hn::Set(d, y_ + static_cast<float>(tile_pixel_y(first))));
    const V3 across = hn::Mul(x, hn::Set(d, lighting_.inv_focal_x)) * right_ +
                      hn::Mul(y, hn::Set(d, lighting_.inv_focal_y)) * down_;
    const V3 ray = lighting_.orthographic ? forward_ : across + forward_;
    const V3 to_eye = hn::Set(d, -1) * normalized(ray);
    const M has_normal = hn::Gt(dot(at.normal, at.normal), zero);
    V3 normal = select(has_normal, normalized(at.normal), to_eye);
    const M back = hn::RebindMask(d, hn::Eq(tag_bits(at.tag, kFrontTag), hn::Zero(Tags())));
    const M away = lighting_.mapped ? hn::And(has_normal, back) : hn::Lt(dot(normal, to_eye), zero);
    normal = select(away, hn::Set(d, -1) * normal, normal);
    if (lighting_.mapped) {
      const V length = hn::Div(hn::Sqrt(dot(at.normal, at.normal)), at.weight);
      const V mean = hn::Min(hn::Set(d, 1), length);
      normal = hn::IfThenElse(has_normal, mean, hn::Set(d, 1)) * normal;
    }

    const auto place = [&]() HWY_ATTR {
      return lighting_.orthographic ? across + hn::Neg(at.depth) * forward_
                                    : hn::Div(hn::Set(d, 1), at.depth) * ray;
    };
    return lit_color<LaneOps>(lighting_, material, hn::Div(hn::Set(d, 1), at.alpha) * at.color,
                              normal, to_eye, place);
  }

 private:
  V3 column(int c) const {
    const auto& m = lighting_.world_from_camera;
    const float v[] = {m[0][c], m[1][c], m[2][c]};
    return set(v);
  }

  const Lighting& lighting_;
  const V3 right_, down_, forward_;
  const float x_, y_;  ///< Centre of the tile's first pixel, from the principal point.
};

/// Stores premultiplied colours over the background.
void store_over(const V3& color, V opacity, const Rgba& background, Rgba& first) {
  const D d;
  const V transmitted = hn::Sub(hn::Set(d, 1), opacity);
  const auto over = [&](V front, float back)
                        HWY_ATTR { return hn::MulAdd(transmitted, hn::Set(d, back), front); };
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
  const V full_weight = hn::Set(d, tile.full_weight);
  out.inside = inside_of(tile);
  out.lone.fill(0);
  const V edge_weight = hn::Set(d, tile.edge_weight);
  const M whole = hn::Eq(zero, zero);
  // Rounding makes a sum of rho * alpha for all alpha = 1 no less than this.
  const V opaque = hn::Set(d, 1 - 1e-5F);
  float sum = 0;
  for (std::size_t pixel = 0; pixel < kTilePixels; pixel += hn::Lanes(d)) {
    const FragmentCount fragments = count_fragments(tile, pixel);
    const M lone =
        hn::And(hn::Eq(fragments.count, one), hn::Ne(hn::Load(d, &kNearBorder[pixel]), zero));
    M plain = whole;
    if (lighting && lighting->material_count > 1) {
      plain = with_one_material(tile, pixel, fragments.layers);
    }
    V left = fragments.count;  // Fragments that nothing hides.
    V behind = hn::Set(d, __builtin_inff());
    V3 color{zero, zero, zero};
    V opacity = zero;
    M waits = hn::Ne(zero, zero);  // Other tiles decide whether these are at an edge.
    for (int i = 0; i < fragments.layers; ++i) {
      M open = hn::And(plain, hn::Gt(left, zero));
      if (hn::AllFalse(d, open)) break;
      const Fragments at = nearest_behind(tile, pixel, fragments.layers, behind);
      const M merged = hn::Lt(at.weight, zero);
      const M unmerged = hn::Gt(at.weight, zero);
      const M not_filtered =
          hn::RebindMask(d, hn::Eq(tag_bits(at.tag, kFilteredTag), hn::Zero(Tags())));
      // Inside a tile that lies inside a surface there is no edge.
      const M known = hn::Or(not_filtered, hn::Ge(at.weight, edge_weight));
      const M no_edge = hn::Or(known, out.inside == TileInside::kNo ? lone : whole);
      if (i == 0) waits = hn::AndNot(known, hn::And(lone, unmerged));
      // Of equally near fragments only one lies behind the depths before, so that the pixel is
      // left.
      open = hn::And(open, hn::Or(merged, hn::And(unmerged, no_edge)));
      const V inv_weight = hn::Div(one, hn::IfThenElse(unmerged, at.weight, one));
      const V coverage =
          hn::IfThenElse(unmerged, hn::Min(one, hn::Div(at.weight, full_weight)), one);
      const V alpha = hn::Mul(at.alpha, inv_weight);
      const V front = hn::Mul(alpha, coverage);
      V3 shade = hn::Mul(inv_weight, coverage) * at.color;
      const std::intptr_t first = hn::FindFirstTrue(d, hn::And(open, unmerged));
      if (lighting && first >= 0) {
        // Fragments of one material are shaded; pixels with other materials are left.
        const std::uint32_t tag =
            hn::ExtractLane(hn::BitCast(Tags(), at.tag), static_cast<std::size_t>(first));
        const std::uint32_t material = ~std::uint32_t{0} << kMaterialShift;
        const M same =
            hn::RebindMask(d, hn::Eq(tag_bits(at.tag, material), hn::Set(Tags(), tag & material)));
        open = hn::And(open, hn::Or(merged, same));
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
      opacity = hn::MulAdd(transmitted, hn::IfThenElseZero(open, front), opacity);
      plain = hn::And(plain, hn::Or(open, hn::Le(left, zero)));
      const M hides = hn::And(hn::Ge(at.weight, full_weight), hn::Ge(alpha, opaque));
      left = hn::IfThenZeroElse(hides, hn::Sub(left, one));
      behind = at.depth;
    }
    sum += hn::GetLane(hn::SumOfLanes(d, hn::IfThenElseZero(plain, fragments.sum)));
    store_over(color, opacity, background, out.color[pixel]);
    hn::Store(hn::IfThenZeroElse(plain, one), d, &out.left[pixel]);
    std::uint8_t bits[8] = {};  // StoreMaskBits() may write as many.
    hn::StoreMaskBits(d, hn::And(plain, waits), bits);
    out.lone[pixel / kPatchPixels] |=
        static_cast<std::uint16_t>((bits[0] | bits[1] << 8U) << pixel % kPatchPixels);
  }
  tile.merges.total_weight += sum;
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
