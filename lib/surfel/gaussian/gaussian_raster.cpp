// Kerbl et al., "3D Gaussian Splatting", SIGGRAPH 2023: equation (3), blending front to back.
// Radl et al., "StopThePop", SIGGRAPH 2024: the order by pixel.

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include <surfel/gaussian/gaussian_raster.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/gaussian/gaussian_raster.cpp"
#include <hwy/cache_control.h>
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <surfel/base/compress-inl.h>
#include <surfel/base/fused-inl.h>
#include <surfel/base/power-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<float, kGaussianTile>;
using V = hn::Vec<D>;
using M = hn::Mask<D>;
using Ints = hn::RebindToSigned<D>;
using Unsigned = hn::RebindToUnsigned<D>;

/// Side of a patch, patches along a tile, patches of a tile, pixels of a patch.
constexpr int kPatch = 4;
constexpr int kPatchesAcross = kGaussianTile / kPatch;
constexpr std::size_t kPatches = std::size_t{kPatchesAcross} * kPatchesAcross;
constexpr std::size_t kPatchPixels = std::size_t{kPatch} * kPatch;
/// Splats that are listed at a time; their records stay in the first-level cache.
constexpr std::size_t kChunk = 256;
/// What a list has more room for than splats: a whole vector is stored at its end.
constexpr std::size_t kSpare = 16;

HWY_ALIGN constexpr float kColumnOfLane[] = {0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3};
HWY_ALIGN constexpr float kRowOfLane[] = {0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3};

/// Pixels whose transmittance would fall below this are complete.
constexpr float kLeastTransmittance = 1e-4F;
/// Against the rounding of exponents where patches are chosen.
constexpr float kSlack = 1e-3F;
constexpr float kLog2e = 1.44269504088896F;

HWY_INLINE V set(float value) { return hn::Set(D(), value); }

/// 2^x for x above -126, within 3e-7 of it, relatively; anything below.
HWY_INLINE V exp2_of(V x) {
  const D d;
  const Ints di;
  // Adding 1.5 2^23 rounds to a whole number, which is then in the lowest bits.
  const V magic = set(12582912.0F);
  const V shifted = hn::Add(x, magic);
  const V f = hn::Sub(x, hn::Sub(shifted, magic));
  // Interpolates 2^f at Chebyshev's nodes in [-1/2, 1/2].
  V value = set(1.33908634e-3F);
  for (const float c : {9.67603192e-3F, 5.55035711e-2F, 0.240221075F, 0.693147188F, 1.0F}) {
    value = mul_add(value, f, set(c));
  }
  const auto whole = hn::ShiftLeft<23>(hn::BitCast(di, shifted));
  return hn::BitCast(d, hn::Add(hn::BitCast(di, value), whole));
}

/// Exponents of splats at pixels.
struct Exponent {
  V log_alpha;  ///< Base 2.
  V depth;
  M covered;  ///< Where it counts.
};

/// Evaluates splats with affine kernels, or discs in perspective.
template <bool kDiscs>
class Sampler {
 public:
  explicit Sampler(const GaussianTileJob& job)
      : splats_(job.splats), perspective_(job.perspective), near_(job.view->near) {}

  HWY_INLINE const GaussianSplat& splat(std::uint32_t index) const { return splats_[index]; }

