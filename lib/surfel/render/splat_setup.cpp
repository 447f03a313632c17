// Zwicker, Pfister, van Baar, Gross, "Surface Splatting", SIGGRAPH 2001: equations (4) and (6).
// Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 6(1), 2017: the tangent frame.
// ewa_kernel.cpp holds these equations in plain double.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>

#include <surfel/render/splat_setup.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/render/splat_setup.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <surfel/base/fused-inl.h>
#include <surfel/base/vec3-inl.h>
#include <surfel/render/half_plane_cuts-inl.h>
#include <surfel/render/projected_splats-inl.h>
#include <surfel/render/splat_writer-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {
namespace {

/// Unit tangent perpendicular to the unit vector n.
HWY_INLINE Vec3V any_tangent(const Vec3V& n) {
  const D d;
  const V one = hn::Set(d, 1.0F);
  const V sign = hn::CopySign(one, n.z);
  const V a = hn::Div(hn::Set(d, -1.0F), hn::Add(sign, n.z));
  return {mul_add(hn::Mul(sign, hn::Mul(n.x, n.x)), a, one),
          hn::Mul(sign, hn::Mul(hn::Mul(n.x, n.y), a)), hn::Neg(hn::Mul(sign, n.x))};
}

/// Below this cosine between normal and line of sight the footprint of the pixel filter on the
/// plane stops growing: a grazing plane runs to infinity. At 0.1 the footprint is ten pixels long.
constexpr float kLeastCosine = 0.1F;
/// Unless the planes of a surface's surfels are off each other by less than this share of it.
constexpr float kEven = 0.5F;
/// The bound of the cosine for the depth gradient, which is exact down to where single precision
/// keeps four digits of the cosine.
constexpr float kLeastGradientCosine = 1e-3F;
constexpr float kInvTwoPi = 0.15915494309189535F;  ///< 1 / (2 pi), of the normalised Gaussian.
/// From the eye's plane, in radii: nearer discs may be seen anywhere.
constexpr float kLeastDistance = 0.01F;

/// Projects the surfels of a cluster, a vector at a time.
template <bool kPerspective, bool kAnisotropic, bool kClips>
class SplatSetup {
 public:
  SplatSetup(const SplatView& view, const SurfelColumns& in)
      : view_(view),
        in_(in),
        cuts_(view),
        focal_x_(hn::Set(D(), view.focal_x)),
        focal_y_(hn::Set(D(), view.focal_y)),
        h2_(hn::Set(D(), view.lowpass2)),
        two_c_(hn::Set(D(), 2.0F * view.cutoff)),
        margin_(hn::Set(D(), view.margin)),
        epsilon_growth_(std::sqrt(std::max(1.0F, view.cutoff))),
        filter_reach_(hn::Add(hn::Sqrt(hn::Mul(two_c_, h2_)), margin_)) {}

