// Zwicker, Pfister, van Baar, Gross, "EWA Volume Splatting", IEEE Visualization 2001: the affine
// projection. Kerbl et al., "3D Gaussian Splatting", SIGGRAPH 2023. Yu et al., "Mip-Splatting",
// CVPR 2024. Huang et al., "2D Gaussian Splatting", SIGGRAPH 2024.
//
// A Gaussian with the axes A = W R diag(s) in camera space and its mean at m = z (w_x, w_y, 1) is
// looked at in coordinates in which the mean is (0, 0, 1) and the ray of a pixel (dx, dy) away is
// (dx, dy, 1):
//     T_x = f_x / z (A_x - w_x A_z),   T_y = f_y / z (A_y - w_y A_z),   Z = A_z / z,
// where A_x is the first row of A. The rows T_x and T_y are J A, the affine projection. The pixel
// filter adds h^2 to the variances of x and y alone, so that the variance is
//     S = (T_x, T_y, Z)(T_x, T_y, Z)' + diag(h^2, h^2, 0).
// The squared Mahalanobis distance of the ray w and the mean m is, for any S of rank 2 or 3,
//     D^2 = (w x m)' S (w x m) / (w' adj(S) w),
// whose numerator is a quadratic form of (dx, dy), and whose denominator is |J A A' J' + h^2 I| at
// the centre: without its other terms D^2 is the affine kernel's. The largest contribution along
// the ray lies at w' adj(S) m / (w' adj(S) w). adj(S) is made of products of rows, which do not
// cancel where a Gaussian is flat or thin. With parallel rays, T_x = f_x A_x, T_y = f_y A_y and
// Z = A_z; D^2 is the affine kernel's, and the largest contribution is the conditional mean of the
// depth, z + (T_x . Z, T_y . Z) (J A A' J' + h^2 I)^-1 (dx, dy).

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>

#include <surfel/gaussian/gaussian_projection.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/gaussian/gaussian_projection.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <surfel/base/float_lanes-inl.h>
#include <surfel/base/fused-inl.h>
#include <surfel/base/power-inl.h>
#include <surfel/base/vec3-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

namespace {

using Indices = hn::Vec<Ints>;
using Vec3 = HWY_NAMESPACE::Vec3<V>;

constexpr std::size_t kMostLanes = 16;
constexpr float kLog2e = 1.44269504088896F;
constexpr float kLn2 = 0.693147180559945F;
constexpr float kRootTwoPi = 2.50662827463100F;
/// Bounds are widened by so many pixels and by this share, against rounding.
constexpr float kMargin = 0.01F;
constexpr float kWiden = 1.0001F;
/// kExact: a Gaussian that reaches so far towards the eye's plane, as a share of its depth squared,
/// may be seen anywhere.
constexpr float kLeastRoom = 1e-3F;
/// kExact: peaks below this binary logarithm of alpha are nothing.
constexpr float kLeastLogPeak = -30;
/// Beyond such a number of pixels nothing is told apart.
constexpr float kFar = 1e6F;

HWY_INLINE V set(float value) { return hn::Set(D(), value); }
HWY_INLINE V clamp(V value, float least, float most) {
  return hn::Min(hn::Max(value, set(least)), set(most));
}
HWY_INLINE V square(V value) { return hn::Mul(value, value); }
HWY_INLINE Vec3 scaled(const Vec3& v, V by) {
  return {hn::Mul(v.x, by), hn::Mul(v.y, by), hn::Mul(v.z, by)};
}
/// a - b c.
HWY_INLINE Vec3 minus(const Vec3& a, V b, const Vec3& c) {
  return {neg_mul_add(b, c.x, a.x), neg_mul_add(b, c.y, a.y), neg_mul_add(b, c.z, a.z)};
}

/// Numbers of a vector of Gaussians, `stride` apart in memory.
class Column {
 public:
  /// \param left  Gaussians from `first` on, > 0: lanes beyond read the last of them.
  Column(const float* first, std::size_t stride, std::size_t left) : first_(first) {
    const Ints d;
    const auto last = static_cast<std::int32_t>(std::min(left, kMostLanes) - 1);
    at_ = hn::Mul(hn::Min(hn::Iota(d, 0), hn::Set(d, last)),
                  hn::Set(d, static_cast<std::int32_t>(stride)));
  }
  HWY_INLINE V operator[](std::size_t i) const { return hn::GatherIndex(D(), first_ + i, at_); }

