// Kerbl et al., "3D Gaussian Splatting", SIGGRAPH 2023: equation (3), blending front to back.

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
#include <surfel/gaussian/gaussian_patch-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {
namespace {

/// Splats that are listed at a time; their records stay in the first-level cache.
constexpr std::size_t kChunk = 256;

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
    const V dx = hn::Sub(x, all_lanes(s.x));
    const V dy = hn::Sub(y, all_lanes(s.y));
    const V across = mul_add(all_lanes(s.xx), dx, hn::Mul(all_lanes(s.xy), dy));
    const V form = mul_add(across, dx, hn::Mul(hn::Mul(all_lanes(s.yy), dy), dy));
    Exponent out;
    if constexpr (!kDiscs) {
      out.log_alpha = hn::Sub(all_lanes(s.log_opacity), form);
      out.depth = all_lanes(s.z);
      out.covered = hn::Ge(out.log_alpha, all_lanes(kLeastLogAlpha));
      return out;
    }
    const GaussianPerspective& p = perspective_[index];
    const V linear = mul_add(all_lanes(p.dx), dx, hn::Mul(all_lanes(p.dy), dy));
    const V square = mul_add(mul_add(all_lanes(p.dxx), dx, hn::Mul(all_lanes(p.dxy), dy)), dx,
                             hn::Mul(hn::Mul(all_lanes(p.dyy), dy), dy));
    const V den = hn::Add(hn::Add(all_lanes(p.d), linear), square);
    const V inv = hn::Div(all_lanes(1), den);
    // Not below zero, where the plane is seen nearly from its edge and rounding decides.
    const V disc = hn::Max(hn::Mul(form, inv), hn::Zero(D()));
    // The filter's exponent d^2, base 2.
    const V low_x = hn::Sub(dx, all_lanes(s.low_x));
    const V low_y = hn::Sub(dy, all_lanes(s.low_y));
    const V low = hn::Mul(all_lanes(kLog2e), mul_add(low_x, low_x, hn::Mul(low_y, low_y)));
    const M by_disc = hn::Lt(disc, low);
    out.log_alpha = hn::Sub(all_lanes(s.log_opacity), hn::IfThenElse(by_disc, disc, low));
    const V toward =
        mul_add(all_lanes(p.tx), dx, mul_add(all_lanes(p.ty), dy, all_lanes(s.z * p.d)));
    out.depth = hn::Mul(toward, inv);
    // Where the plane is seen from its edge there is no depth.
    out.covered = hn::And(hn::Ge(out.log_alpha, all_lanes(kLeastLogAlpha)),
                          hn::And(hn::Gt(den, hn::Zero(D())), hn::Ge(out.depth, all_lanes(near_))));
    return out;
  }

 private:
  const GaussianSplat* splats_;
  const GaussianPerspective* perspective_;
  float near_;
};

/// Draws one tile.
class TileRaster {
 public:
  TileRaster(const GaussianTileJob& job, GaussianScratch& scratch, GaussianTile& tile)
      : job_(job), scratch_(scratch), tile_(tile), pixels_(job) {}

