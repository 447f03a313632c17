// Splats that half-planes cut; clip_kernel.h holds the equations in plain double. Included once for
// each target, see Highway's documentation.

#if defined(SURFEL_RENDER_HALF_PLANE_CUTS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SURFEL_RENDER_HALF_PLANE_CUTS_INL_H_
#undef SURFEL_RENDER_HALF_PLANE_CUTS_INL_H_
#else
#define SURFEL_RENDER_HALF_PLANE_CUTS_INL_H_
#endif

#include <hwy/highway.h>
#include <surfel/base/fused-inl.h>
#include <surfel/base/normal_cdf-inl.h>
#include <surfel/base/power-inl.h>
#include <surfel/base/vec3-inl.h>
#include <surfel/render/projected_splats-inl.h>
#include <surfel/render/splat_setup.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {

/// Where Phi is above kLeastClipShare, and what it leaves to 1 is: 1 - Phi(3.0903) is that share.
inline constexpr float kSeenClip = 3.1F;
inline constexpr float kInvRootTwoPi = 0.39894228040143268F;  ///< 1 / sqrt(2 pi).

/// Cuts the surfels of a cluster by their half-planes, a vector at a time.
template <bool kPerspective>
class HalfPlaneCuts {
 public:
  explicit HalfPlaneCuts(const SplatView& view)
      : view_(view),
        focal_x_(hn::Set(D(), view.focal_x)),
        focal_y_(hn::Set(D(), view.focal_y)),
        h2_(hn::Set(D(), view.lowpass2)),
        two_c_(hn::Set(D(), 2.0F * view.cutoff)) {}

  HWY_INLINE HalfPlanes half_planes(const HalfPlaneColumns& columns, int i,
                                    const Projected& s) const {
    const D d;
    HalfPlanes out;
    out.exists = hn::FirstN(d, 0);
    if (!columns.x) return out;
    const Vec3V world{hn::LoadU(d, columns.x + i), hn::LoadU(d, columns.y + i),
                      hn::LoadU(d, columns.z + i)};
    out.exists = hn::Gt(dot(world, world), hn::Zero(d));
    if (hn::AllFalse(d, out.exists)) return out;
    out.direction = rotate(view_.rotation, world);
    out.distance = hn::LoadU(d, columns.distance + i);
    out.w_u = hn::Mul(dot(out.direction, s.axes.tangent), s.discs.deviation_u);
    out.w_v = hn::Mul(dot(out.direction, s.axes.bitangent), s.discs.deviation_v);
    return out;
  }

  /// Takes for cut Gaussians that are smaller than the pixel filter, of which little but volume,
  /// mean and variance is seen, whole Gaussians that have these. Their half-planes are dropped.
  HWY_INLINE CutGaussians cut_filtered(HalfPlanes (&lines)[2], const Projected& s,
                                       Shape& shape) const {
    const D d;
    // Seen from the front, so that both sides of a body's silhouette are treated alike.
    const V size = hn::Mul(hn::Mul(hn::Max(focal_x_, focal_y_), s.discs.inv_z), s.discs.deviation);
    const M filtered = hn::Lt(hn::Mul(size, size), h2_);
    const CutGaussians cut = cut_gaussians(lines, filtered);
    for (HalfPlanes& line : lines) line.exists = hn::AndNot(filtered, line.exists);
    if (hn::AllFalse(d, cut.made)) return cut;
    const auto& [t, b, tx, ty, bx, by] = s.axes;
    const auto take = [&](V& of_whole, V of_cut)
                          HWY_ATTR { of_whole = hn::IfThenElse(cut.made, of_cut, of_whole); };
    take(shape.axes.tx, mul_add(cut.l_uu, tx, hn::Mul(cut.l_uv, bx)));
    take(shape.axes.ty, mul_add(cut.l_uu, ty, hn::Mul(cut.l_uv, by)));
    take(shape.axes.bx, hn::Mul(cut.l_vv, bx));
    take(shape.axes.by, hn::Mul(cut.l_vv, by));
    take(shape.share, cut.share);
    take(shape.stretch, hn::Mul(cut.l_uu, cut.l_vv));
    return cut;
  }