  HWY_INLINE Exponent at(std::uint32_t index, V x, V y) const {
    const GaussianSplat& s = splats_[index];
    const V dx = hn::Sub(x, set(s.x));
    const V dy = hn::Sub(y, set(s.y));
    const V across = mul_add(set(s.xx), dx, hn::Mul(set(s.xy), dy));
    const V form = mul_add(across, dx, hn::Mul(hn::Mul(set(s.yy), dy), dy));
    Exponent out;
    if constexpr (!kDiscs) {
      out.log_alpha = hn::Sub(set(s.log_opacity), form);
      out.depth = set(s.z);
      out.covered = hn::Ge(out.log_alpha, set(kLeastLogAlpha));
      return out;
    }
    const GaussianPerspective& p = perspective_[index];
    const V linear = mul_add(set(p.dx), dx, hn::Mul(set(p.dy), dy));
    const V square = mul_add(mul_add(set(p.dxx), dx, hn::Mul(set(p.dxy), dy)), dx,
                             hn::Mul(hn::Mul(set(p.dyy), dy), dy));
    const V den = hn::Add(hn::Add(set(p.d), linear), square);
    const V inv = hn::Div(set(1), den);
    // Not below zero, where the plane is seen nearly from its edge and rounding decides.
    const V disc = hn::Max(hn::Mul(form, inv), hn::Zero(D()));
    // The filter's exponent d^2, base 2.
    const V low_x = hn::Sub(dx, set(s.low_x));
    const V low_y = hn::Sub(dy, set(s.low_y));
    const V low = hn::Mul(set(kLog2e), mul_add(low_x, low_x, hn::Mul(low_y, low_y)));
    const M by_disc = hn::Lt(disc, low);
    out.log_alpha = hn::Sub(set(s.log_opacity), hn::IfThenElse(by_disc, disc, low));
    out.depth = hn::Mul(set(s.z), hn::Mul(mul_add(set(0.5F), linear, set(p.d)), inv));
    // Where the plane is seen from its edge there is no depth.
    out.covered = hn::And(hn::Ge(out.log_alpha, set(kLeastLogAlpha)),
                          hn::And(hn::Gt(den, hn::Zero(D())), hn::Ge(out.depth, set(near_))));
    return out;
  }

 private:
  const GaussianSplat* splats_;
  const GaussianPerspective* perspective_;
  float near_;
};

/// Evaluates kernels along rays.
class RaySampler {
 public:
  RaySampler(const GaussianTileJob& job, V x, V y)
      : splats_(job.splats),
        perspective_(job.perspective),
        near_(job.view->near),
        density_(job.view->rule == AmplitudeRule::kDensity),
        x_(x),
        y_(y) {
    const GaussianView& view = *job.view;
    const V slope_x = hn::Mul(hn::Sub(x, set(view.center_x)), set(1 / view.focal_x));
    const V slope_y = hn::Mul(hn::Sub(y, set(view.center_y)), set(1 / view.focal_y));
    ray_length_ = hn::Sqrt(mul_add(slope_x, slope_x, mul_add(slope_y, slope_y, set(1))));
  }

  /// Alpha at the pixels, 0 where there is none, and the depth of the largest contribution.
  HWY_INLINE void at(std::uint32_t index, V& alpha, V& depth) const {
    const D d;
    const GaussianSplat& s = splats_[index];
    const GaussianPerspective& p = perspective_[index];
    const V dx = hn::Sub(x_, set(s.x));
    const V dy = hn::Sub(y_, set(s.y));
    const V across = mul_add(set(s.xx), dx, hn::Mul(set(s.xy), dy));
    const V form = mul_add(across, dx, hn::Mul(hn::Mul(set(s.yy), dy), dy));
    const V linear = mul_add(set(p.dx), dx, hn::Mul(set(p.dy), dy));
    const V square = mul_add(mul_add(set(p.dxx), dx, hn::Mul(set(p.dxy), dy)), dx,
                             hn::Mul(hn::Mul(set(p.dyy), dy), dy));
    const V den = hn::Add(hn::Add(set(p.d), linear), square);
    const V inv = hn::Div(set(1), den);
    const V exponent = hn::Max(hn::Mul(form, inv), hn::Zero(d));
    const V t = hn::Mul(set(s.z), hn::Mul(mul_add(set(0.5F), linear, set(p.d)), inv));
    const M covered = hn::And(hn::And(hn::Le(exponent, set(s.cut)), hn::Gt(den, hn::Zero(d))),
                              hn::Gt(t, set(near_)));
    V value = exp2_of(hn::Max(hn::Sub(set(s.log_opacity), exponent), set(-100)));
    if (density_) {
      const V tau = hn::Mul(hn::Mul(value, ray_length_), hn::Sqrt(inv));
      value = hn::Sub(set(1), exp2_of(hn::Max(hn::Mul(set(-kLog2e), tau), set(-100))));
    }
    alpha = hn::IfThenElseZero(covered, value);
    // Pixels without a contribution keep the order that the splat has beside them, as far as it
    // reaches, lest they move through the list of those that wait.
    depth = hn::IfThenElse(hn::Gt(t, set(s.nearest)), t, set(s.nearest));
    const V farthest = set(2 * s.z - s.nearest);
    depth = hn::IfThenElse(hn::Gt(depth, farthest), farthest, depth);
  }

