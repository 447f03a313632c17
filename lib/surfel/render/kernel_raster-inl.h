// Zwicker, Pfister, van Baar, Gross, "Surface Splatting", SIGGRAPH 2001: section 4. The common
// parts of all SIMD rasterisers of a tile; included once for each target, see Highway's
// documentation.

#if defined(SURFEL_RENDER_KERNEL_RASTER_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SURFEL_RENDER_KERNEL_RASTER_INL_H_
#undef SURFEL_RENDER_KERNEL_RASTER_INL_H_
#else
#define SURFEL_RENDER_KERNEL_RASTER_INL_H_
#endif

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include <hwy/cache_control.h>
#include <hwy/highway.h>
#include <surfel/base/compress-inl.h>
#include <surfel/base/float_lanes-inl.h>
#include <surfel/base/fused-inl.h>
#include <surfel/base/lane_sums-inl.h>
#include <surfel/base/normal_cdf-inl.h>
#include <surfel/render/a_buffer.h>
#include <surfel/render/tile_raster.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
static_assert(hn::MaxLanes(D()) <= std::size_t{kTileSize});

/// For the body of the innermost loop: vectors passed to a function go through memory.
#undef SURFEL_INLINE_LAMBDA
#define SURFEL_INLINE_LAMBDA __attribute__((always_inline))

/// exp(-x) for x in [0, 1]: coefficients of the polynomial of degree 5 that interpolates it at
/// Chebyshev's nodes, whose relative error is below 1.1e-6.
inline constexpr float kExpMinus[] = {0.999999554F,  -0.999967851F, 0.499620874F,
                                      -0.165012717F, 0.0383389223F, -0.00509972763F};

HWY_ALIGN inline constexpr float kColumnOfLane[] = {0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3};
HWY_ALIGN inline constexpr float kRowOfLane[] = {0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3};

/// The values of a splat's kernel and plane at a vector of pixels.
struct Sample {
  V beta;       ///< Less than the cutoff inside.
  V depth;      ///< Depth of the surfel's plane, within the kernel's reach.
  V epsilon;    ///< Fragments whose depths differ by less are of one surface.
  V amplitude;  ///< rho where beta is 0.
};

/// What half-planes leave of a splat's kernel at a vector of pixels.
struct ClipShares {
  V all;      ///< C, what they leave together.
  V line[2];  ///< C_j, what each line leaves by itself.
};

/// What half-planes cut off from a contribution: rho is the kernel without them.
struct CutContribution {
  V away;        ///< rho (1 - C) times SplatClip::beyond.
  V partial[2];  ///< rho C (1 - C_j) of the lines.

  HWY_INLINE V all_partial() const { return hn::Add(partial[0], partial[1]); }
  /// The sum of `partial` times SplatClip::outward along an axis.
  HWY_INLINE V outward(const SplatClip& clip, int axis) const {
    return mul_add(partial[0], hn::Set(D(), clip.outward[0][axis]),
                   hn::Mul(partial[1], hn::Set(D(), clip.outward[1][axis])));
  }
};

/// Whether the second line of a splat cuts it, too.
HWY_INLINE bool has_two_lines(const SplatClip& clip) { return clip.line[1][0] < kNoClip; }

/// Evaluates the splats of one tile at its pixels, a vector at a time. Small, so that a loop keeps
/// a copy of its own in registers: a value behind a reference has to be read again after every
/// store.
class SplatSampler {
 public:
  /// \param x0, y0  the tile's first pixel in the picture.
  SplatSampler(const TileJob& job, int x0, int y0)
      : splats_(job.splats),
        exact_(job.exact),
        clips_(job.clips),
        lowpass2_(job.rules->lowpass2),
        block_x_(static_cast<float>(x0 - job.box_x)),
        block_y_(static_cast<float>(y0 - job.box_y)) {
    for (int i = 0; i <= kMostEven; ++i) {
      depth_epsilon_[i] = std::ldexp(job.rules->depth_epsilon, -i);
    }
    // exp(-beta) = exp(-beta / 2^n)^(2^n), with beta / 2^n at most 1.
    float scale = 1;
    for (; job.rules->cutoff * scale > 1; scale /= 2) ++squarings_;
    float power = 1;
    for (int i = 0; i < 6; ++i, power *= scale) exp_minus_[i] = kExpMinus[i] * power;
  }