  void run(int count, const SurfelColumns* next, Splat* splats, SplatClip* clips,
           SetUpSplats& out) const {
    const D d;
    const Fetcher ahead(next);
    SplatWriter<kClips> writer(in_, view_, splats, clips, out);
    Projected s;
    for (int i = 0; i < count; i += static_cast<int>(hn::Lanes(d))) {
      ahead.fetch(i);
      s.discs = discs(i);
      // Most clusters that reach over the rectangle's edge have surfels far outside of it.
      if (!view_.circular && all_outside(s.discs)) continue;
      const V distance = kPerspective ? hn::Sqrt(dot(s.discs.p, s.discs.p)) : hn::Set(d, 1.0F);
      const Vec3V n = normals(i, s.discs, distance);
      s.axes = axes(i, s.discs, n);
      Shape shape{s.axes, hn::Set(d, 1.0F), hn::Set(d, 1.0F)};
      V dx, dy;  // From the surfel's centre to the one of the kernel.
      M gone = hn::FirstN(d, 0);
      M moved = gone;
      HalfPlanes lines[2];
      if constexpr (kClips) {
        for (int j = 0; j < 2; ++j) lines[j] = cuts_.half_planes(in_.clip[j], i, s);
        if (view_.edges_filtered) {
          const CutGaussians cut = cuts_.cut_filtered(lines, s, shape);
          moved = cut.made;
          gone = cut.gone;
          dx = mul_add(s.axes.tx, cut.mean_u, hn::Mul(s.axes.bx, cut.mean_v));
          dy = mul_add(s.axes.ty, cut.mean_u, hn::Mul(s.axes.by, cut.mean_v));
        }
      }
      s.kernels = kernels(i, s.discs, n, shape);
      s.planes = depth_planes(s.discs, n, s.kernels.n_ray, distance);
      V left = s.kernels.half_x;
      V right = left;
      V up = s.kernels.half_y;
      V down = up;
      if constexpr (kClips) {
        if (!hn::AllFalse(d, moved)) {
          const auto move = [&](V& value, V to)
                                HWY_ATTR { value = hn::IfThenElse(moved, to, value); };
          move(s.discs.x, hn::Add(s.discs.x, dx));
          move(s.discs.y, hn::Add(s.discs.y, dy));
          move(s.planes.depth,
               mul_add(s.planes.depth_dx, dx, mul_add(s.planes.depth_dy, dy, s.planes.depth)));
        }
        s.cuts = cuts_.cuts(n, lines, s);
        gone = hn::Or(gone, s.cuts.gone);
        if (!view_.circular) {
          const auto bound = [&](V& extent, V share) HWY_ATTR {
            extent = hn::IfThenElse(s.cuts.clipped, hn::Mul(extent, share), extent);
          };
          bound(left, s.cuts.left);
          bound(right, s.cuts.right);
          bound(up, s.cuts.up);
          bound(down, s.cuts.down);
        }
      }
      s.columns = pixels(s.discs.x, left, right, view_.clip_x0, view_.clip_x1);
      s.rows = pixels(s.discs.y, up, down, view_.clip_y0, view_.clip_y1);
      s.classes = seen(classify(s.discs, n, s.kernels.size2), s, count - i);
      if constexpr (kClips) s.classes.visible = hn::AndNot(gone, s.classes.visible);
      writer.write(i, s);
    }
    writer.finish();
  }

 private:
  HWY_INLINE Discs discs(int i) const {
    const D d;
    const V zero = hn::Zero(d);
    Discs s;
    s.p = rotate(view_.rotation,
                 {hn::LoadU(d, in_.x + i), hn::LoadU(d, in_.y + i), hn::LoadU(d, in_.z + i)});
    s.p.x = hn::Add(s.p.x, hn::Set(d, view_.translation[0]));
    s.p.y = hn::Add(s.p.y, hn::Set(d, view_.translation[1]));
    s.p.z = hn::Add(s.p.z, hn::Set(d, view_.translation[2]));
    s.inv_z = kPerspective ? hn::Div(hn::Set(d, 1.0F), s.p.z) : hn::Set(d, 1.0F);
    s.slope_x = kPerspective ? hn::Mul(s.p.x, s.inv_z) : zero;
    s.slope_y = kPerspective ? hn::Mul(s.p.y, s.inv_z) : zero;
    s.x = mul_add(focal_x_, kPerspective ? s.slope_x : s.p.x, hn::Set(d, view_.center_x));
    s.y = mul_add(focal_y_, kPerspective ? s.slope_y : s.p.y, hn::Set(d, view_.center_y));
    s.deviation_u = hn::LoadU(d, in_.deviation_u + i);
    s.deviation_v = kAnisotropic ? hn::LoadU(d, in_.deviation_v + i) : s.deviation_u;
    s.deviation = hn::Max(s.deviation_u, s.deviation_v);
    s.radius = hn::Mul(hn::Sqrt(two_c_), s.deviation);
    return s;
  }