  /// The half-planes of a vector of surfels, see clip_kernel.h: clip_share(), joint_share() and
  /// outward_on_screen().
  HWY_INLINE Cuts cuts(const Vec3V& n, const HalfPlanes (&planes)[2], const Projected& s) const {
    const D d;
    const V zero = hn::Zero(d);
    const V none = hn::Set(d, kNoClip);
    Cuts out;  // Without `clipped` nothing else is read.
    out.clipped = out.gone = hn::FirstN(d, 0);
    if (hn::AllFalse(d, hn::Or(planes[0].exists, planes[1].exists))) return out;
    Line lines[2] = {line(planes[0], n, s), line(planes[1], n, s)};
    const auto& [t, b, tx, ty, bx, by] = s.axes;
    const V size2 = hn::Add(mul_add(tx, tx, hn::Mul(ty, ty)), mul_add(bx, bx, hn::Mul(by, by)));
    // As SeenPlace has it, so that shares are finite without a filter, too.
    const V h2 = hn::Max(h2_, hn::Mul(hn::Set(d, 1e-8F), size2));
    // tx by - ty bx, which would cancel at grazing angles.
    const V det_A = hn::Mul(hn::Mul(hn::Mul(focal_x_, focal_y_), s.kernels.n_ray),
                            hn::Mul(hn::Mul(s.discs.inv_z, s.discs.deviation_u),
                                    hn::Mul(s.discs.inv_z, s.discs.deviation_v)));
    const V inv_det =
        hn::Div(hn::Set(d, 1.0F), mul_add(det_A, det_A, hn::Mul(h2, hn::Add(size2, h2))));
    const auto covariance = [&](const Line& v, const Line& w) HWY_ATTR {
      const V inner = mul_add(v.w_u, w.w_u, hn::Mul(v.w_v, w.w_v));
      const V across = mul_add(v.across_x, w.across_x, hn::Mul(v.across_y, w.across_y));
      return hn::Mul(hn::Mul(h2, inv_det), mul_add(h2, inner, across));
    };
    const V one = hn::Set(d, 1.0F);
    out.beyond = out.left = out.right = out.up = out.down = one;
    for (int j = 0; j < 2; ++j) {
      Line& l = lines[j];
      if (hn::AllFalse(d, l.exists)) continue;
      const V variance = covariance(l, l);
      l.inv_s = hn::Div(hn::Set(d, 1.0F), hn::Sqrt(variance));
      const V z = hn::Mul(l.distance, l.inv_s);
      const V scale = hn::Neg(hn::Mul(inv_det, l.inv_s));
      const V ax = mul_add(tx, l.w_u, hn::Mul(bx, l.w_v));
      const V ay = mul_add(ty, l.w_u, hn::Mul(by, l.w_v));
      out.line[j][0] = z;
      out.line[j][1] = hn::Mul(scale, mul_add(h2, ax, hn::Mul(det_A, l.across_y)));
      out.line[j][2] = hn::Mul(scale, mul_sub(h2, ay, hn::Mul(det_A, l.across_x)));
      const V all = mul_add(l.w_u, l.w_u, hn::Mul(l.w_v, l.w_v));
      // Where the kernel is seen z goes up and down by no more than this.
      V reach;
      if (view_.circular) {
        reach =
            hn::Mul(s.kernels.half_x, hn::Sqrt(mul_add(out.line[j][1], out.line[j][1],
                                                       hn::Mul(out.line[j][2], out.line[j][2]))));
      } else {
        reach = hn::Mul(l.inv_s, hn::Sqrt(hn::Mul(two_c_, hn::Max(zero, hn::Sub(all, variance)))));
      }
      const V seen = hn::Set(d, kSeenClip);
      const M cuts = hn::And(l.exists, hn::Lt(hn::Sub(z, reach), seen));
      out.gone = hn::Or(out.gone, hn::And(cuts, hn::Lt(hn::Add(z, reach), hn::Neg(seen))));
      l.exists = cuts;
      const M shorter = hn::And(cuts, hn::Lt(hn::Sub(z, reach), hn::Neg(seen)));
      if (!hn::AllFalse(d, shorter)) {
        // In units of the ellipse beta < c, which is the unit circle then, z is at least -kSeenClip
        // beyond the chord u . e = chord, and along a direction a with a . e = cosine that part of
        // the circle reaches as far as the circle itself, or as far as an end of the chord.
        const V inv_reach = hn::Div(one, reach);
        const V chord = hn::Neg(hn::Mul(hn::Add(seen, z), inv_reach));
        const V half_chord = hn::Sqrt(hn::Max(zero, neg_mul_add(chord, chord, one)));
        const auto bound = [&](V& after, V& before, V a, V half) HWY_ATTR {
          const V c = hn::Div(hn::Mul(hn::Mul(two_c_, l.inv_s), hn::Mul(a, inv_reach)), half);
          const V across = hn::Mul(half_chord, hn::Sqrt(hn::Max(zero, neg_mul_add(c, c, one))));
          const auto take = [&](V& extent, V cosine) HWY_ATTR {
            const V end = mul_add(chord, cosine, across);
            const M ends = hn::And(shorter, hn::Lt(cosine, chord));
            extent = hn::IfThenElse(ends, hn::Min(extent, end), extent);
          };
          take(after, hn::Neg(c));
          take(before, c);
        };
        bound(out.right, out.left, ax, s.kernels.half_x);
        bound(out.down, out.up, ay, s.kernels.half_y);
      }
      const V q = hn::Div(variance, all);
      const V q2 = hn::Mul(q, q);
      const V growth = mul_add(hn::Set(d, kBeyondSmall), hn::Mul(hn::Mul(q2, q2), q2),
                               hn::Set(d, view_.beyond_growth));
      out.beyond = hn::IfThenElse(cuts, hn::Max(out.beyond, mul_add(q2, growth, one)), out.beyond);
    }
    out.clipped = hn::Or(lines[0].exists, lines[1].exists);
    if (hn::AllFalse(d, out.clipped)) return out;
    const M both = hn::And(lines[0].exists, lines[1].exists);
    out.joint = zero;
    if (!hn::AllFalse(d, both)) {
      const V r = hn::Mul(covariance(lines[0], lines[1]), hn::Mul(lines[0].inv_s, lines[1].inv_s));
      out.joint = hn::IfThenElseZero(both, weight_of_correlation(r));
    }
    // The only line is the first one.
    const M second = hn::AndNot(lines[0].exists, lines[1].exists);
    for (int k = 0; k < 3; ++k) {
      out.line[0][k] = hn::IfThenElse(second, out.line[1][k], out.line[0][k]);
      out.line[1][k] = hn::IfThenElse(both, out.line[1][k], k == 0 ? none : zero);
    }
    for (int k = 0; k < 2; ++k) {
      const V of_second = k == 0 ? lines[1].out_x : lines[1].out_y;
      out.outward[0][k] =
          hn::IfThenElse(second, of_second, k == 0 ? lines[0].out_x : lines[0].out_y);
      out.outward[1][k] = hn::IfThenElseZero(both, of_second);
    }
    return out;
  }