  /// exp(-beta) where beta is less than the cutoff; anything elsewhere, infinities and NaN too.
  HWY_INLINE V decay(V beta) const {
    const D d;
    V rho = hn::Set(d, exp_minus_[5]);
    for (int i = 4; i >= 0; --i) rho = mul_add(rho, beta, hn::Set(d, exp_minus_[i]));
    for (int i = 0; i < squarings_; ++i) rho = hn::Mul(rho, rho);
    return rho;
  }

  /// A splat's values at the pixels with centres (x, y). Discs end at the lines that cut them: beta
  /// is infinite where less than half of the kernel is left.
  HWY_INLINE Sample at(std::uint32_t index, V x, V y) const {
    Sample s = uncut_at(index, x, y);
    if (HWY_UNLIKELY(is_clipped(index))) {
      const M left = hn::Ge(share_left(index, x, y), hn::Set(D(), 0.5F));
      s.beta = hn::IfThenElse(left, s.beta, hn::Set(D(), __builtin_inff()));
    }
    return s;
  }

  /// As at(), without the lines.
  /// \param arguments  null, or gets the arguments of Phi for both lines of a splat that is cut.
  HWY_INLINE Sample uncut_at(std::uint32_t index, V x, V y, V* arguments = nullptr) const {
    const D d;
    const Splat& splat = splats_[index];
    const V dx = hn::Sub(x, hn::Set(d, splat.x));
    const V dy = hn::Sub(y, hn::Set(d, splat.y));
    Sample s;
    if (HWY_UNLIKELY(splat.k < 0)) {
      // The fields are taken one by one, as a returned structure lies in memory.
      V z[2];
      const Sample e = exact(exact_[index], {lowpass2_, epsilon_share(splat)}, dx, dy,
                             arguments ? clips_ + index : nullptr, z);
      if (arguments) std::copy_n(z, 2, arguments);
      s.beta = hn::IfThenElse(in_box(splat.box, x, y), e.beta, hn::Set(d, __builtin_inff()));
      s.depth = e.depth;
      s.epsilon = e.epsilon;
      s.amplitude = e.amplitude;
      return s;
    }
    const V range = hn::Set(d, splat.depth_range);
    const V slope =
        mul_add(hn::Set(d, splat.depth_dx), dx, hn::Mul(hn::Set(d, splat.depth_dy), dy));
    const V e = neg_mul_add(hn::Set(d, splat.m), dy, dx);
    s.beta =
        mul_add(hn::Mul(hn::Set(d, splat.k), e), e, hn::Mul(hn::Mul(hn::Set(d, splat.q), dy), dy));
    s.depth = hn::Add(hn::Min(hn::Max(slope, hn::Neg(range)), range), hn::Set(d, splat.depth));
    s.epsilon = hn::Mul(range, epsilon_share(splat));
    s.amplitude = hn::Set(d, splat.amplitude);
    if (arguments) {
      const SplatClip& clip = clips_[index];
      const auto affine = [&](const float* line) HWY_ATTR SURFEL_INLINE_LAMBDA {
        return mul_add(hn::Set(d, line[1]), dx,
                       mul_add(hn::Set(d, line[2]), dy, hn::Set(d, line[0])));
      };
      arguments[0] = affine(clip.line[0]);
      arguments[1] = has_two_lines(clip) ? affine(clip.line[1]) : hn::Set(d, kWholeClip);
    }
    return s;
  }

  /// Whether a splat is cut by half-planes.
  HWY_INLINE bool is_clipped(std::uint32_t index) const {
    return clips_ && (splats_[index].tag & kClippedTag) != 0;
  }

  /// What half-planes leave of a splat that is cut by some.
  HWY_INLINE ClipShares shares(std::uint32_t index, V first, V second) const {
    const D d;
    const SplatClip& clip = clips_[index];
    const V one = hn::Set(d, 1.0F);
    const auto share = [&](V z) HWY_ATTR SURFEL_INLINE_LAMBDA {
      return hn::IfThenElse(hn::Ge(z, hn::Set(d, kWholeClip)), one, normal_cdf(z));
    };
    ClipShares out;
    out.line[0] = out.all = share(first);
    out.line[1] = one;
    if (!has_two_lines(clip)) return out;
    const V a = out.line[0];
    const V b = share(second);
    // joined() of clip_kernel.h.
    const V product = hn::Mul(a, b);
    const V joint = hn::Set(d, clip.joint);
    const V bound = hn::IfThenElse(hn::Gt(joint, hn::Zero(d)), hn::Min(a, b),
                                   hn::Max(hn::Zero(d), hn::Sub(hn::Add(a, b), one)));
    out.all = mul_add(hn::Abs(joint), hn::Sub(bound, product), product);
    out.line[1] = b;
    return out;
  }