  /// Lanes whose splats, `reach_x` and `reach_y` around their centres, miss the rectangle.
  HWY_INLINE M outside(const Discs& s, V reach_x, V reach_y) const {
    const auto beyond = [&](V center, V reach, float clip0, float clip1) HWY_ATTR {
      return hn::Or(hn::Lt(hn::Add(center, reach), hn::Set(D(), clip0)),
                    hn::Gt(hn::Sub(center, reach), hn::Set(D(), clip1)));
    };
    return hn::Or(beyond(s.x, reach_x, view_.clip_x0, view_.clip_x1),
                  beyond(s.y, reach_y, view_.clip_y0, view_.clip_y1));
  }

  /// Whether none of the discs meets the rectangle for sure. A disc that is four radii from the
  /// eye's plane lies within its bounding sphere, whose projection reaches 4 / 3 sqrt(slope^2 + 1)
  /// radius / z around the centre at most; slope^2 + 1 bounds the root.
  HWY_INLINE bool all_outside(const Discs& s) const {
    const D d;
    const auto reach = [&](V slope, V focal) HWY_ATTR {
      const V wide = mul_add(slope, slope, hn::Set(d, 1.0F));
      return mul_add(hn::Mul(focal, hn::Mul(s.inv_z, s.radius)),
                     hn::Mul(hn::Set(d, 4.0F / 3), wide), filter_reach_);
    };
    const M unseen = outside(s, reach(s.slope_x, focal_x_), reach(s.slope_y, focal_y_));
    const M far = hn::Lt(hn::Mul(hn::Set(d, 4.0F), s.radius), s.p.z);
    return hn::AllTrue(d, hn::And(unseen, far));
  }

  /// Normals in camera space. An unknown normal looks at the eye.
  HWY_INLINE Vec3V normals(int i, const Discs& s, V distance) const {
    const D d;
    const V zero = hn::Zero(d);
    Vec3V n =
        rotate(view_.rotation, {hn::LoadU(d, in_.normal_x + i), hn::LoadU(d, in_.normal_y + i),
                                hn::LoadU(d, in_.normal_z + i)});
    const M unknown = hn::Eq(dot(n, n), zero);
    if (HWY_UNLIKELY(!hn::AllFalse(d, unknown))) {
      const V to_eye = hn::Div(hn::Set(d, -1.0F), distance);
      n.x = hn::IfThenElse(unknown, kPerspective ? hn::Mul(s.p.x, to_eye) : zero, n.x);
      n.y = hn::IfThenElse(unknown, kPerspective ? hn::Mul(s.p.y, to_eye) : zero, n.y);
      n.z = hn::IfThenElse(unknown, kPerspective ? hn::Mul(s.p.z, to_eye) : hn::Set(d, -1.0F), n.z);
    }
    return n;
  }

  HWY_INLINE Axes axes(int i, const Discs& s, const Vec3V& n) const {
    const D d;
    // Columns of J V^(1/2): see screen_from_tangent_jacobian().
    Axes out;
    Vec3V& t = out.tangent;
    if constexpr (kAnisotropic) {
      t = rotate(view_.rotation, {hn::LoadU(d, in_.tangent_x + i), hn::LoadU(d, in_.tangent_y + i),
                                  hn::LoadU(d, in_.tangent_z + i)});
    } else {
      t = any_tangent(n);
    }
    const Vec3V b = cross(n, t);
    out.bitangent = b;
    const V scale_x = hn::Mul(focal_x_, s.inv_z);
    const V scale_y = hn::Mul(focal_y_, s.inv_z);
    out.tx = hn::Mul(hn::Mul(scale_x, s.deviation_u), neg_mul_add(s.slope_x, t.z, t.x));
    out.ty = hn::Mul(hn::Mul(scale_y, s.deviation_u), neg_mul_add(s.slope_y, t.z, t.y));
    out.bx = hn::Mul(hn::Mul(scale_x, s.deviation_v), neg_mul_add(s.slope_x, b.z, b.x));
    out.by = hn::Mul(hn::Mul(scale_y, s.deviation_v), neg_mul_add(s.slope_y, b.z, b.y));
    return out;
  }