 private:
  const float* first_;
  Indices at_;
};

/// Spherical harmonics up to degree 4, as 3D Gaussian splatting has them; every one is handed to
/// add(number, value).
template <class Add>
HWY_INLINE void for_each_harmonic(int degree, const Vec3& direction, const Add& add) {
  const V x = direction.x;
  const V y = direction.y;
  const V z = direction.z;
  const auto times = [](float c, V v) HWY_ATTR { return hn::Mul(set(c), v); };
  add(0, set(0.282094791773878F));
  if (degree < 1) return;
  add(1, times(-0.488602511902920F, y));
  add(2, times(0.488602511902920F, z));
  add(3, times(-0.488602511902920F, x));
  if (degree < 2) return;
  const V xx = square(x);
  const V yy = square(y);
  const V zz = square(z);
  const V xy = hn::Mul(x, y);
  const V yz = hn::Mul(y, z);
  const V xz = hn::Mul(x, z);
  const V xx_yy = hn::Sub(xx, yy);
  add(4, times(1.09254843059208F, xy));
  add(5, times(-1.09254843059208F, yz));
  add(6, times(0.315391565252520F, hn::Sub(hn::Add(zz, zz), hn::Add(xx, yy))));
  add(7, times(-1.09254843059208F, xz));
  add(8, times(0.546274215296040F, xx_yy));
  if (degree < 3) return;
  const auto mixed = [](float a, V u, float b, V v)
                         HWY_ATTR { return mul_add(set(a), u, hn::Mul(set(b), v)); };
  const V four = hn::Sub(times(4, zz), hn::Add(xx, yy));
  add(9, times(-0.590043589926644F, hn::Mul(y, mixed(3, xx, -1, yy))));
  add(10, times(2.89061144264055F, hn::Mul(xy, z)));
  add(11, times(-0.457045799464466F, hn::Mul(y, four)));
  add(12, times(0.373176332590115F, hn::Mul(z, mixed(2, zz, -3, hn::Add(xx, yy)))));
  add(13, times(-0.457045799464466F, hn::Mul(x, four)));
  add(14, times(1.44530572132028F, hn::Mul(z, xx_yy)));
  add(15, times(-0.590043589926644F, hn::Mul(x, mixed(1, xx, -3, yy))));
  if (degree < 4) return;
  const V seven1 = mul_add(set(7), zz, set(-1));
  const V seven3 = mul_add(set(7), zz, set(-3));
  const V x_part = mixed(3, xx, -1, yy);
  const V y_part = mixed(1, xx, -3, yy);
  add(16, times(2.50334294179670F, hn::Mul(xy, xx_yy)));
  add(17, times(-1.77013076977993F, hn::Mul(yz, x_part)));
  add(18, times(0.946174695757560F, hn::Mul(xy, seven1)));
  add(19, times(-0.669046543557289F, hn::Mul(yz, seven3)));
  add(20, times(0.105785546915204F, mul_add(zz, mul_add(set(35), zz, set(-30)), set(3))));
  add(21, times(-0.669046543557289F, hn::Mul(xz, seven3)));
  add(22, times(0.473087347878780F, hn::Mul(xx_yy, seven1)));
  add(23, times(-1.77013076977993F, hn::Mul(xz, y_part)));
  add(24, times(0.625835735449176F, mul_sub(xx, y_part, hn::Mul(yy, x_part))));
}

/// Half-open ranges of tiles, as numbers of tiles; not yet within the picture.
struct TileRange {
  V first, end;
};

/// Everything about a vector of Gaussians that is kept.
struct Projected {
  V x, y, z;
  V xx, xy, yy, log_opacity, cut;
  V red, green, blue;
  V x0, y0, x1, y1;
  V low_x, low_y, nearest, epsilon;
  V deviation_z;  ///< Of depths.
  V d, dx, dy, dxx, dxy, dyy, tx, ty;
  M visible;
};

/// Projects the Gaussians of a range, a vector at a time.
template <GaussianProfile kProfile>
class Projection {
 public:
  static constexpr bool kDiscs = kProfile == GaussianProfile::k2dgs;
  static constexpr bool kExact = kProfile == GaussianProfile::kExact;
  static constexpr bool kPerspective = kDiscs || kExact;

  Projection(const GaussianView& view, const GaussianCloud& cloud) : view_(view), cloud_(cloud) {}

  std::size_t run(std::size_t begin, std::size_t end, GaussianSplat* splats,
                  GaussianPerspective* perspective, std::uint32_t* keys) const {
    const D d;
    std::size_t count = 0;
    for (std::size_t i = begin; i < end; i += hn::Lanes(d)) {
      const Projected p = project(i, end - i);
      if (hn::AllFalse(d, p.visible)) continue;
      count += write(p, splats + count, kPerspective ? perspective + count : nullptr, keys + count);
    }
    return count;
  }

 private:
  static HWY_INLINE const float* floats(const void* p) { return static_cast<const float*>(p); }

  HWY_INLINE Vec3 rotated(const Vec3& v) const {
    const auto row = [&](int i) HWY_ATTR {
      const float* r = view_.rotation + i;
      return mul_add(set(r[0]), v.x, mul_add(set(r[1]), v.y, hn::Mul(set(r[2]), v.z)));
    };
    return {row(0), row(3), row(6)};
  }

