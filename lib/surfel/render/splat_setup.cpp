// Zwicker, Pfister, van Baar, Gross, "Surface Splatting", SIGGRAPH 2001: equations (4) and (6).
// Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 6(1), 2017: the tangent frame.
// ewa_kernel.cpp holds the same in plain double.

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>

#include <surfel/render/splat_setup.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/render/splat_setup.cpp"
#include <hwy/cache_control.h>
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <surfel/base/compress-inl.h>
#include <surfel/base/vec3-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<float, 16>;
using V = hn::Vec<D>;

using Vec3 = HWY_NAMESPACE::Vec3<V>;

HWY_INLINE Vec3 rotate(const float* r, const Vec3& v) {
  const D d;
  const auto row = [&](int i) {
    return hn::MulAdd(hn::Set(d, r[i]), v.x,
                      hn::MulAdd(hn::Set(d, r[i + 1]), v.y, hn::Mul(hn::Set(d, r[i + 2]), v.z)));
  };
  return {row(0), row(3), row(6)};
}

/// Unit tangent perpendicular to the unit vector n.
HWY_INLINE Vec3 any_tangent(const Vec3& n) {
  const D d;
  const V one = hn::Set(d, 1.0F);
  const V sign = hn::CopySign(one, n.z);
  const V a = hn::Div(hn::Set(d, -1.0F), hn::Add(sign, n.z));
  return {hn::MulAdd(hn::Mul(sign, hn::Mul(n.x, n.x)), a, one),
          hn::Mul(sign, hn::Mul(hn::Mul(n.x, n.y), a)), hn::Neg(hn::Mul(sign, n.x))};
}