 private:
  /// Cuts Gaussians by their half-planes one after the other. One that is cut at alpha deviations
  /// keeps the volume Phi(alpha), and with lambda = phi(alpha) / Phi(alpha) its mean moves by
  /// -lambda deviations along the half-plane's direction, along which lambda (lambda + alpha) of
  /// the variance is lost. That is exact for one half-plane; what it leaves is no Gaussian for the
  /// second one to cut, but taken to be one.
  HWY_INLINE CutGaussians cut_gaussians(const HalfPlanes (&lines)[2], M which) const {
    const D d;
    const V zero = hn::Zero(d);
    const V one = hn::Set(d, 1.0F);
    const V seen = hn::Set(d, kSeenClip);
    CutGaussians out;
    out.made = out.gone = hn::FirstN(d, 0);
    out.share = one;
    out.mean_u = out.mean_v = zero;
    V uu = one;
    V uv = zero;
    V vv = one;
    V det = one;
    for (const HalfPlanes& line : lines) {
      if (hn::AllFalse(d, hn::And(line.exists, which))) continue;
      const V c_u = mul_add(uu, line.w_u, hn::Mul(uv, line.w_v));
      const V c_v = mul_add(uv, line.w_u, hn::Mul(vv, line.w_v));
      const V inv_s = hn::Div(one, hn::Sqrt(mul_add(line.w_u, c_u, hn::Mul(line.w_v, c_v))));
      const V to_mean = mul_add(line.w_u, out.mean_u, hn::Mul(line.w_v, out.mean_v));
      const V alpha = hn::Mul(hn::Sub(line.distance, to_mean), inv_s);
      const M cuts = hn::And(hn::And(line.exists, which), hn::Lt(alpha, seen));
      out.made = hn::Or(out.made, cuts);
      out.gone = hn::Or(out.gone, hn::And(cuts, hn::Lt(alpha, hn::Neg(seen))));
      const V left = hn::Max(normal_cdf(alpha), hn::Set(d, kLeastClipShare));
      const V phi = hn::Mul(hn::Set(d, kInvRootTwoPi),
                            exp_of_floats(d, hn::Mul(hn::Set(d, -0.5F), hn::Mul(alpha, alpha))));
      const V lambda = hn::Div(phi, left);
      // Of the variance something is left, however it is rounded.
      const V lost = hn::Min(hn::Mul(lambda, hn::Add(lambda, alpha)), hn::Set(d, 0.99F));
      const V e_u = hn::Mul(c_u, inv_s);
      const V e_v = hn::Mul(c_v, inv_s);
      const auto take = [&](V& before, V after)
                            HWY_ATTR { before = hn::IfThenElse(cuts, after, before); };
      take(out.share, hn::Mul(out.share, left));
      take(out.mean_u, neg_mul_add(lambda, e_u, out.mean_u));
      take(out.mean_v, neg_mul_add(lambda, e_v, out.mean_v));
      take(uu, neg_mul_add(lost, hn::Mul(e_u, e_u), uu));
      take(uv, neg_mul_add(lost, hn::Mul(e_u, e_v), uv));
      take(vv, neg_mul_add(lost, hn::Mul(e_v, e_v), vv));
      take(det, neg_mul_add(lost, det, det));
    }
    out.gone = hn::Or(out.gone, hn::And(out.made, hn::Lt(out.share, hn::Set(d, kLeastClipShare))));
    out.l_uu = hn::Sqrt(uu);
    const V inv_l = hn::Div(one, out.l_uu);
    out.l_uv = hn::Mul(uv, inv_l);
    out.l_vv = hn::Mul(hn::Sqrt(det), inv_l);
    return out;
  }