  /// No contribution of a splat is nearer.
  float nearest(std::uint32_t index) const { return splats_[index].nearest; }

  /// Colours of splats, of which each pixel has its own.
  struct Colors {
    V red, green, blue;
  };
  HWY_INLINE Colors colors(hn::Vec<Unsigned> index) const {
    const D d;
    const auto at = hn::BitCast(Ints(), hn::ShiftLeft<4>(index));
    const auto* first = reinterpret_cast<const float*>(splats_);
    const auto field = [&](std::size_t offset) HWY_ATTR {
      return hn::GatherIndex(d, first + offset / sizeof(float), at);
    };
    return {field(offsetof(GaussianSplat, red)), field(offsetof(GaussianSplat, green)),
            field(offsetof(GaussianSplat, blue))};
  }

 private:
  const GaussianSplat* splats_;
  const GaussianPerspective* perspective_;
  float near_;
  bool density_;
  V x_, y_, ray_length_;
};

/// Sums at a vector of pixels.
template <bool kDepth>
struct Sums {
  V red, green, blue, transmittance, depth, median;

  HWY_INLINE Sums(const GaussianTile& tile, std::size_t pixel) {
    const D d;
    red = hn::Load(d, tile.red + pixel);
    green = hn::Load(d, tile.green + pixel);
    blue = hn::Load(d, tile.blue + pixel);
    transmittance = hn::Load(d, tile.transmittance + pixel);
    if constexpr (kDepth) {
      depth = hn::Load(d, tile.depth + pixel);
      median = hn::Load(d, tile.median + pixel);
    }
  }
  HWY_INLINE void store(GaussianTile& tile, std::size_t pixel) const {
    const D d;
    hn::Store(red, d, tile.red + pixel);
    hn::Store(green, d, tile.green + pixel);
    hn::Store(blue, d, tile.blue + pixel);
    hn::Store(transmittance, d, tile.transmittance + pixel);
    if constexpr (kDepth) {
      hn::Store(depth, d, tile.depth + pixel);
      hn::Store(median, d, tile.median + pixel);
    }
  }
  /// Adds a colour and a depth with a weight; `left` is the transmittance after it.
  HWY_INLINE void add(M where, V weight, V left, V r, V g, V b, V z) {
    red = mul_add(weight, r, red);
    green = mul_add(weight, g, green);
    blue = mul_add(weight, b, blue);
    if constexpr (kDepth) {
      depth = mul_add(weight, hn::IfThenElseZero(where, z), depth);
      median = hn::IfThenElse(hn::And(where, hn::Gt(transmittance, set(0.5F))), z, median);
    }
    transmittance = hn::IfThenElse(where, left, transmittance);
  }
};

/// Draws one tile.
class TileRaster {
 public:
  TileRaster(const GaussianTileJob& job, GaussianScratch& scratch, GaussianTile& tile)
      : job_(job),
        scratch_(scratch),
        tile_(tile),
        x0_(static_cast<float>(job.x0)),
        y0_(static_cast<float>(job.y0)) {
    std::fill_n(tile.red, kGaussianTilePixels, 0.0F);
    std::fill_n(tile.green, kGaussianTilePixels, 0.0F);
    std::fill_n(tile.blue, kGaussianTilePixels, 0.0F);
    std::fill_n(tile.transmittance, kGaussianTilePixels, 1.0F);
    if (!job.depth) return;
    std::fill_n(tile.depth, kGaussianTilePixels, 0.0F);
    std::fill_n(tile.median, kGaussianTilePixels, 0.0F);
  }