  /// The rows of A = W R diag(s).
  struct Axes {
    Vec3 x, y, z;
  };
  HWY_INLINE Axes axes(std::size_t i, std::size_t left) const {
    const Column q(cloud_.rotation[i].data(), 4, left);
    const Column s(floats(&cloud_.scale[i]), 3, left);
    const V w = q[0];
    const V x = q[1];
    const V y = q[2];
    const V z = q[3];
    const V two = set(2);
    const V one = set(1);
    const auto twice = [&](V a, V b, V c, V e) HWY_ATTR {  // 2 (a b + c e)
      return hn::Mul(two, mul_add(a, b, hn::Mul(c, e)));
    };
    const auto less = [&](V a, V b, V c, V e) HWY_ATTR {  // 2 (a b - c e)
      return hn::Mul(two, mul_sub(a, b, hn::Mul(c, e)));
    };
    const Vec3 first =
        rotated({hn::Sub(one, twice(y, y, z, z)), twice(x, y, w, z), less(x, z, w, y)});
    const Vec3 second =
        rotated({less(x, y, w, z), hn::Sub(one, twice(x, x, z, z)), twice(y, z, w, x)});
    const Vec3 third =
        rotated({twice(x, z, w, y), less(y, z, w, x), hn::Sub(one, twice(x, x, y, y))});
    const V s0 = s[0];
    const V s1 = s[1];
    const V s2 = kDiscs ? hn::Zero(D()) : s[2];
    return {{hn::Mul(first.x, s0), hn::Mul(second.x, s1), hn::Mul(third.x, s2)},
            {hn::Mul(first.y, s0), hn::Mul(second.y, s1), hn::Mul(third.y, s2)},
            {hn::Mul(first.z, s0), hn::Mul(second.z, s1), hn::Mul(third.z, s2)}};
  }

  HWY_INLINE Projected project(std::size_t i, std::size_t left) const {
    const D d;
    Projected out;
    const Column position(floats(&cloud_.position[i]), 3, left);
    const Vec3 at{position[0], position[1], position[2]};
    Vec3 p = rotated(at);
    p.x = hn::Add(p.x, set(view_.translation[0]));
    p.y = hn::Add(p.y, set(view_.translation[1]));
    p.z = hn::Add(p.z, set(view_.translation[2]));
    out.z = p.z;
    out.visible = hn::And(hn::FirstN(d, left), hn::Gt(p.z, set(view_.near)));
    if (hn::AllFalse(d, out.visible)) return out;
    // Parallel rays: all is as at depth 1, and nothing depends on the slope of rays.
    const bool parallel = view_.orthographic;
    const V inv_z = parallel ? set(1) : hn::Div(set(1), p.z);
    const V slope_x = hn::Mul(p.x, inv_z);
    const V slope_y = hn::Mul(p.y, inv_z);
    out.x = mul_add(set(view_.focal_x), slope_x, set(view_.center_x));
    out.y = mul_add(set(view_.focal_y), slope_y, set(view_.center_y));
    const Axes a = axes(i, left);
    V w_x = slope_x;
    V w_y = slope_y;
    if (parallel) {
      w_x = w_y = hn::Zero(d);
    } else if constexpr (!kPerspective) {
      w_x = clamp(slope_x, view_.least_slope_x, view_.most_slope_x);
      w_y = clamp(slope_y, view_.least_slope_y, view_.most_slope_y);
    }
    const Vec3 t_x = scaled(minus(a.x, w_x, a.z), hn::Mul(set(view_.focal_x), inv_z));
    const Vec3 t_y = scaled(minus(a.y, w_y, a.z), hn::Mul(set(view_.focal_y), inv_z));
    Kernel k;
    k.h2 = set(view_.lowpass2);
    k.cross = cross(t_x, t_y);
    const V v_xx = dot(t_x, t_x);
    const V v_yy = dot(t_y, t_y);
    k.det0 = dot(k.cross, k.cross);
    k.det = mul_add(k.h2, hn::Add(hn::Add(v_xx, v_yy), k.h2), k.det0);
    k.xx = hn::Add(v_xx, k.h2);
    k.yy = hn::Add(v_yy, k.h2);
    k.xy = dot(t_x, t_y);
    // Comparisons are false for NaN, which overflow leads to.
    const M sound = hn::And(hn::Gt(hn::Add(k.xx, k.yy), hn::Zero(d)),
                            hn::Lt(mul_add(k.xx, k.yy, k.det), set(1e37F)));
    out.visible = hn::And(out.visible, sound);
    const V amplitude = Column(&cloud_.amplitude[i], 1, left)[0];
    if constexpr (kPerspective) {
      perspective(k, t_x, t_y, scaled(a.z, inv_z), amplitude, out);
      if constexpr (kExact) out.epsilon = footprint(i, left, parallel ? set(1) : p.z);
    } else {
      affine(k, amplitude, out);
    }
    // Whole pixels within the picture.
    out.x0 = hn::Max(out.x0, hn::Zero(d));
    out.y0 = hn::Max(out.y0, hn::Zero(d));
    out.x1 = hn::Min(out.x1, set(static_cast<float>(view_.width - 1)));
    out.y1 = hn::Min(out.y1, set(static_cast<float>(view_.height - 1)));
    out.visible = hn::And(out.visible, hn::And(hn::Le(out.x0, out.x1), hn::Le(out.y0, out.y1)));
    if (hn::AllFalse(d, out.visible)) return out;
    colors(i, left, at, out);
    return out;
  }