  HWY_INLINE Kernels kernels(int i, const Discs& s, const Vec3V& n, const Shape& shape) const {
    const D d;
    const auto& [t, b, tx, ty, bx, by] = shape.axes;
    const V scale_x = hn::Mul(focal_x_, s.inv_z);
    const V scale_y = hn::Mul(focal_y_, s.inv_z);
    // Sigma = J V J^T + h^2 I, SS01 (6); |Sigma| as a sum of positive terms.
    const V xx = mul_add(tx, tx, hn::Mul(bx, bx));
    const V yy = mul_add(ty, ty, hn::Mul(by, by));
    V Sigma_xx = hn::Add(xx, h2_);
    V Sigma_yy = hn::Add(yy, h2_);
    V Sigma_xy = mul_add(tx, ty, hn::Mul(bx, by));
    Kernels out;
    out.n_ray = mul_add(n.x, s.slope_x, mul_add(n.y, s.slope_y, n.z));
    const V det_J = hn::Mul(hn::Mul(scale_x, scale_y), hn::Abs(out.n_ray));
    const V det_JV = hn::Mul(hn::Mul(det_J, hn::Mul(s.deviation_u, s.deviation_v)), shape.stretch);
    V det_Sigma = mul_add(det_JV, det_JV, hn::Mul(h2_, hn::Add(hn::Add(xx, yy), h2_)));
    const V half = hn::Set(d, 0.5F);
    if (view_.circular) {
      // The larger eigenvalue.
      const V mean = hn::Mul(half, hn::Add(Sigma_xx, Sigma_yy));
      const V difference = hn::Mul(half, hn::Sub(Sigma_xx, Sigma_yy));
      Sigma_xx =
          hn::Add(mean, hn::Sqrt(mul_add(difference, difference, hn::Mul(Sigma_xy, Sigma_xy))));
      Sigma_yy = Sigma_xx;
      Sigma_xy = hn::Zero(d);
      det_Sigma = hn::Mul(Sigma_xx, Sigma_xx);
    }
    const V inv_yy = hn::Div(hn::Set(d, 1.0F), Sigma_yy);
    const V inv_det = hn::Div(hn::Set(d, 1.0F), det_Sigma);
    out.m = hn::Mul(Sigma_xy, inv_yy);
    out.k = hn::Mul(half, hn::Mul(Sigma_yy, inv_det));
    out.q = hn::Mul(half, inv_yy);
    out.amplitude =
        hn::Mul(hn::Mul(hn::Mul(hn::LoadU(d, in_.area + i), hn::Set(d, kInvTwoPi)), det_J),
                hn::Mul(hn::Sqrt(inv_det), shape.share));
    out.half_x = hn::Sqrt(hn::Mul(two_c_, Sigma_xx));
    out.half_y = hn::Sqrt(hn::Mul(two_c_, Sigma_yy));
    out.size2 = hn::Mul(two_c_, hn::Add(xx, yy));
    return out;
  }