  /// Leaves of a splat's contribution rho what half-planes leave; returns what they cut off.
  /// \param first, second  the arguments that uncut_at() gives.
  HWY_INLINE CutContribution cut(std::uint32_t index, V first, V second, V& rho) const {
    const D d;
    const V one = hn::Set(d, 1.0F);
    const ClipShares share = shares(index, first, second);
    const V whole = rho;
    rho = hn::Mul(rho, share.all);
    CutContribution out;
    out.away = hn::Mul(hn::Sub(whole, rho), hn::Set(d, clips_[index].beyond));
    out.partial[0] = hn::Mul(rho, hn::Sub(one, share.line[0]));
    out.partial[1] = hn::Mul(rho, hn::Sub(one, share.line[1]));
    return out;
  }

 private:
  /// What half-planes leave, in a function apart, as in most pictures few splats come here.
  HWY_NOINLINE V share_left(std::uint32_t index, V x, V y) const {
    V z[2];
    uncut_at(index, x, y, z);
    return shares(index, z[0], z[1]).all;
  }

  /// Epsilon by depth range.
  HWY_INLINE V epsilon_share(const Splat& splat) const {
    return hn::Set(D(), depth_epsilon_[splat.tag >> kEvenShift & kMostEven]);
  }

  /// Whether pixels lie in a splat's box, beyond which an exact kernel's linearised filter may
  /// reach: a pixel must not depend on whether the box meets other pixels of its vector.
  HWY_INLINE M in_box(const PixelBox& box, V x, V y) const {
    const D d;
    const auto between = [&](V at, float block, int first, int last) HWY_ATTR {
      const V in_block = hn::Sub(at, hn::Set(d, block));
      return hn::And(hn::Gt(in_block, hn::Set(d, static_cast<float>(first))),
                     hn::Lt(in_block, hn::Set(d, static_cast<float>(last + 1))));
    };
    return hn::And(between(x, block_x_, box.x0, box.x1), between(y, block_y_, box.y0, box.y1));
  }

  static HWY_INLINE V sum2(V a, V b) { return mul_add(a, a, hn::Mul(b, b)); }

  /// Where pixels' rays meet the tangent plane of an exact kernel.
  struct PlanePoint {
    V plane;           ///< 1 / z.
    V z, u, v;         ///< Depth, and plane coordinates in standard deviations.
    V ux, uy, vx, vy;  ///< z times their gradients on screen: J^-1 at the pixel.

    HWY_INLINE PlanePoint(const ExactSplat& exact, V dx, V dy) {
      const D d;
      const auto affine = [&](const float* f) HWY_ATTR {
        return mul_add(hn::Set(d, f[1]), dx, mul_add(hn::Set(d, f[2]), dy, hn::Set(d, f[0])));
      };
      plane = affine(exact.depth);
      z = hn::Div(hn::Set(d, 1.0F), plane);
      u = hn::Mul(affine(exact.u), z);
      v = hn::Mul(affine(exact.v), z);
      ux = neg_mul_add(u, hn::Set(d, exact.depth[1]), hn::Set(d, exact.u[1]));
      uy = neg_mul_add(u, hn::Set(d, exact.depth[2]), hn::Set(d, exact.u[2]));
      vx = neg_mul_add(v, hn::Set(d, exact.depth[1]), hn::Set(d, exact.v[1]));
      vy = neg_mul_add(v, hn::Set(d, exact.depth[2]), hn::Set(d, exact.v[2]));
    }
  };

  struct Filtering {
    float lowpass2;
    V depth_epsilon;
  };