  /// The variance J A A' J' + h^2 I on screen, and what it is made of.
  struct Kernel {
    V xx, xy, yy, det;
    V h2;
    Vec3 cross;  ///< T_x x T_y.
    V det0;      ///< |J A A' J'|.
  };

  /// Radius of a kernel with the pixel filter, to sqrt(2) standard deviations, scene units: what
  /// surfels of one surface differ by in depth at most (RenderOptions::depth_epsilon).
  HWY_INLINE V footprint(std::size_t i, std::size_t left, V z) const {
    const Column s(floats(&cloud_.scale[i]), 3, left);
    const V longest = hn::Max(s[0], hn::Max(s[1], s[2]));
    const V pixel = hn::Mul(set(view_.pixel), z);
    return hn::Sqrt(hn::Mul(set(2), mul_add(longest, longest, hn::Mul(pixel, pixel))));
  }

  /// Factor on opacities for what the filter adds to kernels.
  HWY_INLINE V compensation(const Kernel& k) const {
    if constexpr (kProfile == GaussianProfile::kMip) {
      const V least = set(1e-6F);
      const V share = hn::Div(k.det0, hn::Add(k.det, least));
      return hn::IfThenElseZero(hn::Gt(k.det0, least), hn::Sqrt(hn::Add(share, least)));
    }
    if (!kExact && view_.rule != AmplitudeRule::kCompensated) return set(1);
    V share = hn::Div(k.det0, k.det);
    if constexpr (kProfile == GaussianProfile::kInria) share = hn::Max(share, set(2.5e-5F));
    return hn::Sqrt(share);
  }

  /// Pixels whose centres are within `half` of a place.
  static HWY_INLINE V first_pixel(V center, V half) {
    return hn::Ceil(hn::Sub(hn::Sub(center, half), set(0.5F)));
  }
  static HWY_INLINE V last_pixel(V center, V half) {
    return hn::Floor(hn::Sub(hn::Add(center, half), set(0.5F)));
  }

  /// The bounds of a renderer, rounded to its tiles.
  static HWY_INLINE TileRange tiles(V center, V radius) {
    constexpr float kShare = 1.0F / kGaussianTile;
    if constexpr (kProfile == GaussianProfile::kGsplat) {
      return {hn::Floor(hn::Mul(hn::Sub(center, radius), set(kShare))),
              hn::Ceil(hn::Mul(hn::Add(center, radius), set(kShare)))};
    }
    // Pixel centres are whole numbers there.
    const V at = hn::Sub(center, set(0.5F));
    return {hn::Floor(hn::Mul(hn::Sub(at, radius), set(kShare))),
            hn::Floor(hn::Mul(hn::Add(at, hn::Add(radius, set(kGaussianTile - 1))), set(kShare)))};
  }
  static HWY_INLINE void within(const TileRange& tiles, V& first, V& last) {
    first = hn::Max(first, hn::Mul(tiles.first, set(kGaussianTile)));
    last = hn::Min(last, mul_sub(tiles.end, set(kGaussianTile), set(1)));
  }

  /// The exponent's quadratic form times `scale`, base 2.
  static HWY_INLINE void conic(const Kernel& k, V scale, Projected& out) {
    const V half = hn::Mul(scale, set(0.5F * kLog2e));
    out.xx = hn::Mul(half, k.yy);
    out.xy = hn::Mul(hn::Mul(half, set(-2)), k.xy);
    out.yy = hn::Mul(half, k.xx);
  }

  HWY_INLINE V log2_of(V value) const {
    const D d;
    // Logarithms of floats that are no positive normal numbers are not defined.
    const V least = set(1e-30F);
    return hn::Mul(set(kLog2e), log_of_floats(d, hn::Max(value, least)));
  }