  /// By the order of the splats.
  template <bool kDiscs, bool kDepth>
  void draw(float most_alpha) {
    room(kChunk);
    bool live[kPatches][kPatchPixels / hn::MaxLanes(D())];
    for (auto& patch : live) std::fill(std::begin(patch), std::end(patch), true);
    const Sampler<kDiscs> sampler(job_);
    HWY_ALIGN float going[kGaussianTilePixels];
    for (std::size_t pixel = 0; pixel < kGaussianTilePixels; pixel += hn::MaxLanes(D())) {
      const M inside = in_picture(column(pixel), row(pixel));
      hn::Store(hn::IfThenElseZero(inside, set(1)), D(), going + pixel);
    }
    for (std::size_t begin = 0; begin < job_.count; begin += kChunk) {
      list<!kDiscs>(begin, std::min(begin + kChunk, job_.count), kChunk);
      bool any = false;
      for (std::size_t pixel = 0; pixel < kGaussianTilePixels; pixel += hn::MaxLanes(D())) {
        const std::size_t patch = pixel / kPatchPixels;
        bool& goes = live[patch][pixel % kPatchPixels / hn::MaxLanes(D())];
        if (goes && count_[patch] > 0) {
          goes = blend<kDiscs, kDepth>(sampler, patch, pixel, most_alpha, going + pixel);
        }
        any = any || goes;
      }
      if (!any) return;
    }
  }

  /// By the order of the contributions of each pixel.
  template <bool kDepth>
  void draw_sorted() {
    room(job_.count);
    list<true, true>(0, job_.count, job_.count);
    for (std::size_t pixel = 0; pixel < kGaussianTilePixels; pixel += hn::MaxLanes(D())) {
      const std::size_t patch = pixel / kPatchPixels;
      if (count_[patch] > 0) blend_sorted<kDepth>(patch, pixel);
    }
  }

 private:
  /// Centres of the vector of pixels that begins with this one of the tile.
  HWY_INLINE V column(std::size_t pixel) const {
    const std::size_t patch = pixel / kPatchPixels;
    const float left = x0_ + static_cast<float>(patch % kPatchesAcross * kPatch) + 0.5F;
    return hn::Add(hn::LoadU(D(), kColumnOfLane + pixel % kPatchPixels), set(left));
  }
  HWY_INLINE V row(std::size_t pixel) const {
    const std::size_t patch = pixel / kPatchPixels;
    const std::size_t patch_row = patch / kPatchesAcross;
    const float top = y0_ + static_cast<float>(patch_row * kPatch) + 0.5F;
    return hn::Add(hn::LoadU(D(), kRowOfLane + pixel % kPatchPixels), set(top));
  }
  HWY_INLINE M in_picture(V x, V y) const {
    return hn::And(hn::Lt(x, set(static_cast<float>(job_.view->width))),
                   hn::Lt(y, set(static_cast<float>(job_.view->height))));
  }

  void room(std::size_t splats) {
    const std::size_t needed = kPatches * (splats + kSpare);
    if (scratch_.listed.size() < needed) scratch_.listed.resize(needed);
  }