template <bool kPerspective, bool kAnisotropic>
void set_up(const SplatView& view, const SurfelColumns& in, int count, const SurfelColumns* next,
            Splat* splats, SetUpSplats& out) {
  /// Below this cosine between normal and line of sight the depth gradient and the footprint stop
  /// growing: a grazing plane runs to infinity.
  constexpr float kLeastCosine = 0.1F;
  constexpr float kLeastGradientCosine = 1e-3F;
  constexpr float kInvTwoPi = 0.15915494309189535F;
  constexpr float kLeastAmplitude = 1e-30F;
  /// From the eye's plane, in radii: nearer discs may be seen anywhere.
  constexpr float kLeastDistance = 0.01F;

  const D d;
  const hn::RebindToSigned<D> di;
  const V zero = hn::Zero(d);
  const V one = hn::Set(d, 1.0F);
  const V focal_x = hn::Set(d, view.focal_x);
  const V focal_y = hn::Set(d, view.focal_y);
  const V inv_focal_x = hn::Set(d, 1.0F / view.focal_x);
  const V inv_focal_y = hn::Set(d, 1.0F / view.focal_y);
  const V h2 = hn::Set(d, view.lowpass2);
  const V two_c = hn::Set(d, 2.0F * view.cutoff);
  // Standard deviation of the pixel filter at distance 1.
  const V filter_reach = hn::Sqrt(hn::Mul(two_c, h2));
  const V pixel = hn::Mul(hn::Sqrt(h2), hn::Max(inv_focal_x, inv_focal_y));

  const hn::RebindToUnsigned<D> du;
  const V filtered_diagonal2 = hn::Mul(hn::Set(d, 4.0F), hn::Mul(two_c, h2));
  // From the first pixel of the rectangle whose centre lies at or after lo, or from none left of
  // the rectangle, to the last one at or before hi.
  struct Pixels {
    V unclipped, first, last;
  };
  const auto pixels_of = [&](V lo, V hi, float clip0, float clip1) {
    const V offset = hn::Set(d, clip0 + 0.5F);
    const V first = hn::Ceil(hn::Sub(lo, offset));
    const V last = hn::Floor(hn::Sub(hi, offset));
    return Pixels{first, hn::Max(first, zero), hn::Min(last, hn::Set(d, clip1 - clip0 - 1))};
  };

  const float* ahead[sizeof(SurfelColumns) / sizeof(const float*)];
  int ahead_count = 0;
  if (next) {
    for (const float* column :
         {next->x, next->y, next->z, next->normal_x, next->normal_y, next->normal_z,
          next->deviation_u, next->deviation_v, next->tangent_x, next->tangent_y, next->tangent_z,
          next->area, next->red, next->green, next->blue, next->alpha}) {
      if (column) ahead[ahead_count++] = column;
    }
  }

  Splat dropped;
  int visible_count = 0;
  int exact_count = 0;
  std::size_t first_count = 0;
  for (int i = 0; i < count; i += static_cast<int>(hn::Lanes(d))) {
    for (int column = 0; column < ahead_count; ++column) hwy::Prefetch(ahead[column] + i);
    // Camera space.
    const Vec3 world{hn::LoadU(d, in.x + i), hn::LoadU(d, in.y + i), hn::LoadU(d, in.z + i)};
    Vec3 p = rotate(view.rotation, world);
    p.x = hn::Add(p.x, hn::Set(d, view.translation[0]));
    p.y = hn::Add(p.y, hn::Set(d, view.translation[1]));
    p.z = hn::Add(p.z, hn::Set(d, view.translation[2]));
    const V inv_z = kPerspective ? hn::Div(one, p.z) : one;
    const V X = kPerspective ? hn::Mul(p.x, inv_z) : zero;
    const V Y = kPerspective ? hn::Mul(p.y, inv_z) : zero;
    const V center_x = hn::MulAdd(focal_x, kPerspective ? X : p.x, hn::Set(d, view.center_x));
    const V center_y = hn::MulAdd(focal_y, kPerspective ? Y : p.y, hn::Set(d, view.center_y));
    const V deviation_u = hn::LoadU(d, in.deviation_u + i);
    const V deviation_v = kAnisotropic ? hn::LoadU(d, in.deviation_v + i) : deviation_u;
    const V deviation = hn::Max(deviation_u, deviation_v);
    const V disc = hn::Mul(hn::Sqrt(two_c), deviation);

    // Most clusters that reach over the rectangle's edge have surfels far outside of it. A disc
    // that is not near the eye's plane is within its bounding sphere; see outside() below.
    if (!view.circular) {
      const auto outside = [&](V center, V slope, V focal, float clip0, float clip1) HWY_ATTR {
        const V wide = hn::MulAdd(slope, slope, one);  // >= sqrt(slope^2 + 1)
        const V reach = hn::MulAdd(hn::Mul(focal, hn::Mul(inv_z, disc)),
                                   hn::Mul(hn::Set(d, 4.0F / 3), wide), filter_reach);
        return hn::Or(hn::Lt(hn::Add(center, reach), hn::Set(d, clip0)),
                      hn::Gt(hn::Sub(center, reach), hn::Set(d, clip1)));
      };
      const auto unseen = hn::Or(outside(center_x, X, focal_x, view.clip_x0, view.clip_x1),
                                 outside(center_y, Y, focal_y, view.clip_y0, view.clip_y1));
      const auto far = hn::Lt(hn::Mul(hn::Set(d, 4.0F), disc), p.z);
      if (hn::AllTrue(d, hn::And(unseen, far))) continue;
    }

    const V distance = kPerspective ? hn::Sqrt(dot(p, p)) : one;

    // An unknown normal looks at the eye.
    Vec3 n = rotate(view.rotation, {hn::LoadU(d, in.normal_x + i), hn::LoadU(d, in.normal_y + i),
                                    hn::LoadU(d, in.normal_z + i)});
    const auto unknown = hn::Eq(dot(n, n), zero);
    if (HWY_UNLIKELY(!hn::AllFalse(d, unknown))) {
      const V to_eye = hn::Div(hn::Set(d, -1.0F), distance);
      n.x = hn::IfThenElse(unknown, kPerspective ? hn::Mul(p.x, to_eye) : zero, n.x);
      n.y = hn::IfThenElse(unknown, kPerspective ? hn::Mul(p.y, to_eye) : zero, n.y);
      n.z = hn::IfThenElse(unknown, kPerspective ? hn::Mul(p.z, to_eye) : hn::Neg(one), n.z);
    }

    // Columns of J V^(1/2): see screen_from_tangent_jacobian().
    Vec3 t;
    if constexpr (kAnisotropic) {
      t = rotate(view.rotation, {hn::LoadU(d, in.tangent_x + i), hn::LoadU(d, in.tangent_y + i),
                                 hn::LoadU(d, in.tangent_z + i)});
    } else {
      t = any_tangent(n);
    }
    const Vec3 b = cross(n, t);
    const V scale_x = hn::Mul(focal_x, inv_z);
    const V scale_y = hn::Mul(focal_y, inv_z);
    const V tx = hn::Mul(hn::Mul(scale_x, deviation_u), hn::NegMulAdd(X, t.z, t.x));
    const V ty = hn::Mul(hn::Mul(scale_y, deviation_u), hn::NegMulAdd(Y, t.z, t.y));
    const V bx = hn::Mul(hn::Mul(scale_x, deviation_v), hn::NegMulAdd(X, b.z, b.x));
    const V by = hn::Mul(hn::Mul(scale_y, deviation_v), hn::NegMulAdd(Y, b.z, b.y));

    // Sigma = J V J^T + h^2 I, SS01 (6); |Sigma| as a sum of positive terms.
    const V xx = hn::MulAdd(tx, tx, hn::Mul(bx, bx));
    const V yy = hn::MulAdd(ty, ty, hn::Mul(by, by));
    V Sigma_xx = hn::Add(xx, h2);
    V Sigma_yy = hn::Add(yy, h2);
    V Sigma_xy = hn::MulAdd(tx, ty, hn::Mul(bx, by));
    const V n_ray = hn::MulAdd(n.x, X, hn::MulAdd(n.y, Y, n.z));  // n . (X, Y, 1)
    const V det_J = hn::Mul(hn::Mul(scale_x, scale_y), hn::Abs(n_ray));
    const V det_JV = hn::Mul(det_J, hn::Mul(deviation_u, deviation_v));
    V det_Sigma = hn::MulAdd(det_JV, det_JV, hn::Mul(h2, hn::Add(hn::Add(xx, yy), h2)));
    const V half = hn::Set(d, 0.5F);
    if (view.circular) {
      // The larger eigenvalue.
      const V mean = hn::Mul(half, hn::Add(Sigma_xx, Sigma_yy));
      const V difference = hn::Mul(half, hn::Sub(Sigma_xx, Sigma_yy));
      Sigma_xx =
          hn::Add(mean, hn::Sqrt(hn::MulAdd(difference, difference, hn::Mul(Sigma_xy, Sigma_xy))));
      Sigma_yy = Sigma_xx;
      Sigma_xy = zero;
      det_Sigma = hn::Mul(Sigma_xx, Sigma_xx);
    }
    const V inv_yy = hn::Div(one, Sigma_yy);
    const V inv_det = hn::Div(one, det_Sigma);
    const V amplitude =
        hn::Mul(hn::Mul(hn::Mul(hn::LoadU(d, in.area + i), hn::Set(d, kInvTwoPi)), det_J),
                hn::Sqrt(inv_det));

    // Depth plane: see depth_plane(). n . p = n_ray * p.z.
    const V n_p = kPerspective ? hn::Mul(n_ray, p.z) : n.z;
    const V least = hn::Mul(hn::Set(d, kLeastGradientCosine), distance);
    const V inv_np = hn::Div(one, hn::CopySign(hn::Max(hn::Abs(n_p), least), n_p));
    // Footprint of the combined kernel on the tangent plane: disc and pixel filter, the latter
    // divided by the cosine.
    const V inv_cosine = hn::Min(hn::Mul(hn::Abs(inv_np), distance), hn::Set(d, 1 / kLeastCosine));
    const V pixel_on_plane = hn::Mul(kPerspective ? hn::Mul(pixel, p.z) : pixel, inv_cosine);
    const V reach = hn::Sqrt(
        hn::Mul(two_c, hn::MulAdd(deviation, deviation, hn::Mul(pixel_on_plane, pixel_on_plane))));
    const V depth_reach = hn::Mul(reach, hn::Mul(inv_z, inv_z));  // dz / z^2, of d = 1 / z

    const V half_x = hn::Sqrt(hn::Mul(two_c, Sigma_xx));
    const V half_y = hn::Sqrt(hn::Mul(two_c, Sigma_yy));

    // Where the disc reaches through the near plane, the affine approximation (4) has no meaning.
    // Comparisons are false for NaN.
    const V near = hn::Set(d, view.near);
    const V tolerance = hn::Set(d, view.tolerance);
    const V size2 = hn::Mul(two_c, hn::Add(xx, yy));
    auto exact = hn::FirstN(d, 0);
    auto visible = hn::Not(exact);
    // Most are so small that the angle to the line of sight need not be known for what follows.
    const V least_z = hn::Sub(p.z, disc);
    auto small = hn::Gt(least_z, near);
    if constexpr (kPerspective) {
      const V most_error = hn::Mul(tolerance, least_z);
      small = hn::And(small,
                      hn::Le(hn::Mul(size2, hn::Mul(disc, disc)), hn::Mul(most_error, most_error)));
    }
    if (view.tolerance < 0 || !hn::AllTrue(d, small)) {
      const V sine = hn::Sqrt(hn::Max(zero, hn::NegMulAdd(n.z, n.z, one)));
      const V depth_extent = hn::Mul(disc, sine);
      visible = hn::Gt(hn::Sub(p.z, depth_extent), near);
      // A point of the disc that is nearer than the centre by the share e of its depth is projected
      // 1 / (1 - e) times as far from the centre as (4) says: off by e / (1 - e) of that.
      if (kPerspective && view.tolerance < std::numeric_limits<float>::infinity()) {
        const V error_z = hn::Mul(hn::Sqrt(size2), depth_extent);
        const auto affine =
            hn::And(visible, hn::Le(error_z, hn::Mul(tolerance, hn::Sub(p.z, depth_extent))));
        exact = hn::AndNot(affine, hn::Gt(hn::Add(p.z, depth_extent), near));
        visible = affine;
      }
      if (!hn::AllFalse(d, exact)) {
        // A disc that is far enough from the eye's plane is within its bounding sphere.
        const auto bounded = hn::Gt(least_z, hn::Mul(hn::Set(d, kLeastDistance), disc));
        const auto outside = [&](V center, V slope, V focal, float clip0, float clip1) {
          const V bound = hn::MulAdd(hn::Mul(focal, hn::Sqrt(hn::MulAdd(slope, slope, one))),
                                     hn::Div(disc, least_z), filter_reach);
          return hn::Or(hn::Lt(hn::Add(center, bound), hn::Set(d, clip0)),
                        hn::Gt(hn::Sub(center, bound), hn::Set(d, clip1)));
        };
        const auto unseen = hn::Or(outside(center_x, X, focal_x, view.clip_x0, view.clip_x1),
                                   outside(center_y, Y, focal_y, view.clip_y0, view.clip_y1));
        exact = hn::AndNot(hn::And(bounded, unseen), exact);
      }
    }
    const V depth = kPerspective ? inv_z : hn::Neg(p.z);
    const V depth_dx = hn::Mul(hn::Mul(n.x, inv_np), inv_focal_x);
    const V depth_dy = hn::Mul(hn::Mul(n.y, inv_np), inv_focal_y);
    const Pixels columns =
        pixels_of(hn::Sub(center_x, half_x), hn::Add(center_x, half_x), view.clip_x0, view.clip_x1);
    const Pixels rows =
        pixels_of(hn::Sub(center_y, half_y), hn::Add(center_y, half_y), view.clip_y0, view.clip_y1);
    visible = hn::And(visible,
                      hn::And(hn::Le(columns.first, columns.last), hn::Le(rows.first, rows.last)));
    // Edge-on ones would leave fragments without weight.
    visible = hn::And(visible, hn::Gt(amplitude, hn::Set(d, kLeastAmplitude)));
    const auto front = hn::Lt(n_p, zero);
    if (view.cull_back) {
      visible = hn::And(visible, front);
      exact = hn::And(exact, front);
    }
    const auto index = hn::Iota(di, i);
    const auto exists = hn::RebindMask(d, hn::Lt(index, hn::Set(di, count)));
    visible = hn::And(visible, exists);
    exact = hn::And(exact, exists);

    const auto byte_of = [&](V place) { return hn::BitCast(du, hn::ConvertTo(di, place)); };
    const auto box = hn::Or(
        hn::Or(byte_of(columns.first), hn::ShiftLeft<8>(byte_of(rows.first))),
        hn::Or(hn::ShiftLeft<16>(byte_of(columns.last)), hn::ShiftLeft<24>(byte_of(rows.last))));
    const auto flag = [&](auto mask, std::uint32_t bit) {
      return hn::IfThenElseZero(hn::RebindMask(du, mask), hn::Set(du, bit));
    };
    const V diagonal2 = hn::MulAdd(half_x, half_x, hn::Mul(half_y, half_y));
    const auto tag =
        hn::Or(flag(front, kFrontTag), flag(hn::Lt(diagonal2, filtered_diagonal2), kFilteredTag));
    const V alpha = in.alpha ? hn::LoadU(d, in.alpha + i) : one;
    const auto color = [&](const float* column)
                           HWY_ATTR { return hn::Mul(hn::LoadU(d, column + i), alpha); };
    // Four fields that follow one another in a Splat, of every lane.
    constexpr std::size_t kQuarter = sizeof(Splat) / 4;
    HWY_ALIGN float quarters[4][4 * kTileSize];
    hn::StoreInterleaved4(center_x, center_y, hn::Mul(Sigma_xy, inv_yy),
                          hn::Mul(half, hn::Mul(Sigma_yy, inv_det)), d, quarters[0]);
    hn::StoreInterleaved4(hn::Mul(half, inv_yy), amplitude, depth, depth_dx, d, quarters[1]);
    hn::StoreInterleaved4(depth_dy, depth_reach, hn::BitCast(d, box), color(in.red), d,
                          quarters[2]);
    hn::StoreInterleaved4(color(in.green), color(in.blue), alpha, hn::BitCast(d, tag), d,
                          quarters[3]);
    HWY_ALIGN std::int32_t taken[kTileSize];
    hn::Store(hn::VecFromMask(di, hn::RebindMask(di, visible)), di, taken);
    for (std::size_t lane = 0; lane < hn::Lanes(d); ++lane) {
      // Those that are not visible go where nobody reads.
      auto* const to = reinterpret_cast<std::byte*>(taken[lane] != 0 ? splats : &dropped);
      for (std::size_t q = 0; q < 4; ++q) {
        std::memcpy(to + q * kQuarter, quarters[q] + 4 * lane, kQuarter);
      }
      splats -= taken[lane];
    }
    auto first = visible;
    if (!view.first_column) first = hn::And(first, hn::Ge(columns.unclipped, zero));
    if (!view.first_row) first = hn::And(first, hn::Ge(rows.unclipped, zero));
    first_count += hn::CountTrue(d, first);
    // A whole vector fits: there are no more of either than lanes before.
    const auto note = [&](auto mask, std::int32_t* to, int& noted) HWY_ATTR {
      const Compressor<D> listed(mask);
      listed.store(index, di, to + noted);
      noted += static_cast<int>(listed.count());
    };
    note(visible, out.visible, visible_count);
    if (kPerspective && !hn::AllFalse(d, exact)) note(exact, out.exact, exact_count);
  }
  out.visible_count = visible_count;
  out.exact_count = exact_count;
  out.first_count = static_cast<int>(first_count);
}

}  // namespace

void set_up_splats_simd(const SplatView& view, const SurfelColumns& in, int count,
                        const SurfelColumns* next, Splat* splats, SetUpSplats& out) {
  const bool anisotropic = in.tangent_x != nullptr;
  if (view.orthographic) {
    anisotropic ? set_up<false, true>(view, in, count, next, splats, out)
                : set_up<false, false>(view, in, count, next, splats, out);
  } else {
    anisotropic ? set_up<true, true>(view, in, count, next, splats, out)
                : set_up<true, false>(view, in, count, next, splats, out);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {

HWY_EXPORT(set_up_splats_simd);

void set_up_splats(const SplatView& view, const SurfelColumns& surfels, int count,
                   const SurfelColumns* next, Splat* splats, SetUpSplats& out) {
  HWY_DYNAMIC_DISPATCH(set_up_splats_simd)(view, surfels, count, next, splats, out);
}

}  // namespace surfel
#endif