  HWY_INLINE void affine(const Kernel& k, V amplitude, Projected& out) const {
    const D d;
    const V opacity = hn::Mul(amplitude, compensation(k));
    out.log_opacity = log2_of(opacity);
    out.visible = hn::And(out.visible, hn::Ge(out.log_opacity, set(kLeastLogAlpha)));
    conic(k, hn::Div(set(1), k.det), out);
    // Half the squared distance, in standard deviations, up to which alpha is 1/255.
    const V reach2 =
        hn::Mul(set(2 * kLn2), hn::Max(hn::Zero(d), hn::Sub(out.log_opacity, set(kLeastLogAlpha))));
    const V deviation_x = hn::Sqrt(k.xx);
    const V deviation_y = hn::Sqrt(k.yy);
    const V reach = hn::Sqrt(reach2);
    const V half_x = mul_add(hn::Mul(reach, deviation_x), set(kWiden), set(kMargin));
    const V half_y = mul_add(hn::Mul(reach, deviation_y), set(kWiden), set(kMargin));
    out.x0 = first_pixel(out.x, half_x);
    out.y0 = first_pixel(out.y, half_y);
    out.x1 = last_pixel(out.x, half_x);
    out.y1 = last_pixel(out.y, half_y);
    V radius_x, radius_y;
    if constexpr (kProfile == GaussianProfile::kGsplat) {
      const V extent = hn::Min(reach, set(3.33F));
      radius_x = hn::Ceil(hn::Mul(extent, deviation_x));
      radius_y = hn::Ceil(hn::Mul(extent, deviation_y));
    } else {
      const V mid = hn::Mul(set(0.5F), hn::Add(k.xx, k.yy));
      const V apart = hn::Mul(set(0.5F), hn::Sub(k.xx, k.yy));
      const V discriminant = mul_add(apart, apart, square(k.xy));
      const V lambda = hn::Add(mid, hn::Sqrt(hn::Max(set(0.1F), discriminant)));
      radius_x = radius_y = hn::Ceil(hn::Mul(set(3), hn::Sqrt(lambda)));
    }
    within(tiles(out.x, radius_x), out.x0, out.x1);
    within(tiles(out.y, radius_y), out.y0, out.y1);
  }

  /// How far the section at k standard deviations of a Gaussian is seen along one axis: middle and
  /// half length, from the centre. Tangent planes n . p = 0 through the eye, n = (1, 0, -X), obey
  /// (n . m)^2 = k n' S n.
  struct Extent {
    V middle, half2;
  };
  static HWY_INLINE Extent extent(V k2, V room, V variance, V with_depth) {
    const V scale = hn::Div(k2, room);
    const V middle = hn::Neg(hn::Mul(scale, with_depth));
    return {middle, mul_add(middle, middle, hn::Mul(scale, variance))};
  }

  /// Whether a Gaussian's section at k standard deviations lies beyond one of the picture's sides:
  /// the planes through the eye and a side obey the same equation.
  /// \param center     of the Gaussian, pixels along one axis.
  /// \param most       end of the picture along it.
  HWY_INLINE M beyond(V k2, V center, float most, V variance, V with_depth, V depth2) const {
    const auto reach2 = [&](V to) HWY_ATTR {
      return hn::Mul(k2,
                     mul_add(mul_sub(to, depth2, hn::Add(with_depth, with_depth)), to, variance));
    };
    const V to_first = hn::Neg(center);
    const V to_last = hn::Sub(set(most), center);
    const V zero = hn::Zero(D());
    return hn::Or(hn::And(hn::Gt(to_first, zero), hn::Gt(square(to_first), reach2(to_first))),
                  hn::And(hn::Lt(to_last, zero), hn::Gt(square(to_last), reach2(to_last))));
  }
  HWY_INLINE M beyond(V k2, const Kernel& k, V xz, V yz, V zz, const Projected& p) const {
    return hn::Or(beyond(k2, p.x, static_cast<float>(view_.width), k.xx, xz, zz),
                  beyond(k2, p.y, static_cast<float>(view_.height), k.yy, yz, zz));
  }

  HWY_INLINE void perspective(const Kernel& k, const Vec3& t_x, const Vec3& t_y, const Vec3& z,
                              V amplitude, Projected& out) const {
    V xz = dot(t_x, z);
    V yz = dot(t_y, z);
    V zz = dot(z, z);
    const V volume = dot(z, k.cross);
    out.d = k.det;
    if (view_.orthographic) {
      // The denominator is the affine kernel's, and the largest contributions lie on a plane.
      out.tx = mul_sub(xz, k.yy, hn::Mul(yz, k.xy));
      out.ty = mul_sub(yz, k.xx, hn::Mul(xz, k.xy));
      out.deviation_z = hn::Sqrt(zz);
      out.dx = out.dy = out.dxx = out.dxy = out.dyy = xz = yz = zz = hn::Zero(D());
    } else {
      // Rows of the adjugate of (T_x, T_y, Z).
      const Vec3 c_x = cross(t_y, z);
      const Vec3 c_y = cross(z, t_x);
      const V two = set(2);
      out.dx = hn::Mul(two, neg_mul_add(k.h2, xz, dot(c_x, k.cross)));
      out.dy = hn::Mul(two, neg_mul_add(k.h2, yz, dot(c_y, k.cross)));
      out.dxx = mul_add(k.h2, zz, dot(c_x, c_x));
      out.dxy = hn::Mul(two, dot(c_x, c_y));
      out.dyy = mul_add(k.h2, zz, dot(c_y, c_y));
      out.deviation_z = hn::Mul(out.z, hn::Sqrt(zz));
      const V half_z = hn::Mul(set(0.5F), out.z);
      out.tx = hn::Mul(half_z, out.dx);
      out.ty = hn::Mul(half_z, out.dy);
    }
    conic(k, set(1), out);
    if constexpr (kExact) {
      exact_bounds(k, xz, yz, zz, volume, amplitude, out);
    } else {
      disc_bounds(k, xz, yz, zz, amplitude, out);
    }
    out.visible = hn::And(out.visible, hn::Lt(hn::Add(out.dxx, out.dyy), set(1e37F)));
  }