  /// Lists the splats [begin, end) of the order by the patches that they meet.
  /// \tparam kEllipses  tests the least exponent within a patch, not only the splat's box.
  /// \tparam kRays      kernels are kExact's.
  template <bool kEllipses, bool kRays = false>
  void list(std::size_t begin, std::size_t end, std::size_t most) {
    const D d;
    const Unsigned du;
    const Ints di;
    const auto* fields = reinterpret_cast<const float*>(job_.splats);
    for (std::size_t p = 0; p < kPatches; ++p) {
      first_[p] = scratch_.listed.data() + p * (most + kSpare);
      count_[p] = 0;
    }
    for (; begin < end; begin += hn::MaxLanes(d)) {
      for (std::size_t i = begin + 2 * hn::MaxLanes(d);
           i < std::min(begin + 3 * hn::MaxLanes(d), end); ++i) {
        hwy::Prefetch(job_.splats + job_.order[i]);
      }
      const auto exists = hn::FirstN(du, end - begin);
      const auto index = hn::IfThenElseZero(exists, hn::LoadU(du, job_.order + begin));
      const auto place = hn::BitCast(di, hn::ShiftLeft<4>(index));
      const auto field = [&](std::size_t offset) HWY_ATTR {
        return hn::GatherIndex(d, fields + offset / sizeof(float), place);
      };
      const auto first = hn::BitCast(du, field(offsetof(GaussianSplat, x0)));
      const auto last = hn::BitCast(du, field(offsetof(GaussianSplat, x1)));
      // Patches along an axis, from pixels within the picture.
      const auto patch_of = [&](hn::Vec<Unsigned> pixel, int origin) HWY_ATTR {
        const auto in_tile = hn::Sub(hn::BitCast(di, pixel), hn::Set(di, origin));
        return hn::ShiftRight<2>(
            hn::Min(hn::Max(in_tile, hn::Set(di, -1)), hn::Set(di, kGaussianTile)));
      };
      const auto low = hn::Set(du, 0xffff);
      const auto left = patch_of(hn::And(first, low), job_.x0);
      const auto top = patch_of(hn::ShiftRight<16>(first), job_.y0);
      const auto right = patch_of(hn::And(last, low), job_.x0);
      const auto bottom = patch_of(hn::ShiftRight<16>(last), job_.y0);
      hn::Mask<Unsigned> columns[kPatchesAcross];
      hn::Mask<Unsigned> rows[kPatchesAcross];
      for (int p = 0; p < kPatchesAcross; ++p) {
        const auto before = hn::Set(di, p - 1);
        const auto after = hn::Set(di, p + 1);
        const auto meets = [&](const hn::Vec<Ints>& from, const hn::Vec<Ints>& to) HWY_ATTR {
          return hn::RebindMask(du, hn::And(hn::Lt(from, after), hn::Gt(to, before)));
        };
        columns[p] = meets(left, right);
        rows[p] = hn::And(exists, meets(top, bottom));
      }
      if constexpr (kEllipses) {
        const Nearest ellipse(field(offsetof(GaussianSplat, x)), field(offsetof(GaussianSplat, y)),
                              field(offsetof(GaussianSplat, xx)),
                              field(offsetof(GaussianSplat, xy)),
                              field(offsetof(GaussianSplat, yy)), x0_ + 0.5F, y0_ + 0.5F);
        V limit =
            hn::Add(field(offsetof(GaussianSplat, log_opacity)), set(kSlack - kLeastLogAlpha));
        if constexpr (kRays) {
          limit = hn::Mul(field(offsetof(GaussianSplat, cut)), ellipse.most_den(job_, index));
        }
        for (int r = 0; r < kPatchesAcross; ++r) {
          for (int c = 0; c < kPatchesAcross; ++c) {
            const auto near = hn::RebindMask(du, hn::Le(ellipse.least(c, r), limit));
            put(r * kPatchesAcross + c, hn::And(near, hn::And(columns[c], rows[r])), index);
          }
        }
      } else {
        for (int r = 0; r < kPatchesAcross; ++r) {
          for (int c = 0; c < kPatchesAcross; ++c) {
            put(r * kPatchesAcross + c, hn::And(columns[c], rows[r]), index);
          }
        }
      }
    }
  }

  HWY_INLINE void put(int patch, hn::Mask<Unsigned> meets, hn::Vec<Unsigned> index) {
    const Unsigned du;
    const Compressor<Unsigned> listed(meets);
    listed.store(index, du, first_[patch] + count_[patch]);
    count_[patch] += listed.count();
  }

  /// The least values of splats' exponents within patches. The least value of a quadratic form in a
  /// rectangle that its centre is not in lies on a side that faces the centre.
  class Nearest {
   public:
    HWY_INLINE Nearest(V x, V y, V xx, V xy, V yy, float left, float top) : xx_(xx), yy_(yy) {
      const V zero = hn::Zero(D());
      const V along_y = hn::Div(hn::Mul(set(-0.5F), xy), yy);
      const V along_x = hn::Div(hn::Mul(set(-0.5F), xy), xx);
      for (int p = 0; p < kPatchesAcross; ++p) {
        const auto at = static_cast<float>(p * kPatch);
        x0_[p] = hn::Sub(set(left + at), x);
        x1_[p] = hn::Add(x0_[p], set(kPatch - 1));
        y0_[p] = hn::Sub(set(top + at), y);
        y1_[p] = hn::Add(y0_[p], set(kPatch - 1));
        const V nearest_x = hn::Min(hn::Max(zero, x0_[p]), x1_[p]);
        const V nearest_y = hn::Min(hn::Max(zero, y0_[p]), y1_[p]);
        form_x_[p] = hn::Mul(xx, hn::Mul(nearest_x, nearest_x));
        form_y_[p] = hn::Mul(yy, hn::Mul(nearest_y, nearest_y));
        mixed_x_[p] = hn::Mul(xy, nearest_x);
        mixed_y_[p] = hn::Mul(xy, nearest_y);
        best_y_[p] = hn::Mul(along_y, nearest_x);
        best_x_[p] = hn::Mul(along_x, nearest_y);
      }
    }
    HWY_INLINE V least(int column, int row) const {
      const V y = hn::Min(hn::Max(best_y_[column], y0_[row]), y1_[row]);
      const V x = hn::Min(hn::Max(best_x_[row], x0_[column]), x1_[column]);
      const V on_column = mul_add(mul_add(yy_, y, mixed_x_[column]), y, form_x_[column]);
      const V on_row = mul_add(mul_add(xx_, x, mixed_y_[row]), x, form_y_[row]);
      return hn::Min(on_column, on_row);
    }