  /// The kernel where every pixel's ray meets the tangent plane: exact_kernel.h. It is a function
  /// apart from the affine kernel's code, as few splats come here.
  /// \param clip       the lines that cut it; null: they are not asked for.
  /// \param arguments  gets their arguments of Phi: as clip_share() has them, with the projection
  ///     linearised anew in every pixel.
  static HWY_NOINLINE Sample exact(const ExactSplat& exact, const Filtering& filtering, V dx, V dy,
                                   const SplatClip* clip, V* arguments) {
    const D d;
    const V h2 = hn::Set(d, filtering.lowpass2);
    const V one = hn::Set(d, 1.0F);
    const auto [plane, z, u, v, ux, uy, vx, vy] = PlanePoint(exact, dx, dy);
    // |I + h^2 J^-1 J^-T| and beta of (8), both as sums of positive terms.
    const V filter = hn::Mul(h2, hn::Mul(z, z));
    const V cross = hn::Mul(filter, mul_sub(ux, vy, hn::Mul(uy, vx)));
    const V det = mul_add(cross, cross, mul_add(filter, hn::Add(sum2(ux, uy), sum2(vx, vy)), one));
    const V skew_x = mul_sub(u, vx, hn::Mul(v, ux));
    const V skew_y = mul_sub(u, vy, hn::Mul(v, uy));
    const V inv_det = hn::Div(one, det);
    const V beta = hn::Mul(hn::Mul(hn::Set(d, 0.5F), inv_det),
                           mul_add(filter, sum2(skew_x, skew_y), sum2(u, v)));
    const M met = hn::And(hn::Gt(plane, hn::Zero(d)), hn::Lt(plane, hn::Set(d, exact.depth_most)));
    Sample s;
    s.beta = hn::IfThenElse(met, beta, hn::Set(d, __builtin_inff()));
    s.depth = hn::Min(hn::Max(plane, hn::Set(d, exact.depth_lo)), hn::Set(d, exact.depth_hi));
    s.epsilon = hn::Mul(hn::Mul(filtering.depth_epsilon, s.depth),
                        hn::Sqrt(mul_add(hn::Set(d, exact.deviation2), hn::Mul(s.depth, s.depth),
                                         hn::Set(d, exact.pixel2))));
    s.amplitude = hn::Mul(hn::Set(d, exact.amplitude), hn::Sqrt(inv_det));
    if (!clip) return s;
    const auto argument = [&, u = u, v = v, ux = ux, uy = uy, vx = vx,
                           vy = vy](const float* line) HWY_ATTR SURFEL_INLINE_LAMBDA {
      const V distance = hn::Set(d, line[0]);
      const V w_u = hn::Set(d, line[1]);
      const V w_v = hn::Set(d, line[2]);
      // w . M^-1 u and s^2 = w . (I - M^-1) w, both times |M|; s^2 is a sum of positive
      // terms.
      const V bend_x = mul_sub(w_u, vx, hn::Mul(w_v, ux));
      const V bend_y = mul_sub(w_u, vy, hn::Mul(w_v, uy));
      const V bend = mul_add(bend_x, skew_x, hn::Mul(bend_y, skew_y));
      const V mean = mul_add(filter, bend, mul_add(w_u, u, hn::Mul(w_v, v)));
      const V c_x = mul_add(w_u, ux, hn::Mul(w_v, vx));
      const V c_y = mul_add(w_u, uy, hn::Mul(w_v, vy));
      const V w2 = sum2(w_u, w_v);
      const V s2 = mul_add(filter, sum2(c_x, c_y), hn::Mul(hn::Mul(cross, cross), w2));
      // As in clip_share(): a part of the kernel is blurred without a filter, too.
      const V least = hn::Mul(hn::Set(d, 1e-8F), hn::Mul(w2, det));
      const V deviation = hn::Sqrt(hn::Mul(hn::Max(s2, least), det));
      return hn::Div(mul_sub(distance, det, mean), hn::Max(deviation, hn::Set(d, 1e-30F)));
    };
    arguments[0] = argument(clip->line[0]);
    arguments[1] = has_two_lines(*clip) ? argument(clip->line[1]) : hn::Set(d, kWholeClip);
    return s;
  }

  const Splat* splats_;
  const ExactSplat* exact_;
  const SplatClip* clips_;
  float depth_epsilon_[kMostEven + 1];  ///< FragmentRules::depth_epsilon by a splat's kEvenBits.
  float lowpass2_;
  float block_x_, block_y_;  ///< First pixel of the tile's block in the picture.
  float exp_minus_[6];       ///< kExpMinus for beta / 2^n.
  int squarings_ = 0;        ///< n.
};

/// A vector of pixels, and the splats whose boxes it meets.
struct PixelSplats {
  std::size_t pixel;  ///< The first pixel of the vector.
  V x, y;             ///< Centres of the pixels in the picture.
  const std::uint32_t* begin;
  const std::uint32_t* end;
  float reach;  ///< No splat, nor anything within its epsilon, is nearer than this depth.
};

/// Binary logarithms: floats of a Splat, pixels along a patch.
inline constexpr int kSplatShift = 4;
inline constexpr int kPatchShift = 2;
static_assert(sizeof(Splat) == sizeof(float) << kSplatShift && kStripWidth == 1 << kPatchShift);

/// Number of the fragments of a few hundred splats in a vector of pixels: it stays in a register.
class FragmentCounter {
 public:
  HWY_INLINE FragmentCounter() : count_(hn::Zero(D())) {}
  HWY_INLINE void add(M inside) {
    count_ = hn::Add(count_, hn::IfThenElseZero(inside, hn::Set(D(), 1.0F)));
  }
  HWY_INLINE std::uint64_t total() const {
    return static_cast<std::uint64_t>(sum_of_halves(D(), count_));
  }