  HWY_INLINE void exact_bounds(const Kernel& k, V xz, V yz, V zz, V volume, V amplitude,
                               Projected& out) const {
    const D d;
    V peak;
    if (view_.rule == AmplitudeRule::kDensity) {
      // The optical depth is 2^log_opacity |w| / sqrt(den) times the kernel, with the volume
      // |det(T_x, T_y, Z)| z of the unfiltered Gaussian, since the filter keeps its mass.
      const V depth = view_.orthographic ? set(1) : out.z;
      const V mass = hn::Mul(hn::Mul(amplitude, set(kRootTwoPi)), hn::Mul(hn::Abs(volume), depth));
      out.log_opacity = log2_of(mass);
      // |w| / sqrt(den) is taken for up to eight times its value on the axis, for the cut alone.
      peak = hn::Sub(hn::Add(out.log_opacity, set(3)), hn::Mul(set(0.5F), log2_of(k.det)));
    } else {
      peak = out.log_opacity = log2_of(hn::Mul(amplitude, compensation(k)));
    }
    out.visible = hn::And(out.visible, hn::Gt(peak, set(kLeastLogPeak)));
    out.cut = hn::Add(set(kExactCut), hn::Max(peak, hn::Zero(d)));
    const V k2 = hn::Mul(set(2 * kLn2), out.cut);
    const V room = neg_mul_add(k2, zz, set(1));
    const M bounded = hn::Gt(room, set(kLeastRoom));
    out.nearest = neg_mul_add(hn::Sqrt(k2), out.deviation_z, out.z);
    const auto range = [&](V center, V variance, V with_depth, V& first, V& last) HWY_ATTR {
      const Extent e = extent(k2, hn::Max(room, set(kLeastRoom)), variance, with_depth);
      const V half = mul_add(hn::Sqrt(e.half2), set(kWiden), set(kMargin));
      const V middle = hn::Add(center, e.middle);
      first = hn::IfThenElse(bounded, first_pixel(middle, half), set(-kFar));
      last = hn::IfThenElse(bounded, last_pixel(middle, half), set(kFar));
    };
    range(out.x, k.xx, xz, out.x0, out.x1);
    range(out.y, k.yy, yz, out.y0, out.y1);
    out.visible = hn::AndNot(beyond(k2, k, xz, yz, zz, out), out.visible);
  }

  HWY_INLINE void disc_bounds(const Kernel& k, V xz, V yz, V zz, V amplitude,
                              Projected& out) const {
    const D d;
    out.log_opacity = log2_of(amplitude);
    out.visible = hn::And(out.visible, hn::Ge(out.log_opacity, set(kLeastLogAlpha)));
    const V reach2 =
        hn::Mul(set(2 * kLn2), hn::Max(hn::Zero(d), hn::Sub(out.log_opacity, set(kLeastLogAlpha))));
    // The box at three standard deviations, whose centre is the filter's, even where the disc
    // reaches behind the eye and there is no such box.
    constexpr float kBox2 = 9;
    const V box_room = neg_mul_add(set(kBox2), zz, set(1));
    out.visible = hn::And(out.visible, hn::Ne(box_room, hn::Zero(d)));
    const Extent box_x = extent(set(kBox2), box_room, k.xx, xz);
    const Extent box_y = extent(set(kBox2), box_room, k.yy, yz);
    out.low_x = box_x.middle;
    out.low_y = box_y.middle;
    const V widest = hn::Max(hn::Max(box_x.half2, box_y.half2), set(1e-4F));
    const V radius = hn::Ceil(hn::Max(hn::Sqrt(widest), set(3 * 0.707106F)));
    // What the kernel and the filter, of variance 1/2, leave at least 1/255 of.
    const V room = neg_mul_add(reach2, zz, set(1));
    const M bounded = hn::Gt(room, set(kLeastRoom));
    const V filter = hn::Sqrt(hn::Mul(set(0.5F), reach2));
    // Discs that reach behind the eye are seen anywhere or nowhere.
    const M nowhere = beyond(reach2, k, xz, yz, zz, out);
    const auto range = [&](V center, V low, V variance, V with_depth, V& first, V& last) HWY_ATTR {
      const Extent e = extent(reach2, hn::Max(room, set(kLeastRoom)), variance, with_depth);
      const V half = hn::Sqrt(e.half2);
      const auto seen = [&](V bound, float anywhere, V other) HWY_ATTR {
        return hn::IfThenElse(nowhere, other, hn::IfThenElse(bounded, bound, set(anywhere)));
      };
      const V low_first = hn::Sub(low, filter);
      const V low_last = hn::Add(low, filter);
      const V left = hn::Min(seen(hn::Sub(e.middle, half), -kFar, low_first), low_first);
      const V right = hn::Max(seen(hn::Add(e.middle, half), kFar, low_last), low_last);
      const V margin = set(kMargin);
      first = first_pixel(hn::Add(center, left), margin);
      last = last_pixel(hn::Add(center, right), margin);
      within(tiles(hn::Add(center, low), radius), first, last);
    };
    range(out.x, out.low_x, k.xx, xz, out.x0, out.x1);
    range(out.y, out.low_y, k.yy, yz, out.y0, out.y1);
  }