  /// A half-plane of a vector of surfels, and what cuts() needs of it.
  struct Line : HalfPlanes {
    V across_x, across_y;  ///< w_u b - w_v t, with the columns of J V^(1/2).
    V out_x, out_y;        ///< SplatClip::outward.
    V inv_s;
  };

  HWY_INLINE Line line(const HalfPlanes& of, const Vec3V& n, const Projected& s) const {
    const D d;
    const V zero = hn::Zero(d);
    Line out;
    static_cast<HalfPlanes&>(out) = of;
    if (hn::AllFalse(d, out.exists)) return out;
    const Vec3V& direction = of.direction;
    const auto& [t, b, tx, ty, bx, by] = s.axes;
    out.across_x = mul_sub(out.w_u, bx, hn::Mul(out.w_v, tx));
    out.across_y = mul_sub(out.w_u, by, hn::Mul(out.w_v, ty));
    const Vec3V along = cross(n, direction);
    Vec3V plane{along.y, hn::Neg(along.x), zero};
    if constexpr (kPerspective) {
      plane = cross(along, {mul_add(out.distance, direction.x, s.discs.p.x),
                            mul_add(out.distance, direction.y, s.discs.p.y),
                            mul_add(out.distance, direction.z, s.discs.p.z)});
    }
    const V x = hn::Mul(plane.x, hn::Set(d, 1.0F / view_.focal_x));
    const V y = hn::Mul(plane.y, hn::Set(d, 1.0F / view_.focal_y));
    const V length = hn::Sqrt(mul_add(x, x, hn::Mul(y, y)));
    const V scale = hn::Div(hn::CopySign(hn::Set(d, 1.0F), dot(plane, direction)), length);
    const M seen = hn::Gt(length, zero);
    out.out_x = hn::IfThenElseZero(seen, hn::Mul(x, scale));
    out.out_y = hn::IfThenElseZero(seen, hn::Mul(y, scale));
    return out;
  }

  /// 2 / pi asin(r): Abramowitz, Stegun, 4.4.45, within 5e-5.
  static HWY_INLINE V weight_of_correlation(V r) {
    const D d;
    constexpr float kPolynomial[] = {1.5707288F, -0.2121144F, 0.0742610F, -0.0187293F};
    constexpr float kTwoByPi = 0.63661977236758134F;
    const V one = hn::Set(d, 1.0F);
    const V x = hn::Min(one, hn::Abs(r));
    V p = hn::Set(d, kPolynomial[3]);
    for (int i = 2; i >= 0; --i) p = mul_add(p, x, hn::Set(d, kPolynomial[i]));
    const V acos = hn::Mul(hn::Sqrt(hn::Sub(one, x)), p);
    return hn::CopySign(neg_mul_add(hn::Set(d, kTwoByPi), acos, one), r);
  }

  const SplatView& view_;
  V focal_x_, focal_y_, h2_, two_c_;
};

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#endif