  /// See depth_plane(). normal . p = n_ray * p.z.
  HWY_INLINE DepthPlanes depth_planes(const Discs& s, const Vec3V& n, V n_ray, V distance) const {
    const D d;
    const V one = hn::Set(d, 1.0F);
    const V inv_focal_x = hn::Set(d, 1.0F / view_.focal_x);
    const V inv_focal_y = hn::Set(d, 1.0F / view_.focal_y);
    const V n_p = kPerspective ? hn::Mul(n_ray, s.p.z) : n.z;
    const V least = hn::Mul(hn::Set(d, kLeastGradientCosine), distance);
    const V inv_np = hn::Div(one, hn::CopySign(hn::Max(hn::Abs(n_p), least), n_p));
    // Footprint of the combined kernel on the tangent plane: disc and pixel filter, the latter
    // divided by the cosine.
    const V inv_cosine = hn::Mul(hn::Abs(inv_np), distance);
    // Standard deviation of the pixel filter at distance 1.
    const V pixel = hn::Mul(hn::Sqrt(h2_), hn::Max(inv_focal_x, inv_focal_y));
    const V pixel_at = kPerspective ? hn::Mul(pixel, s.p.z) : pixel;
    const auto reach_at = [&](V inverse) HWY_ATTR {
      const V on_plane = hn::Mul(pixel_at, inverse);
      return hn::Sqrt(
          hn::Mul(two_c_, mul_add(s.deviation, s.deviation, hn::Mul(on_plane, on_plane))));
    };
    V reach = reach_at(inv_cosine);
    DepthPlanes out;
    // As far as the surface is even a plane is where its surfels are, at any angle.
    out.epsilon_share = hn::Mul(inv_cosine, mul_add(hn::Set(d, 0.5F * in_.uneven.bend), reach,
                                                    hn::Div(hn::Set(d, in_.uneven.rough), reach)));
    const M bounded = hn::And(hn::Gt(inv_cosine, hn::Set(d, 1 / kLeastCosine)),
                              hn::Not(hn::Lt(out.epsilon_share, hn::Set(d, kEven))));
    if (HWY_UNLIKELY(!hn::AllFalse(d, bounded))) {
      reach = hn::IfThenElse(bounded, reach_at(hn::Set(d, 1 / kLeastCosine)), reach);
    }
    out.epsilon_share = hn::Mul(out.epsilon_share, hn::Set(d, epsilon_growth_));
    // Beyond the horizon the plane is behind the eye.
    if constexpr (kPerspective) reach = hn::Min(reach, hn::Mul(hn::Set(d, 0.5F), s.p.z));
    out.depth = kPerspective ? s.inv_z : hn::Neg(s.p.z);
    out.depth_dx = hn::Mul(hn::Mul(n.x, inv_np), inv_focal_x);
    out.depth_dy = hn::Mul(hn::Mul(n.y, inv_np), inv_focal_y);
    out.depth_range = hn::Mul(reach, hn::Mul(s.inv_z, s.inv_z));  // dz / z^2, of d = 1 / z
    out.front = hn::Lt(n_p, hn::Zero(d));
    out.grazing = hn::Gt(inv_cosine, hn::Set(d, 1 / kGrazing));
    return out;
  }

  /// \param before, after  How far kernels reach on both sides of their centres.
  HWY_INLINE Pixels pixels(V center, V before, V after, float clip0, float clip1) const {
    const D d;
    const V offset = hn::Set(d, clip0 + 0.5F);
    const V first = hn::Ceil(hn::Sub(hn::Sub(center, hn::Add(before, margin_)), offset));
    const V last = hn::Floor(hn::Sub(hn::Add(center, hn::Add(after, margin_)), offset));
    return {first, hn::Max(first, hn::Zero(d)), hn::Min(last, hn::Set(d, clip1 - clip0 - 1))};
  }

  /// Tells apart the surfels whose kernel is affine, exact, or neither as the disc is not in front
  /// of the near plane. Where the disc reaches through the near plane, the affine approximation (4)
  /// has no meaning. Comparisons are false for NaN.
  HWY_INLINE Classes classify(const Discs& s, const Vec3V& n, V size2) const {
    const D d;
    const V near = hn::Set(d, view_.near);
    const V tolerance = hn::Set(d, view_.tolerance);
    Classes out;
    out.exact = hn::FirstN(d, 0);
    out.visible = hn::Not(out.exact);
    // Most discs are so small that the angle to the line of sight need not be known.
    const V least_z = hn::Sub(s.p.z, s.radius);
    M small = hn::Gt(least_z, near);
    if constexpr (kPerspective) {
      const V most_error = hn::Mul(tolerance, least_z);
      small = hn::And(small, hn::Le(hn::Mul(size2, hn::Mul(s.radius, s.radius)),
                                    hn::Mul(most_error, most_error)));
    }
    if (!(view_.tolerance < 0) && hn::AllTrue(d, small)) return out;
    const V sine = hn::Sqrt(hn::Max(hn::Zero(d), neg_mul_add(n.z, n.z, hn::Set(d, 1.0F))));
    const V depth_extent = hn::Mul(s.radius, sine);
    out.visible = hn::Gt(hn::Sub(s.p.z, depth_extent), near);
    // A point of the disc that is nearer than the centre by the share e of its depth is projected
    // 1 / (1 - e) times as far from the centre as (4) says: off by e / (1 - e) of that.
    if (kPerspective && view_.tolerance < std::numeric_limits<float>::infinity()) {
      const V error_z = hn::Mul(hn::Sqrt(size2), depth_extent);
      const M affine =
          hn::And(out.visible, hn::Le(error_z, hn::Mul(tolerance, hn::Sub(s.p.z, depth_extent))));
      out.exact = hn::AndNot(affine, hn::Gt(hn::Add(s.p.z, depth_extent), near));
      out.visible = affine;
    }
    if (!hn::AllFalse(d, out.exact)) {
      // A disc that is far enough from the eye's plane lies within its bounding sphere.
      const M bounded = hn::Gt(least_z, hn::Mul(hn::Set(d, kLeastDistance), s.radius));
      const auto reach = [&](V slope, V focal) HWY_ATTR {
        return mul_add(hn::Mul(focal, hn::Sqrt(mul_add(slope, slope, hn::Set(d, 1.0F)))),
                       hn::Div(s.radius, least_z), filter_reach_);
      };
      const M unseen = outside(s, reach(s.slope_x, focal_x_), reach(s.slope_y, focal_y_));
      out.exact = hn::AndNot(hn::And(bounded, unseen), out.exact);
    }
    return out;
  }

