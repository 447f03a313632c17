// Zwicker, Pfister, van Baar, Gross, "Surface Splatting", SIGGRAPH 2001: equations (4) and (6).
// Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 6(1), 2017: the tangent frame.
// ewa_kernel.cpp holds these equations in plain double.

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
#include <surfel/base/fused-inl.h>
#include <surfel/base/normal_cdf-inl.h>
#include <surfel/base/power-inl.h>
#include <surfel/base/vec3-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<float, 16>;
using V = hn::Vec<D>;
using M = hn::Mask<D>;
using Ints = hn::RebindToSigned<D>;

using Vec3 = HWY_NAMESPACE::Vec3<V>;

HWY_INLINE Vec3 rotate(const float* r, const Vec3& v) {
  const D d;
  const auto row = [&](int i) {
    return mul_add(hn::Set(d, r[i]), v.x,
                   mul_add(hn::Set(d, r[i + 1]), v.y, hn::Mul(hn::Set(d, r[i + 2]), v.z)));
  };
  return {row(0), row(3), row(6)};
}

/// Unit tangent perpendicular to the unit vector n.
HWY_INLINE Vec3 any_tangent(const Vec3& n) {
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
/// The bound of the cosine for the depth gradient, which is exact down to where single precision
/// keeps four digits of the cosine.
constexpr float kLeastGradientCosine = 1e-3F;
/// Where Phi is above kLeastClipShare, and what it leaves to 1 is: 1 - Phi(3.0903) is that share.
constexpr float kSeenClip = 3.1F;
constexpr float kInvTwoPi = 0.15915494309189535F;  ///< 1 / (2 pi), of the normalised Gaussian.
constexpr float kInvRootTwoPi = 0.39894228040143268F;
/// From the eye's plane, in radii: nearer discs may be seen anywhere.
constexpr float kLeastDistance = 0.01F;

/// Centres of surfels in camera space and in the picture, and their extents.
struct Discs {
  Vec3 p;                      ///< Camera space.
  V inv_z;                     ///< 1 / p.z; orthographic: 1.
  V slope_x, slope_y;          ///< p.x / p.z and p.y / p.z; orthographic: 0.
  V x, y;                      ///< Pixels.
  V deviation_u, deviation_v;  ///< Standard deviations, scene units.
  V deviation,
      radius;  ///< The larger deviation, and the disc's radius, which is sqrt(2 c) times as large.
};

/// Tangent frames of surfels in camera space, and the columns of J V^(1/2), pixels.
struct Axes {
  Vec3 tangent, bitangent;
  V tx, ty, bx, by;
};

/// What kernels are made of.
struct Shape {
  Axes axes;
  V share;    ///< Factor on the kernels' volumes.
  V stretch;  ///< The area that the axes span over the one of the whole surfels' axes.
};

/// Resampling kernels (6) of surfels, as Splat has them.
struct Kernels {
  V m, k, q, amplitude;
  V half_x, half_y;  ///< Half the sides of the box around beta < c, pixels.
  V size2;           ///< Sum of the squared half sides of the box without the pixel filter.
  V n_ray;           ///< Normal . (slope_x, slope_y, 1).
};

/// Half-planes that cut surfels.
struct HalfPlanes {
  M exists;
  Vec3 direction;  ///< Camera space.
  V distance;
  V w_u, w_v;  ///< The direction times the deviations, V^(1/2) n.
};

/// Gaussians that have the volume, the mean and the variance of cut ones.
struct CutGaussians {
  M made;              ///< Surfels that have one. The other lanes mean nothing.
  M gone;              ///< Less than kLeastClipShare of the volume is left.
  V share;             ///< Of the volume.
  V mean_u, mean_v;    ///< In standard deviations of the whole Gaussian along its axes.
  V l_uu, l_uv, l_vv;  ///< Cholesky factor of the variance, in the same units.
};

/// What half-planes leave of kernels, as SplatClip has it.
struct Cuts {
  V line[2][3], outward[2][2], joint, beyond;
  M clipped;  ///< Some of what is seen is cut off ...
  M gone;     ///< ... or all of it.
  /// How far what is left reaches, as shares of Kernels::half_x and half_y.
  V left, right, up, down;
};

/// Depth planes of surfels, as Splat has them.
struct DepthPlanes {
  V depth, depth_dx, depth_dy, depth_range;
  M front;    ///< The surfel's front faces the eye.
  M grazing;  ///< It is seen at a grazing angle.
};

/// The range of the rectangle's pixels whose centres lie between two places, both included;
/// `unclipped` is the first one where the rectangle had no left end.
struct Pixels {
  V unclipped, first, last;
};

/// Which surfels become splats.
struct Classes {
  M visible, exact;
};

/// Everything about a vector of surfels that a Splat keeps.
struct Projected {
  Discs discs;
  Axes axes;
  Kernels kernels;
  DepthPlanes planes;
  Pixels columns, rows;
  Classes classes;
  Cuts cuts;  ///< Of surfels that half-planes cut.
};

/// Fetches the columns of a cluster into the caches, a vector at a time.
class Fetcher {
 public:
  explicit Fetcher(const SurfelColumns* surfels) {
    if (!surfels) return;
    const SurfelColumns& s = *surfels;
    for (const float* column :
         {s.x,         s.y,           s.z,           s.normal_x,        s.normal_y,
          s.normal_z,  s.deviation_u, s.deviation_v, s.tangent_x,       s.tangent_y,
          s.tangent_z, s.area,        s.red,         s.green,           s.blue,
          s.alpha,     s.clip[0].x,   s.clip[0].y,   s.clip[0].z,       s.clip[0].distance,
          s.clip[1].x, s.clip[1].y,   s.clip[1].z,   s.clip[1].distance}) {
      if (column) columns_[count_++] = column;
    }
  }
  HWY_INLINE void fetch(int i) const {
    for (int column = 0; column < count_; ++column) hwy::Prefetch(columns_[column] + i);
  }

 private:
  const float* columns_[sizeof(SurfelColumns) / sizeof(const float*)];
  int count_ = 0;
};

/// Writes splats and lists which surfels they are of.
/// \tparam kClips  Some surfels may be cut by half-planes.
template <bool kClips>
class Writer {
 public:
  Writer(const SurfelColumns& in, const SplatView& view, Splat* splats, SplatClip* clips,
         SetUpSplats& out)
      : in_(in),
        splats_(splats),
        clips_(clips),
        out_(out),
        first_column_(view.first_column),
        first_row_(view.first_row),
        filtered_diagonal2_(diagonal2(view, 1)),
        fine_diagonal2_(diagonal2(view, kFineVariance)) {}

  /// The surfels from i on.
  HWY_INLINE void write(int i, const Projected& s) {
    HWY_ALIGN float quarters[4][4 * kTileSize];
    interleave(i, s, quarters);
    const D d;
    const Ints di;
    HWY_ALIGN std::int32_t taken[kTileSize];
    hn::Store(hn::VecFromMask(di, hn::RebindMask(di, s.classes.visible)), di, taken);
    if constexpr (kClips) {
      if (!hn::AllFalse(d, s.cuts.clipped)) {
        HWY_ALIGN float clips[3][4 * kTileSize];
        interleave(s.cuts, clips);
        put(clips, taken, clips_ + (splats_ - first_splat_));
      }
    }
    splats_ = put(quarters, taken, splats_);
    M first = s.classes.visible;
    if (!first_column_) first = hn::And(first, hn::Ge(s.columns.unclipped, hn::Zero(d)));
    if (!first_row_) first = hn::And(first, hn::Ge(s.rows.unclipped, hn::Zero(d)));
    first_count_ += hn::CountTrue(d, first);
    note(i, s.classes.visible, out_.visible, visible_count_);
    if (!hn::AllFalse(d, s.classes.exact)) note(i, s.classes.exact, out_.exact, exact_count_);
  }

  void finish() const {
    out_.visible_count = visible_count_;
    out_.exact_count = exact_count_;
    out_.first_count = static_cast<int>(first_count_);
  }

 private:
  /// Bytes of four fields that follow one another in a Splat or SplatClip.
  static constexpr std::size_t kQuarter = 4 * sizeof(float);

  /// Puts the records of the lanes that are taken (-1; 0: not) one after the other. Returns where
  /// the next one goes. A member would be read from memory again at every lane, since what is
  /// written might alias it.
  /// \param quarters  of the records of all lanes.
  template <std::size_t kQuarters, class Record>
  static HWY_INLINE Record* put(const float (&quarters)[kQuarters][4 * kTileSize],
                                const std::int32_t* taken, Record* next) {
    static_assert(sizeof(Record) >= kQuarters * kQuarter);
    Record dropped;
    for (std::size_t lane = 0; lane < hn::Lanes(D()); ++lane) {
      // Records that are not taken go where nobody reads.
      auto* const to = reinterpret_cast<std::byte*>(taken[lane] != 0 ? next : &dropped);
      for (std::size_t q = 0; q < kQuarters; ++q) {
        std::memcpy(to + q * kQuarter, quarters[q] + 4 * lane, kQuarter);
      }
      next -= taken[lane];
    }
    return next;
  }

  /// The half-planes of all lanes: the fields of SplatClip, of which the last ones are not used.
  static HWY_INLINE void interleave(const Cuts& c, float (&quarters)[3][4 * kTileSize]) {
    const D d;
    static_assert(offsetof(SplatClip, outward) == 6 * sizeof(float) &&
                  offsetof(SplatClip, joint) == 10 * sizeof(float) &&
                  offsetof(SplatClip, beyond) == 11 * sizeof(float));
    hn::StoreInterleaved4(c.line[0][0], c.line[0][1], c.line[0][2], c.line[1][0], d, quarters[0]);
    hn::StoreInterleaved4(c.line[1][1], c.line[1][2], c.outward[0][0], c.outward[0][1], d,
                          quarters[1]);
    hn::StoreInterleaved4(c.outward[1][0], c.outward[1][1], c.joint, c.beyond, d, quarters[2]);
  }

  /// The splats of all lanes, a quarter of their fields at a time.
  HWY_INLINE void interleave(int i, const Projected& s, float (&quarters)[4][4 * kTileSize]) const {
    const D d;
    const Ints di;
    const hn::RebindToUnsigned<D> du;
    const auto byte_of = [&](V place)
                             HWY_ATTR { return hn::BitCast(du, hn::ConvertTo(di, place)); };
    const auto box =
        hn::Or(hn::Or(byte_of(s.columns.first), hn::ShiftLeft<8>(byte_of(s.rows.first))),
               hn::Or(hn::ShiftLeft<16>(byte_of(s.columns.last)),
                      hn::ShiftLeft<24>(byte_of(s.rows.last))));
    const auto flag = [&](M mask, std::uint32_t bit) HWY_ATTR {
      return hn::IfThenElseZero(hn::RebindMask(du, mask), hn::Set(du, bit));
    };
    const Kernels& k = s.kernels;
    const V diagonal2 = mul_add(k.half_x, k.half_x, hn::Mul(k.half_y, k.half_y));
    auto tag = hn::Or3(flag(s.planes.front, kFrontTag), flag(s.planes.grazing, kGrazingTag),
                       hn::Or(flag(hn::Lt(diagonal2, filtered_diagonal2_), kFilteredTag),
                              flag(hn::Lt(diagonal2, fine_diagonal2_), kFineTag)));
    if constexpr (kClips) tag = hn::Or(tag, flag(s.cuts.clipped, kClippedTag));
    const V alpha = in_.alpha ? hn::LoadU(d, in_.alpha + i) : hn::Set(d, 1.0F);
    const auto color = [&](const float* column)
                           HWY_ATTR { return hn::Mul(hn::LoadU(d, column + i), alpha); };
    hn::StoreInterleaved4(s.discs.x, s.discs.y, k.m, k.k, d, quarters[0]);
    hn::StoreInterleaved4(k.q, k.amplitude, s.planes.depth, s.planes.depth_dx, d, quarters[1]);
    hn::StoreInterleaved4(s.planes.depth_dy, s.planes.depth_range, hn::BitCast(d, box),
                          color(in_.red), d, quarters[2]);
    hn::StoreInterleaved4(color(in_.green), color(in_.blue), alpha, hn::BitCast(d, tag), d,
                          quarters[3]);
  }

  /// A whole vector fits: there are no more of either list than lanes before.
  static HWY_INLINE void note(int i, M mask, std::int32_t* to, int& noted) {
    const Ints di;
    const Compressor<D> listed(mask);
    listed.store(hn::Iota(di, i), di, to + noted);
    noted += static_cast<int>(listed.count());
  }

  const SurfelColumns& in_;
  Splat* splats_;
  const Splat* first_splat_ = splats_;
  SplatClip* clips_;  ///< Of first_splat_.
  SetUpSplats& out_;
  bool first_column_, first_row_;
  /// The squared half diagonal of the box of a kernel whose surfel has `times` the variance of the
  /// pixel filter.
  static V diagonal2(const SplatView& view, float times) {
    return hn::Set(D(), 4.0F * view.cutoff * (1 + times) * view.lowpass2);
  }

  V filtered_diagonal2_;  ///< Squared diagonal below which a kernel's box is the filter's ...
  V fine_diagonal2_;      ///< ... and below which a splat is fine.
  int visible_count_ = 0;
  int exact_count_ = 0;
  std::size_t first_count_ = 0;
};

/// Projects the surfels of a cluster, a vector at a time.
template <bool kPerspective, bool kAnisotropic, bool kClips>
class SplatSetup {
 public:
  SplatSetup(const SplatView& view, const SurfelColumns& in)
      : view_(view),
        in_(in),
        focal_x_(hn::Set(D(), view.focal_x)),
        focal_y_(hn::Set(D(), view.focal_y)),
        h2_(hn::Set(D(), view.lowpass2)),
        two_c_(hn::Set(D(), 2.0F * view.cutoff)),
        margin_(hn::Set(D(), view.margin)),
        filter_reach_(hn::Add(hn::Sqrt(hn::Mul(two_c_, h2_)), margin_)) {}

  void run(int count, const SurfelColumns* next, Splat* splats, SplatClip* clips,
           SetUpSplats& out) const {
    const D d;
    const Fetcher ahead(next);
    Writer<kClips> writer(in_, view_, splats, clips, out);
    Projected s;
    for (int i = 0; i < count; i += static_cast<int>(hn::Lanes(d))) {
      ahead.fetch(i);
      s.discs = discs(i);
      // Most clusters that reach over the rectangle's edge have surfels far outside of it.
      if (!view_.circular && all_outside(s.discs)) continue;
      const V distance = kPerspective ? hn::Sqrt(dot(s.discs.p, s.discs.p)) : hn::Set(d, 1.0F);
      const Vec3 n = normals(i, s.discs, distance);
      s.axes = axes(i, s.discs, n);
      Shape shape{s.axes, hn::Set(d, 1.0F), hn::Set(d, 1.0F)};
      V dx, dy;  // From the surfel's centre to the one of the kernel.
      M gone = hn::FirstN(d, 0);
      M moved = gone;
      HalfPlanes lines[2];
      if constexpr (kClips) {
        for (int j = 0; j < 2; ++j) lines[j] = half_planes(in_.clip[j], i, s);
        if (view_.edges_filtered) {
          const CutGaussians cut = cut_filtered(lines, s, shape);
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
        s.cuts = cuts(n, lines, s);
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
  HWY_INLINE Vec3 normals(int i, const Discs& s, V distance) const {
    const D d;
    const V zero = hn::Zero(d);
    Vec3 n = rotate(view_.rotation, {hn::LoadU(d, in_.normal_x + i), hn::LoadU(d, in_.normal_y + i),
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

  HWY_INLINE Axes axes(int i, const Discs& s, const Vec3& n) const {
    const D d;
    // Columns of J V^(1/2): see screen_from_tangent_jacobian().
    Axes out;
    Vec3& t = out.tangent;
    if constexpr (kAnisotropic) {
      t = rotate(view_.rotation, {hn::LoadU(d, in_.tangent_x + i), hn::LoadU(d, in_.tangent_y + i),
                                  hn::LoadU(d, in_.tangent_z + i)});
    } else {
      t = any_tangent(n);
    }
    const Vec3 b = cross(n, t);
    out.bitangent = b;
    const V scale_x = hn::Mul(focal_x_, s.inv_z);
    const V scale_y = hn::Mul(focal_y_, s.inv_z);
    out.tx = hn::Mul(hn::Mul(scale_x, s.deviation_u), neg_mul_add(s.slope_x, t.z, t.x));
    out.ty = hn::Mul(hn::Mul(scale_y, s.deviation_u), neg_mul_add(s.slope_y, t.z, t.y));
    out.bx = hn::Mul(hn::Mul(scale_x, s.deviation_v), neg_mul_add(s.slope_x, b.z, b.x));
    out.by = hn::Mul(hn::Mul(scale_y, s.deviation_v), neg_mul_add(s.slope_y, b.z, b.y));
    return out;
  }

  HWY_INLINE Kernels kernels(int i, const Discs& s, const Vec3& n, const Shape& shape) const {
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

  HWY_INLINE HalfPlanes half_planes(const HalfPlaneColumns& columns, int i,
                                    const Projected& s) const {
    const D d;
    HalfPlanes out;
    out.exists = hn::FirstN(d, 0);
    if (!columns.x) return out;
    const Vec3 world{hn::LoadU(d, columns.x + i), hn::LoadU(d, columns.y + i),
                     hn::LoadU(d, columns.z + i)};
    out.exists = hn::Gt(dot(world, world), hn::Zero(d));
    if (hn::AllFalse(d, out.exists)) return out;
    out.direction = rotate(view_.rotation, world);
    out.distance = hn::LoadU(d, columns.distance + i);
    out.w_u = hn::Mul(dot(out.direction, s.axes.tangent), s.discs.deviation_u);
    out.w_v = hn::Mul(dot(out.direction, s.axes.bitangent), s.discs.deviation_v);
    return out;
  }

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
  HWY_INLINE Cuts cuts(const Vec3& n, const HalfPlanes (&planes)[2], const Projected& s) const {
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

  /// A half-plane of a vector of surfels, and what cuts() needs of it.
  struct Line : HalfPlanes {
    V across_x, across_y;  ///< w_u b - w_v t, with the columns of J V^(1/2).
    V out_x, out_y;        ///< SplatClip::outward.
    V inv_s;
  };

  HWY_INLINE Line line(const HalfPlanes& of, const Vec3& n, const Projected& s) const {
    const D d;
    const V zero = hn::Zero(d);
    Line out;
    static_cast<HalfPlanes&>(out) = of;
    if (hn::AllFalse(d, out.exists)) return out;
    const Vec3& direction = of.direction;
    const auto& [t, b, tx, ty, bx, by] = s.axes;
    out.across_x = mul_sub(out.w_u, bx, hn::Mul(out.w_v, tx));
    out.across_y = mul_sub(out.w_u, by, hn::Mul(out.w_v, ty));
    const Vec3 along = cross(n, direction);
    Vec3 plane{along.y, hn::Neg(along.x), zero};
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

  /// See depth_plane(). normal . p = n_ray * p.z.
  HWY_INLINE DepthPlanes depth_planes(const Discs& s, const Vec3& n, V n_ray, V distance) const {
    const D d;
    const V one = hn::Set(d, 1.0F);
    const V inv_focal_x = hn::Set(d, 1.0F / view_.focal_x);
    const V inv_focal_y = hn::Set(d, 1.0F / view_.focal_y);
    const V n_p = kPerspective ? hn::Mul(n_ray, s.p.z) : n.z;
    const V least = hn::Mul(hn::Set(d, kLeastGradientCosine), distance);
    const V inv_np = hn::Div(one, hn::CopySign(hn::Max(hn::Abs(n_p), least), n_p));
    // Footprint of the combined kernel on the tangent plane: disc and pixel filter, the latter
    // divided by the cosine.
    const V inv_cosine = hn::Min(hn::Mul(hn::Abs(inv_np), distance), hn::Set(d, 1 / kLeastCosine));
    // Standard deviation of the pixel filter at distance 1.
    const V pixel = hn::Mul(hn::Sqrt(h2_), hn::Max(inv_focal_x, inv_focal_y));
    const V pixel_on_plane = hn::Mul(kPerspective ? hn::Mul(pixel, s.p.z) : pixel, inv_cosine);
    const V reach = hn::Sqrt(hn::Mul(
        two_c_, mul_add(s.deviation, s.deviation, hn::Mul(pixel_on_plane, pixel_on_plane))));
    DepthPlanes out;
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
  HWY_INLINE Classes classify(const Discs& s, const Vec3& n, V size2) const {
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
  V focal_x_, focal_y_, h2_, two_c_;
  V margin_;
  V filter_reach_;  ///< Radius of the pixel filter, and the margin, pixels.
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