 private:
  V count_;
};

/// Finds the pixels of one tile that its splats meet.
class KernelRaster {
 public:
  KernelRaster(const TileJob& job, int x0, int y0)
      : job_(job),
        sampler_(job, x0, y0),
        x0_(static_cast<float>(x0) + 0.5F),
        y0_(static_cast<float>(y0) + 0.5F) {}

  const SplatSampler& sampler() const { return sampler_; }

  /// Calls visit(PixelSplats) for vectors of pixels and the splats in [begin, end) of the order
  /// whose boxes they meet, in the order's sequence for every pixel. Left out are splats that lie,
  /// with all depths within epsilon of them, behind all of the vector's depths in the plane
  /// `hidden`.
  ///
  /// Pixels are visited vector by vector: they stay in the first-level cache, and branches go the
  /// way that they went for the splat before.
  template <class Visit>
  HWY_INLINE void for_each_vector(std::size_t begin, std::size_t end, const float* hidden,
                                  const Visit& visit) const {
    const D d;
    HWY_ALIGN Lists lists;
    hide(hidden, lists);
    for (; begin < end; begin += kListed) {
      list(begin, std::min(begin + kListed, end), lists);
      for (int pixel = 0; pixel < kTilePixels; pixel += static_cast<int>(hn::MaxLanes(d))) {
        const int patch = pixel / kPatchPixels;
        if (lists.count[patch] == 0) continue;
        const auto x = static_cast<float>(tile_pixel_x(pixel));
        const auto y = static_cast<float>(tile_pixel_y(pixel));
        visit(PixelSplats{static_cast<std::size_t>(pixel),
                          hn::Add(hn::Load(d, kColumnOfLane), hn::Set(d, x0_ + x)),
                          hn::Add(hn::Load(d, kRowOfLane), hn::Set(d, y0_ + y)),
                          lists.splats[patch], lists.splats[patch] + lists.count[patch],
                          lists.reach});
      }
    }
  }

  /// Adds to FrameStatistics::fragments.
  HWY_INLINE void count(const FragmentCounter& fragments) const {
    *job_.fragments += fragments.total();
  }

 private:
  static constexpr int kPatches = kTilePixels / kPatchPixels;
  /// Splats that are listed at once: as many as the first-level cache holds.
  static constexpr std::size_t kListed = 256;
  /// The rounding error of a depth, as a part of the terms that it is summed from.
  static constexpr float kRounding = 1e-6F;

  /// For every patch of the tile, the splats whose boxes it meets, in order.
  struct Lists {
    std::uint32_t splats[kPatches][kListed + kTileSize];  ///< A vector past the end is written.
    std::size_t count[kPatches];
    float hidden[kPatches];  ///< The least depth that hides.
    float least;             ///< Least value of `hidden`.
    float reach;             ///< PixelSplats::reach.
  };

  static void hide(const float* hidden, Lists& lists) {
    const D d;
    lists.least = __builtin_inff();
    std::fill_n(lists.hidden, kPatches, lists.least);
    for (std::size_t pixel = 0; pixel < kTilePixels; pixel += hn::MaxLanes(d)) {
      float& patch = lists.hidden[pixel / kPatchPixels];
      patch = std::min(patch, hn::GetLane(hn::MinOfLanes(d, hn::Load(d, hidden + pixel))));
      lists.least = std::min(lists.least, patch);
    }
  }

  /// A tile's splats are strewn over the block.
  HWY_INLINE void prefetch(std::size_t begin) const {
    const std::size_t end = std::min(begin + hn::MaxLanes(D()), job_.count);
    for (; begin < end; ++begin) {
      const std::uint32_t index = job_.order[begin];
      hwy::Prefetch(job_.splats + index);
      if (job_.normals) hwy::Prefetch(job_.normals + index);
      if (job_.clips) hwy::Prefetch(job_.clips + index);
    }
  }