  /// By the order of the splats.
  template <bool kDiscs, bool kDepth>
  void draw(float most_alpha) {
    scratch_.listed.resize(kPatches * (kChunk + kSpare));
    bool live[kPatches][kPatchPixels / hn::MaxLanes(D())];
    for (auto& patch : live) std::fill(std::begin(patch), std::end(patch), true);
    const Sampler<kDiscs> sampler(job_);
    HWY_ALIGN float going[kGaussianTilePixels];
    for (std::size_t pixel = 0; pixel < kGaussianTilePixels; pixel += hn::MaxLanes(D())) {
      const M inside = pixels_.in_picture(pixels_.column(pixel), pixels_.row(pixel));
      hn::Store(hn::IfThenElseZero(inside, all_lanes(1)), D(), going + pixel);
    }
    for (std::size_t begin = 0; begin < job_.count; begin += kChunk) {
      list<!kDiscs>(begin, std::min(begin + kChunk, job_.count));
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

 private:
  /// Lists the splats [begin, end) of the order by the patches that they meet.
  /// \tparam kEllipses  tests the least exponent within a patch, not only the splat's box.
  template <bool kEllipses>
  void list(std::size_t begin, std::size_t end) {
    const D d;
    const Tags du;
    for (std::size_t p = 0; p < kPatches; ++p) {
      first_[p] = scratch_.listed.data() + p * (kChunk + kSpare);
      count_[p] = 0;
    }
    for (; begin < end; begin += hn::MaxLanes(d)) {
      for (std::size_t i = begin + 2 * hn::MaxLanes(d);
           i < std::min(begin + 3 * hn::MaxLanes(d), end); ++i) {
        hwy::Prefetch(job_.splats + job_.order[i]);
      }
      const auto exists = hn::FirstN(du, end - begin);
      const auto index = hn::IfThenElseZero(exists, hn::LoadU(du, job_.order + begin));
      const Fields<GaussianSplat> field(job_.splats, index);
      const PatchBoxes boxes(job_, field, exists);
      if constexpr (kEllipses) {
        const LeastForms forms(field, pixels_.left(), pixels_.top());
        const V limit = hn::Add(field(offsetof(GaussianSplat, log_opacity)),
                                all_lanes(kSlack - kLeastLogAlpha));
        for (int r = 0; r < kPatchesAcross; ++r) {
          for (int c = 0; c < kPatchesAcross; ++c) {
            const auto near = hn::RebindMask(du, hn::Le(forms.least(c, r), limit));
            put(r * kPatchesAcross + c, hn::And(near, boxes.met(c, r)), index);
          }
        }
      } else {
        for (int r = 0; r < kPatchesAcross; ++r) {
          for (int c = 0; c < kPatchesAcross; ++c) {
            put(r * kPatchesAcross + c, boxes.met(c, r), index);
          }
        }
      }
    }
  }

  HWY_INLINE void put(int patch, hn::Mask<Tags> meets, hn::Vec<Tags> index) {
    const Tags du;
    const Compressor<Tags> listed(meets);
    listed.store(index, du, first_[patch] + count_[patch]);
    count_[patch] += listed.count();
  }

  /// Blends the listed splats of a patch at a vector of its pixels. Returns whether any pixel may
  /// take more.
  template <bool kDiscs, bool kDepth>
  HWY_INLINE bool blend(const Sampler<kDiscs>& sampler, std::size_t patch, std::size_t pixel,
                        float most_alpha, float* going) {
    const D d;
    const V x = pixels_.column(pixel);
    const V y = pixels_.row(pixel);
    const V most = all_lanes(most_alpha);
    const V end = all_lanes(kLeastTransmittance);
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
      sums.add(added, weight, left, all_lanes(s.red), all_lanes(s.green), all_lanes(s.blue),
               e.depth);
      live = hn::AndNot(hn::AndNot(added, covered), live);
      if (hn::AllFalse(d, live)) break;
    }
    sums.store(tile_, pixel);
    hn::Store(hn::IfThenElseZero(live, all_lanes(1)), d, going);
    return !hn::AllFalse(d, live);
  }

  const GaussianTileJob& job_;
  GaussianScratch& scratch_;
  GaussianTile& tile_;
  TilePixels pixels_;
  std::uint32_t* first_[kPatches];
  std::size_t count_[kPatches];
};

/// Display's value to linear light (IEC 61966-2-1).
HWY_INLINE V linear(V value) {
  const D d;
  const V low = hn::Mul(value, all_lanes(1 / 12.92F));
  const V high = power_of_floats(
      d, hn::Mul(hn::Add(value, all_lanes(0.055F)), all_lanes(1 / 1.055F)), all_lanes(2.4F));
  return hn::IfThenElse(hn::Le(value, all_lanes(0.04045F)), low, high);
}

}  // namespace

void draw_gaussian_tile_simd(const GaussianTileJob& job, GaussianScratch& scratch,
                             GaussianTile& tile) {
  TileRaster raster(job, scratch, tile);
  const float most_alpha = job.view->profile == GaussianProfile::kGsplat ? 0.999F : 0.99F;
  if (job.perspective) {
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
    const V alpha =
        hn::Add(hn::Sub(all_lanes(1), left), hn::Mul(left, all_lanes(out.background[3])));
    V color[3];
    const float* const sums[3] = {tile.red, tile.green, tile.blue};
    for (int c = 0; c < 3; ++c) {
      color[c] = mul_add(left, all_lanes(out.background[c]), hn::Load(d, sums[c] + pixel));
      if (out.display) continue;
      const V inv = hn::Div(all_lanes(1), hn::Max(alpha, all_lanes(1e-12F)));
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
  for (float* sums : {tile.red, tile.green, tile.blue, tile.depth, tile.median}) {
    std::fill_n(sums, kGaussianTilePixels, 0.0F);
  }
  std::fill_n(tile.transmittance, kGaussianTilePixels, 1.0F);
  if (job.view->profile == GaussianProfile::kExact) {
    draw_gaussian_rays(job, scratch.rays, tile);
    return;
  }
  HWY_DYNAMIC_DISPATCH(draw_gaussian_tile_simd)(job, scratch, tile);
}

void write_gaussian_tile(const GaussianTile& tile, int x0, int y0, const GaussianOutput& out) {
  HWY_DYNAMIC_DISPATCH(write_gaussian_tile_simd)(tile, x0, y0, out);
}

}  // namespace surfel
#endif