  HWY_INLINE void colors(std::size_t i, std::size_t left, const Vec3& at, Projected& out) const {
    const std::size_t stride = cloud_.harmonics_stride();
    const Column harmonics(cloud_.harmonics.data() + i * stride, stride, left);
    Vec3 direction{hn::Sub(at.x, set(view_.eye[0])), hn::Sub(at.y, set(view_.eye[1])),
                   hn::Sub(at.z, set(view_.eye[2]))};
    if (view_.orthographic) {
      direction = {set(view_.rotation[6]), set(view_.rotation[7]), set(view_.rotation[8])};
    }
    direction = scaled(direction, hn::Div(set(1), hn::Sqrt(dot(direction, direction))));
    V red = set(0.5F);
    V green = red;
    V blue = red;
    for_each_harmonic(cloud_.degree, direction, [&](std::size_t number, V value) HWY_ATTR {
      red = mul_add(value, harmonics[3 * number], red);
      green = mul_add(value, harmonics[3 * number + 1], green);
      blue = mul_add(value, harmonics[3 * number + 2], blue);
    });
    const V zero = hn::Zero(D());
    out.red = hn::Max(red, zero);
    out.green = hn::Max(green, zero);
    out.blue = hn::Max(blue, zero);
  }

  /// Writes the splats of the lanes that are seen, one after the other; returns how many.
  static HWY_INLINE std::size_t write(const Projected& p, GaussianSplat* splats,
                                      GaussianPerspective* perspective, std::uint32_t* keys) {
    const D d;
    const Ints di;
    constexpr std::size_t kQuarters = kPerspective ? 6 : 4;
    HWY_ALIGN float quarters[kQuarters][4 * kMostLanes];
    const auto pair = [&](V low, V high) HWY_ATTR {
      return hn::BitCast(
          d, hn::Or(hn::ConvertTo(di, low), hn::ShiftLeft<16>(hn::ConvertTo(di, high))));
    };
    const V zero = hn::Zero(d);
    hn::StoreInterleaved4(p.x, p.y, p.xx, p.xy, d, quarters[0]);
    hn::StoreInterleaved4(p.yy, p.log_opacity, p.z, kExact ? p.cut : zero, d, quarters[1]);
    hn::StoreInterleaved4(p.red, p.green, p.blue, pair(p.x0, p.y0), d, quarters[2]);
    const V first = kDiscs ? p.low_x : kExact ? p.epsilon : zero;
    hn::StoreInterleaved4(pair(p.x1, p.y1), first, kDiscs ? p.low_y : zero,
                          kExact ? p.nearest : zero, d, quarters[3]);
    if constexpr (kPerspective) {
      hn::StoreInterleaved4(p.d, p.dx, p.dy, p.dxx, d, quarters[4]);
      hn::StoreInterleaved4(p.dxy, p.dyy, p.tx, p.ty, d, quarters[5]);
    }
    HWY_ALIGN std::int32_t seen[kMostLanes];
    HWY_ALIGN float order[kMostLanes];
    hn::Store(hn::VecFromMask(di, hn::RebindMask(di, p.visible)), di, seen);
    hn::Store(kExact ? hn::Max(p.nearest, zero) : p.z, d, order);
    std::size_t count = 0;
    for (std::size_t lane = 0; lane < hn::Lanes(d); ++lane) {
      if (seen[lane] == 0) continue;
      constexpr std::size_t kBytes = 4 * sizeof(float);
      auto* const to = reinterpret_cast<std::byte*>(splats + count);
      for (std::size_t q = 0; q < 4; ++q) {
        std::memcpy(to + q * kBytes, quarters[q] + 4 * lane, kBytes);
      }
      if constexpr (kPerspective) {
        auto* const more = reinterpret_cast<std::byte*>(perspective + count);
        for (std::size_t q = 0; q < 2; ++q) {
          std::memcpy(more + q * kBytes, quarters[4 + q] + 4 * lane, kBytes);
        }
      }
      std::memcpy(keys + count, order + lane, sizeof(float));
      ++count;
    }
    return count;
  }