    /// No less than GaussianPerspective's `den` anywhere in the tile.
    HWY_INLINE V most_den(const GaussianTileJob& job, hn::Vec<Unsigned> index) const {
      const D d;
      const auto* fields = reinterpret_cast<const float*>(job.perspective);
      const auto place = hn::BitCast(Ints(), hn::ShiftLeft<3>(index));
      const auto field = [&](std::size_t offset) HWY_ATTR {
        return hn::Abs(hn::GatherIndex(d, fields + offset / sizeof(float), place));
      };
      const V x = hn::Max(hn::Abs(x0_[0]), hn::Abs(x1_[kPatchesAcross - 1]));
      const V y = hn::Max(hn::Abs(y0_[0]), hn::Abs(y1_[kPatchesAcross - 1]));
      const V along_x = mul_add(field(offsetof(GaussianPerspective, dxx)), x,
                                mul_add(field(offsetof(GaussianPerspective, dxy)), y,
                                        field(offsetof(GaussianPerspective, dx))));
      const V along_y = mul_add(field(offsetof(GaussianPerspective, dyy)), y,
                                field(offsetof(GaussianPerspective, dy)));
      const V sum = mul_add(along_x, x, hn::Mul(along_y, y));
      return hn::Mul(hn::Add(sum, field(offsetof(GaussianPerspective, d))), set(1 + kSlack));
    }

   private:
    V xx_, yy_;
    V x0_[kPatchesAcross], x1_[kPatchesAcross], y0_[kPatchesAcross], y1_[kPatchesAcross];
    V form_x_[kPatchesAcross], form_y_[kPatchesAcross];
    V mixed_x_[kPatchesAcross], mixed_y_[kPatchesAcross];
    V best_x_[kPatchesAcross], best_y_[kPatchesAcross];
  };

  /// Blends the listed splats of a patch at a vector of its pixels. Returns whether any pixel may
  /// take more.
  template <bool kDiscs, bool kDepth>
  HWY_INLINE bool blend(const Sampler<kDiscs>& sampler, std::size_t patch, std::size_t pixel,
                        float most_alpha, float* going) {
    const D d;
    const V x = column(pixel);
    const V y = row(pixel);
    const V most = set(most_alpha);
    const V end = set(kLeastTransmittance);
    Sums<kDepth> sums(tile_, pixel);
    M live = hn::Gt(hn::Load(d, going), hn::Zero(d));
    const std::uint32_t* const listed = first_[patch];
    for (std::size_t i = 0; i < count_[patch]; ++i) {
      const Exponent e = sampler.at(listed[i], x, y);
      const V alpha = hn::Min(exp2_of(e.log_alpha), most);
      const V left = neg_mul_add(alpha, sums.transmittance, sums.transmittance);
      const M covered = hn::And(e.covered, live);
      const M added = hn::And(covered, hn::Ge(left, end));
      const V weight = hn::IfThenElseZero(added, hn::Mul(alpha, sums.transmittance));
      const GaussianSplat& s = sampler.splat(listed[i]);
      sums.add(added, weight, left, set(s.red), set(s.green), set(s.blue), e.depth);
      live = hn::AndNot(hn::AndNot(added, covered), live);
      if (hn::AllFalse(d, live)) break;
    }
    sums.store(tile_, pixel);
    hn::Store(hn::IfThenElseZero(live, set(1)), d, going);
    return !hn::AllFalse(d, live);
  }