  /// Lists the splats [begin, end) of the order, a vector of them at a time: which patches they
  /// meet are the bits of a number.
  void list(std::size_t begin, std::size_t end, Lists& lists) const {
    // Splats of the widest vector: the next vector of splats is fetched while one is worked on.
    constexpr std::size_t kPrefetchAhead = 16;
    const D d;
    const hn::RebindToSigned<D> di;
    const hn::RebindToUnsigned<D> du;
    using Unsigned = hn::Vec<decltype(du)>;
    const auto* fields = reinterpret_cast<const float*>(job_.splats);
    const auto* boxes = reinterpret_cast<const std::int32_t*>(job_.splats);
    const V share = hn::Set(d, 1 + job_.rules->depth_epsilon);
    V nearest = hn::Set(d, -__builtin_inff());
    std::fill_n(lists.count, kPatches, std::size_t{0});
    for (; begin < end; begin += hn::MaxLanes(d)) {
      prefetch(begin + kPrefetchAhead);
      const auto exists = hn::FirstN(du, end - begin);
      const Unsigned index = hn::IfThenElseZero(exists, hn::LoadU(du, job_.order + begin));
      const auto place = hn::BitCast(di, hn::ShiftLeft<kSplatShift>(index));
      const auto field = [&](std::size_t offset) HWY_ATTR {
        return hn::GatherIndex(d, fields + offset / sizeof(float), place);
      };
      const V depth = field(offsetof(Splat, depth));
      const V range = hn::Mul(share, field(offsetof(Splat, depth_range)));
      const V reach = hn::Add(range, depth);
      const auto box =
          hn::BitCast(du, hn::GatherIndex(di, boxes + offsetof(Splat, box) / sizeof(float), place));
      const auto patch_of = [&](Unsigned pixel, int origin) HWY_ATTR {
        const auto in_tile =
            hn::Sub(hn::BitCast(di, hn::And(pixel, hn::Set(du, 255))), hn::Set(di, origin));
        return hn::ShiftRight<kPatchShift>(
            hn::BitCast(du, hn::Min(hn::Max(in_tile, hn::Zero(di)), hn::Set(di, kTileSize - 1))));
      };
      const Unsigned left = patch_of(box, job_.box_x);
      const Unsigned top = patch_of(hn::ShiftRight<8>(box), job_.box_y);
      const Unsigned right = patch_of(hn::ShiftRight<16>(box), job_.box_x);
      const Unsigned bottom = patch_of(hn::ShiftRight<24>(box), job_.box_y);
      const auto bits = [&](Unsigned from, Unsigned to, std::uint32_t step) HWY_ATTR {
        return hn::Sub(hn::Shl(hn::Set(du, 1U << step), to), hn::Shl(hn::Set(du, 1), from));
      };
      static_assert(kPatches == 16 && kTileSize / kStripWidth == 4);
      const Unsigned rows = bits(top, bottom, 1);
      const Unsigned columns =
          hn::And(bits(hn::ShiftLeft<2>(left), hn::ShiftLeft<2>(right), 4), hn::Set(du, 0x1111));
      const auto seen = hn::And(exists, hn::RebindMask(du, hn::Ge(reach, hn::Set(d, lists.least))));
      const Unsigned patches = hn::IfThenElseZero(seen, hn::Mul(rows, columns));
      if (hn::AllFalse(du, seen)) continue;
      const V margin = hn::Mul(hn::Set(d, kRounding), hn::Add(range, hn::Abs(depth)));
      nearest = hn::Max(nearest, hn::Add(reach, margin));
      for (int p = 0; p < kPatches; ++p) {
        const auto meets = hn::And(hn::TestBit(patches, hn::Set(du, 1U << p)),
                                   hn::RebindMask(du, hn::Ge(reach, hn::Set(d, lists.hidden[p]))));
        const Compressor<decltype(du)> listed(meets);
        listed.store(index, du, lists.splats[p] + lists.count[p]);
        lists.count[p] += listed.count();
      }
    }
    lists.reach = hn::GetLane(hn::MaxOfLanes(d, nearest));
  }

  const TileJob& job_;
  SplatSampler sampler_;
  float x0_, y0_;  ///< Centre of the tile's first pixel in the picture.
};

/// A vector of unmerged fragments without their tags: see FragmentChannel.
/// \tparam kClips  With the channels of what half-planes cut off.
template <bool kNormals, bool kOpaqueSplats, bool kClips = false>
struct FragmentSums {
  V weight, depth, red, green, blue, alpha, normal_x, normal_y, normal_z;
  V cut_away, cut_partial, cut_x, cut_y;

  /// `fragment` is the first one's weight.
  HWY_INLINE explicit FragmentSums(const float* fragment) {
    for_each_channel([&](int channel, V& sum) HWY_ATTR SURFEL_INLINE_LAMBDA {
      sum = hn::Load(D(), fragment + channel * kPatchPixels);
    });
  }
  HWY_INLINE void store(float* fragment) {
    for_each_channel([&](int channel, const V& sum) HWY_ATTR SURFEL_INLINE_LAMBDA {
      hn::Store(sum, D(), fragment + channel * kPatchPixels);
    });
  }