  const GaussianView& view_;
  const GaussianCloud& cloud_;
};

}  // namespace

std::size_t project_gaussians_simd(const GaussianView& view, const GaussianCloud& cloud,
                                   std::size_t begin, std::size_t end, GaussianSplat* splats,
                                   GaussianPerspective* perspective, std::uint32_t* keys) {
  const auto run = [&]<GaussianProfile kProfile>() {
    return Projection<kProfile>(view, cloud).run(begin, end, splats, perspective, keys);
  };
  switch (view.profile) {
    case GaussianProfile::kGsplat:
      return run.template operator()<GaussianProfile::kGsplat>();
    case GaussianProfile::kMip:
      return run.template operator()<GaussianProfile::kMip>();
    case GaussianProfile::k2dgs:
      return run.template operator()<GaussianProfile::k2dgs>();
    case GaussianProfile::kExact:
    case GaussianProfile::kSurfel:
      return run.template operator()<GaussianProfile::kExact>();
    case GaussianProfile::kInria:
      break;
  }
  return run.template operator()<GaussianProfile::kInria>();
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {

HWY_EXPORT(project_gaussians_simd);

GaussianView gaussian_view(const GaussianCloud& cloud, const Camera& camera,
                           const GaussianOptions& options) {
  GaussianView view{};
  const bool surfaces = options.profile == GaussianProfile::kSurfel;
  view.profile = surfaces ? GaussianProfile::kExact : options.profile;
  view.rule = surfaces ? AmplitudeRule::kSurfel : cloud.rule;
  const Vec3d eye = camera.eye - cloud.origin;
  const Vec3d translation = camera.camera_from_world * -eye;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      view.rotation[3 * i + j] = static_cast<float>(camera.camera_from_world(i, j));
    }
    view.translation[i] = static_cast<float>(translation[i]);
    view.eye[i] = static_cast<float>(eye[i]);
  }
  view.focal_x = static_cast<float>(camera.focal_x);
  view.focal_y = static_cast<float>(camera.focal_y);
  view.center_x = static_cast<float>(camera.center_x);
  view.center_y = static_cast<float>(camera.center_y);
  view.orthographic = camera.orthographic;
  view.width = camera.width;
  view.height = camera.height;
  // 1.3 times the tangent of half the field of view, from the principal point on both sides.
  const double rim_x = 0.3 * 0.5 * camera.width / camera.focal_x;
  const double rim_y = 0.3 * 0.5 * camera.height / camera.focal_y;
  view.least_slope_x = static_cast<float>(-camera.center_x / camera.focal_x - rim_x);
  view.most_slope_x = static_cast<float>((camera.width - camera.center_x) / camera.focal_x + rim_x);
  view.least_slope_y = static_cast<float>(-camera.center_y / camera.focal_y - rim_y);
  view.most_slope_y =
      static_cast<float>((camera.height - camera.center_y) / camera.focal_y + rim_y);
  double near = 0.2;
  switch (options.profile) {
    case GaussianProfile::kInria:
      view.lowpass2 = 0.3F;
      break;
    case GaussianProfile::kGsplat:
      view.lowpass2 = 0.3F;
      near = 0.01;
      break;
    case GaussianProfile::kMip:
      view.lowpass2 = 0.1F;
      break;
    case GaussianProfile::k2dgs:
      view.lowpass2 = 0;
      break;
    case GaussianProfile::kExact:
    case GaussianProfile::kSurfel:
      view.lowpass2 = static_cast<float>(options.lowpass * options.lowpass);
      near = 0;
      break;
  }
  view.pixel = std::sqrt(view.lowpass2) / std::fmin(view.focal_x, view.focal_y);
  // The trained renderers' least depths are of their perspective.
  view.near = static_cast<float>(camera.orthographic ? camera.near : std::fmax(near, camera.near));
  return view;
}

std::size_t project_gaussians(const GaussianView& view, const GaussianCloud& cloud,
                              std::size_t begin, std::size_t end, GaussianSplat* splats,
                              GaussianPerspective* perspective, std::uint32_t* keys) {
  return HWY_DYNAMIC_DISPATCH(project_gaussians_simd)(view, cloud, begin, end, splats, perspective,
                                                      keys);
}

}  // namespace surfel
#endif