  /// Contributions to a vector of pixels, nearest first in every pixel: rows of depths, alphas and
  /// numbers of splats.
  class Fragments {
   public:
    explicit Fragments(GaussianScratch& scratch) : rows_(scratch.fragments) {}

    bool empty() const { return head_ == tail_; }

    HWY_INLINE void insert(V depth, V alpha, V index) {
      const D d;
      if ((tail_ + 1) * kRow > rows_.size()) rows_.resize(std::max(64 * kRow, 2 * rows_.size()));
      std::size_t at = tail_++;
      for (; at > head_; --at) {
        const float* before = row(at - 1);
        const V other = hn::Load(d, before);
        const M nearer = hn::Lt(depth, other);
        if (hn::AllFalse(d, nearer)) break;
        const V other_alpha = hn::Load(d, before + kLanes);
        const V other_index = hn::Load(d, before + 2 * kLanes);
        write(at, hn::IfThenElse(nearer, other, depth), hn::IfThenElse(nearer, other_alpha, alpha),
              hn::IfThenElse(nearer, other_index, index));
        depth = hn::IfThenElse(nearer, depth, other);
        alpha = hn::IfThenElse(nearer, alpha, other_alpha);
        index = hn::IfThenElse(nearer, index, other_index);
      }
      write(at, depth, alpha, index);
    }
    /// Hands the nearest rows to take(depth, alpha, index) that are nearer than a bound everywhere.
    template <class Take>
    HWY_INLINE void take_before(float bound, const Take& take) {
      const D d;
      for (; head_ < tail_; ++head_) {
        const float* first = row(head_);
        const V depth = hn::Load(d, first);
        if (!hn::AllTrue(d, hn::Lt(depth, set(bound)))) break;
        take(depth, hn::Load(d, first + kLanes), hn::Load(d, first + 2 * kLanes));
      }
      if (head_ == tail_) head_ = tail_ = 0;
    }

   private:
    static constexpr std::size_t kLanes = hn::MaxLanes(D());
    static constexpr std::size_t kRow = 3 * kLanes;

    float* row(std::size_t number) { return rows_.data() + number * kRow; }
    HWY_INLINE void write(std::size_t number, V depth, V alpha, V index) {
      const D d;
      float* to = row(number);
      hn::Store(depth, d, to);
      hn::Store(alpha, d, to + kLanes);
      hn::Store(index, d, to + 2 * kLanes);
    }

    Array<float>& rows_;
    std::size_t head_ = 0;
    std::size_t tail_ = 0;
  };

  template <bool kDepth>
  void blend_sorted(std::size_t patch, std::size_t pixel) {
    const D d;
    const Unsigned du;
    const V x = column(pixel);
    const V y = row(pixel);
    const RaySampler sampler(job_, x, y);
    Sums<kDepth> sums(tile_, pixel);
    M live = in_picture(x, y);
    Fragments waiting(scratch_);
    const auto take = [&](V depth, V alpha, V index) HWY_ATTR {
      const V left = neg_mul_add(alpha, sums.transmittance, sums.transmittance);
      const M added = hn::And(live, hn::Gt(alpha, hn::Zero(d)));
      const V weight = hn::IfThenElseZero(added, hn::Mul(alpha, sums.transmittance));
      const RaySampler::Colors c = sampler.colors(hn::BitCast(du, index));
      sums.add(added, weight, left, c.red, c.green, c.blue, depth);
      live = hn::And(live, hn::Ge(sums.transmittance, set(kLeastTransmittance)));
    };
    const std::uint32_t* const listed = first_[patch];
    for (std::size_t i = 0; i < count_[patch]; ++i) {
      waiting.take_before(sampler.nearest(listed[i]), take);
      if (hn::AllFalse(d, live)) break;
      V alpha, depth;
      sampler.at(listed[i], alpha, depth);
      if (hn::AllTrue(d, hn::Eq(alpha, hn::Zero(d)))) continue;
      waiting.insert(depth, alpha, hn::BitCast(d, hn::Set(du, listed[i])));
    }
    waiting.take_before(__builtin_inff(), take);
    sums.store(tile_, pixel);
  }