  /// Adds a contribution; rho is zero where a pixel does not take part.
  HWY_INLINE void add(const Splat& splat, const SplatNormal* normal, V rho, V at_depth) {
    const auto add_to = [&](V& sum, float value) HWY_ATTR SURFEL_INLINE_LAMBDA {
      sum = mul_add(rho, hn::Set(D(), value), sum);
    };
    weight = hn::Add(weight, rho);
    depth = mul_add(rho, at_depth, depth);
    add_to(red, splat.red);
    add_to(green, splat.green);
    add_to(blue, splat.blue);
    if constexpr (!kOpaqueSplats) add_to(alpha, splat.alpha);
    if constexpr (kNormals) {
      add_to(normal_x, normal->x);
      add_to(normal_y, normal->y);
      add_to(normal_z, normal->z);
    }
  }
  /// Adds another fragment of the surface in some pixels.
  template <class Other>
  HWY_INLINE void add(const Other& other, M added) {
    const auto add_to = [&](V& sum, V value) HWY_ATTR SURFEL_INLINE_LAMBDA {
      sum = hn::Add(sum, hn::IfThenElseZero(added, value));
    };
    add_to(weight, other.weight);
    add_to(depth, other.depth);
    add_to(red, other.red);
    add_to(green, other.green);
    add_to(blue, other.blue);
    if constexpr (!kOpaqueSplats) add_to(alpha, other.alpha);
    if constexpr (kNormals) {
      add_to(normal_x, other.normal_x);
      add_to(normal_y, other.normal_y);
      add_to(normal_z, other.normal_z);
    }
  }
  /// Adds what has been cut off from a contribution, in the pixels that take part.
  HWY_INLINE void add_cut(const SplatClip& clip, const CutContribution& by, M added) {
    cut_away = hn::Add(cut_away, hn::IfThenElseZero(added, by.away));
    const auto add_line = [&](int j) HWY_ATTR SURFEL_INLINE_LAMBDA {
      const V partial = hn::IfThenElseZero(added, by.partial[j]);
      cut_partial = hn::Add(cut_partial, partial);
      cut_x = mul_add(partial, hn::Set(D(), clip.outward[j][0]), cut_x);
      cut_y = mul_add(partial, hn::Set(D(), clip.outward[j][1]), cut_y);
    };
    add_line(0);
    if (HWY_UNLIKELY(has_two_lines(clip))) add_line(1);
  }

 private:
  template <class Body>
  HWY_INLINE void for_each_channel(const Body& body) {
    body(kWeight, weight);
    body(kDepth, depth);
    body(kRed, red);
    body(kGreen, green);
    body(kBlue, blue);
    if constexpr (!kOpaqueSplats) body(kAlpha, alpha);
    if constexpr (kNormals) {
      body(kNormalX, normal_x);
      body(kNormalY, normal_y);
      body(kNormalZ, normal_z);
    }
    if constexpr (kClips) {
      body(kCutAway, cut_away);
      body(kCutPartial, cut_partial);
      body(kCutX, cut_x);
      body(kCutY, cut_y);
    }
  }
};

/// Empties a vector of fragments none of which has a weight, as nothing else of them is set then.
HWY_INLINE float* emptied_if_unused(float* fragment, int channels) {
  if (HWY_UNLIKELY(hn::AllTrue(D(), hn::Eq(hn::Load(D(), fragment), hn::Zero(D()))))) {
    for (int c = 1; c < channels; ++c) hn::Store(hn::Zero(D()), D(), fragment + c * kPatchPixels);
  }
  return fragment;
}

/// Fragments through which nothing is seen. Merged fragments have a negative weight and never
/// pass.
template <bool kOpaqueSplats>
HWY_INLINE M covers(V weight, V alpha, V full_weight) {
  const M full = hn::Ge(weight, full_weight);
  if constexpr (kOpaqueSplats) return full;
  return hn::And(full, hn::Ge(alpha, hn::Mul(weight, hn::Set(D(), kOpaqueAlpha))));
}

/// Fragments of which lines take nothing that is seen.
HWY_INLINE M is_whole(V weight, V cut_away) {
  return hn::Le(cut_away, hn::Mul(weight, hn::Set(D(), kWholeCutAway)));
}