  /// Leaves the surfels of which something may be drawn in the rectangle; `left` exist.
  HWY_INLINE Classes seen(Classes classes, const Projected& s, int left) const {
    const D d;
    const M in_rectangle =
        hn::And(hn::Le(s.columns.first, s.columns.last), hn::Le(s.rows.first, s.rows.last));
    classes.visible = hn::And(classes.visible, in_rectangle);
    classes.visible =
        hn::And(classes.visible, hn::Gt(s.kernels.amplitude, hn::Set(d, kLeastAmplitude)));
    M drawn = hn::RebindMask(d, hn::Lt(hn::Iota(Ints(), 0), hn::Set(Ints(), left)));
    if (view_.cull_back) drawn = hn::And(drawn, s.planes.front);
    return {hn::And(classes.visible, drawn), hn::And(classes.exact, drawn)};
  }

  const SplatView& view_;
  const SurfelColumns& in_;
  HalfPlaneCuts<kPerspective> cuts_;
  V focal_x_, focal_y_, h2_, two_c_;
  V margin_;
  float epsilon_growth_;  ///< Of RenderOptions::epsilon_share(): its footprints end at beta = 1.
  V filter_reach_;        ///< Radius of the pixel filter, and the margin, pixels.
};

struct SetUpCall {
  const SplatView& view;
  const SurfelColumns& in;
  int count;
  const SurfelColumns* next;
  Splat* splats;
  SplatClip* clips;
  SetUpSplats& out;

  template <bool kPerspective, bool kAnisotropic>
  void run() const {
    if (in.clip[0].x || in.clip[1].x) {
      SplatSetup<kPerspective, kAnisotropic, true>(view, in).run(count, next, splats, clips, out);
    } else {
      SplatSetup<kPerspective, kAnisotropic, false>(view, in).run(count, next, splats, clips, out);
    }
  }
};

}  // namespace

void set_up_splats_simd(const SplatView& view, const SurfelColumns& in, int count,
                        const SurfelColumns* next, Splat* splats, SplatClip* clips,
                        SetUpSplats& out) {
  const SetUpCall call{view, in, count, next, splats, clips, out};
  const bool anisotropic = in.tangent_x != nullptr;
  if (view.orthographic) {
    anisotropic ? call.run<false, true>() : call.run<false, false>();
  } else {
    anisotropic ? call.run<true, true>() : call.run<true, false>();
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {

HWY_EXPORT(set_up_splats_simd);

void set_up_splats(const SplatView& view, const SurfelColumns& surfels, int count,
                   const SurfelColumns* next, Splat* splats, SplatClip* clips, SetUpSplats& out) {
  HWY_DYNAMIC_DISPATCH(set_up_splats_simd)(view, surfels, count, next, splats, clips, out);
}

}  // namespace surfel
#endif
