// Lights fragments of a vector of pixels. Included once for each target, see Highway's
// documentation.

#if defined(SURFEL_RENDER_LAMPS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SURFEL_RENDER_LAMPS_INL_H_
#undef SURFEL_RENDER_LAMPS_INL_H_
#else
#define SURFEL_RENDER_LAMPS_INL_H_
#endif

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include <hwy/highway.h>
#include <surfel/base/fused-inl.h>
#include <surfel/base/power-inl.h>
#include <surfel/render/a_buffer.h>
#include <surfel/render/kernel_raster-inl.h>
#include <surfel/render/lighting-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {

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
  return mul_add(a.x, b.x, mul_add(a.y, b.y, hn::Mul(a.z, b.z)));
}
HWY_INLINE V3 normalized(const V3& a) { return hn::Div(hn::Set(D(), 1), hn::Sqrt(dot(a, a))) * a; }
HWY_INLINE V3 select(M mask, const V3& yes, const V3& no) {
  return {hn::IfThenElse(mask, yes.x, no.x), hn::IfThenElse(mask, yes.y, no.y),
          hn::IfThenElse(mask, yes.z, no.z)};
}

HWY_INLINE hn::Vec<Tags> tag_bits(V tag, std::uint32_t bits) {
  return hn::And(hn::BitCast(Tags(), tag), hn::Set(Tags(), bits));
}

/// The fragments that have the material of a tag.
HWY_INLINE M of_material(V tag, std::uint32_t material) {
  const std::uint32_t bits = ~std::uint32_t{0} << kMaterialShift;
  return hn::RebindMask(D(), hn::Eq(tag_bits(tag, bits), hn::Set(Tags(), material & bits)));
}

/// Fragments of a vector of pixels, one of each.
struct Fragments {
  V weight;  ///< 0: the pixel has none; negative: merged.
  V depth;
  V3 color;
  V alpha, tag;
  V3 normal;  ///< Only in shaded pictures.
};

/// See lit_color().
struct LaneOps {
  static HWY_INLINE V3 set(const float* v) { return HWY_NAMESPACE::set(v); }
  static HWY_INLINE V dot(const V3& a, const V3& b) { return HWY_NAMESPACE::dot(a, b); }
  static HWY_INLINE V length(const V3& a) { return hn::Sqrt(dot(a, a)); }
  static HWY_INLINE V3 normalized(const V3& a) { return HWY_NAMESPACE::normalized(a); }
  static HWY_INLINE V positive_part(V x) { return hn::Max(x, hn::Zero(D())); }
  static HWY_INLINE V highlight(V cosine, V half_cosine, V length, float shininess) {
    const D d;
    const V one = hn::Set(d, 1);
    const V s = hn::Set(d, shininess);
    const V exponent = hn::Div(hn::Mul(s, length), mul_add(s, hn::Sub(one, length), length));
    const V scale = hn::Div(hn::Add(one, exponent), hn::Add(one, s));
    const V lobe =
        shininess == 0 ? one : power_of_floats(d, hn::Div(half_cosine, length), exponent);
    return hn::IfThenElseZero(hn::Gt(cosine, hn::Zero(d)), hn::Mul(scale, lobe));
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
    const V length = hn::Sqrt(dot(at.normal, at.normal));
    const M has_normal = hn::Gt(length, zero);
    const V3 mean = hn::Div(hn::Set(d, 1), hn::Max(at.weight, length)) * at.normal;
    V3 normal = select(has_normal, mean, to_eye);
    const M back = hn::RebindMask(d, hn::Eq(tag_bits(at.tag, kFrontTag), hn::Zero(Tags())));
    const M away = lighting_.mapped ? hn::And(has_normal, back) : hn::Lt(dot(normal, to_eye), zero);
    normal = select(away, hn::Set(d, -1) * normal, normal);

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

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#endif