  const GaussianTileJob& job_;
  GaussianScratch& scratch_;
  GaussianTile& tile_;
  float x0_, y0_;  ///< The tile's corner.
  std::uint32_t* first_[kPatches];
  std::size_t count_[kPatches];
};

/// Display's value to linear light (IEC 61966-2-1).
HWY_INLINE V linear(V value) {
  const D d;
  const V low = hn::Mul(value, set(1 / 12.92F));
  const V high =
      power_of_floats(d, hn::Mul(hn::Add(value, set(0.055F)), set(1 / 1.055F)), set(2.4F));
  return hn::IfThenElse(hn::Le(value, set(0.04045F)), low, high);
}

}  // namespace

void draw_gaussian_tile_simd(const GaussianTileJob& job, GaussianScratch& scratch,
                             GaussianTile& tile) {
  TileRaster raster(job, scratch, tile);
  const float most_alpha = job.view->profile == GaussianProfile::kGsplat ? 0.999F : 0.99F;
  if (job.view->profile == GaussianProfile::kExact) {
    job.depth ? raster.draw_sorted<true>() : raster.draw_sorted<false>();
  } else if (job.perspective) {
    job.depth ? raster.draw<true, true>(most_alpha) : raster.draw<true, false>(most_alpha);
  } else {
    job.depth ? raster.draw<false, true>(most_alpha) : raster.draw<false, false>(most_alpha);
  }
}

void write_gaussian_tile_simd(const GaussianTile& tile, int x0, int y0, const GaussianOutput& out) {
  const D d;
  HWY_ALIGN float pixels[4 * hn::MaxLanes(D())];
  for (std::size_t pixel = 0; pixel < kGaussianTilePixels; pixel += hn::MaxLanes(d)) {
    const V left = hn::Load(d, tile.transmittance + pixel);
    const V alpha = hn::Add(hn::Sub(set(1), left), hn::Mul(left, set(out.background[3])));
    V color[3];
    const float* const sums[3] = {tile.red, tile.green, tile.blue};
    for (int c = 0; c < 3; ++c) {
      color[c] = mul_add(left, set(out.background[c]), hn::Load(d, sums[c] + pixel));
      if (out.display) continue;
      const V inv = hn::Div(set(1), hn::Max(alpha, set(1e-12F)));
      color[c] = hn::Mul(linear(hn::Mul(color[c], inv)), alpha);
    }
    hn::StoreInterleaved4(color[0], color[1], color[2], alpha, d, pixels);
    for (std::size_t i = 0; i < hn::MaxLanes(d); ++i) {
      const std::size_t at = pixel + i;
      const std::size_t patch = at / kPatchPixels;
      const int x = x0 + static_cast<int>(patch % kPatchesAcross * kPatch + at % kPatch);
      const int y =
          y0 + static_cast<int>(patch / kPatchesAcross * kPatch + at % kPatchPixels / kPatch);
      if (x >= out.width || y >= out.height) continue;
      float* to = out.pixels + (static_cast<std::size_t>(y) * out.width + x) * out.channels;
      std::copy_n(pixels + 4 * i, 4, to);
      if (out.channels < 6) continue;
      const float covered = 1 - tile.transmittance[at];
      to[4] = tile.transmittance[at] <= 0.5F ? tile.median[at] : __builtin_inff();
      to[5] = covered > 0 ? tile.depth[at] / covered : __builtin_inff();
    }
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {

HWY_EXPORT(draw_gaussian_tile_simd);
HWY_EXPORT(write_gaussian_tile_simd);

void draw_gaussian_tile(const GaussianTileJob& job, GaussianScratch& scratch, GaussianTile& tile) {
  HWY_DYNAMIC_DISPATCH(draw_gaussian_tile_simd)(job, scratch, tile);
}

void write_gaussian_tile(const GaussianTile& tile, int x0, int y0, const GaussianOutput& out) {
  HWY_DYNAMIC_DISPATCH(write_gaussian_tile_simd)(tile, x0, y0, out);
}

}  // namespace surfel
#endif