/// A layer's fragments in a vector of pixels: the unmerged fragments' sums, and the tags.
template <bool kNormals, bool kOpaqueSplats, bool kClips = false>
class FragmentLayer {
 public:
  /// \param channels  ABufferLayout::channels().
  /// \param cover     TileABuffer::edge_weight.
  FragmentLayer(float* fragment, int channels, V cover)
      : fragment_(emptied_if_unused(fragment, channels)),
        sums_(fragment),
        cover_(cover),
        tag_(hn::BitCast(Tags(), hn::Load(D(), fragment + kTag * kPatchPixels))) {
    if constexpr (kOpaqueSplats) slope_ = hn::Load(D(), fragment + kSlope * kPatchPixels);
  }

  /// Accumulate or separate, SS01 section 6: adds a contribution where it belongs to the layer's
  /// surface or the layer is free. Returns its rho where it is another's, and 0 where it has been
  /// added, or shows a back that the layer hides.
  HWY_INLINE V take(V rho, V depth, V epsilon, const Splat& splat, const SplatNormal* normal) {
    return take(rho, depth, epsilon, splat.tag, [&](M joins, M free) HWY_ATTR SURFEL_INLINE_LAMBDA {
      if constexpr (kOpaqueSplats) {
        const auto slope = hn::BitCast(D(), hn::Set(Tags(), DepthSlope::pack(splat)));
        slope_ = hn::IfThenElse(free, slope, slope_);
      }
      sums_.add(splat, normal, hn::IfThenElseZero(joins, rho), depth);
    });
  }
  /// As above, with the contributions of a sheet.
  HWY_INLINE V take(V rho, V depth, V epsilon, std::uint32_t tag,
                    const FragmentSums<kNormals, kOpaqueSplats>& sheet) {
    return take(rho, depth, epsilon, tag, [&](M joins, M /*free*/) HWY_ATTR SURFEL_INLINE_LAMBDA {
      sums_.add(sheet, hn::And(joins, hn::Gt(rho, hn::Zero(D()))));
    });
  }
  /// Whether the last contribution has been added anywhere.
  HWY_INLINE bool joined() const { return !hn::AllFalse(D(), joined_); }
  /// Adds what has been cut off from the last contribution.
  HWY_INLINE void add_cut(const SplatClip& clip, const CutContribution& cut) {
    sums_.add_cut(clip, cut, joined_);
  }

  HWY_INLINE void store() {
    sums_.store(fragment_);
    hn::Store(hn::BitCast(D(), tag_), D(), fragment_ + kTag * kPatchPixels);
    if constexpr (kOpaqueSplats) hn::Store(slope_, D(), fragment_ + kSlope * kPatchPixels);
  }

 private:
  template <class Add>
  HWY_INLINE V take(V rho, V depth, V epsilon, std::uint32_t tag, const Add& add) {
    const D d;
    const auto splat_tag = hn::Set(Tags(), tag);
    // depth - fragment's depth, times the fragment's weight, to save the division. Merged
    // fragments have a negative weight, and no contribution is near them.
    const V behind = mul_sub(depth, sums_.weight, sums_.depth);
    const M near = hn::Lt(hn::Abs(behind), hn::Mul(epsilon, sums_.weight));
    const M same_side = hn::RebindMask(
        d, hn::Eq(hn::And(hn::Xor(tag_, splat_tag), hn::Set(Tags(), kFrontTag)), hn::Zero(Tags())));
    const M free = hn::Eq(sums_.weight, hn::Zero(d));
    const M joins = hn::Or(free, hn::And(near, same_side));
    tag_ = hn::IfThenElse(hn::RebindMask(Tags(), free), splat_tag, tag_);
    joined_ = hn::And(joins, hn::Gt(rho, hn::Zero(d)));
    add(joins, free);
    if (!kOpaqueSplats || (tag & kFrontTag) != 0) return hn::IfThenZeroElse(joins, rho);
    const M front = hn::RebindMask(d, hn::TestBit(tag_, hn::Set(Tags(), kFrontTag)));
    M hides = hn::And(front, hn::Ge(sums_.weight, cover_));
    if constexpr (kClips) hides = hn::And(hides, is_whole(sums_.weight, sums_.cut_away));
    const M hidden = hn::And(hides, hn::Lt(behind, hn::Zero(d)));
    return hn::IfThenZeroElse(hn::Or(joins, hidden), rho);
  }

  float* fragment_;
  FragmentSums<kNormals, kOpaqueSplats, kClips> sums_;
  V cover_;
  hn::Vec<Tags> tag_;
  V slope_;
  M joined_;  ///< Pixels in which the last contribution has been added.
};

HWY_INLINE bool is_zero(V v) { return hn::AllTrue(D(), hn::Eq(v, hn::Zero(D()))); }

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#endif
