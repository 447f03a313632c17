// Zwicker, Pfister, van Baar, Gross, "Surface Splatting", SIGGRAPH 2001: sections 4 and 6.

#include <algorithm>
#include <bit>
#include <cmath>

#include <surfel/render/tile_raster.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/render/tile_raster.cpp"
#include <hwy/cache_control.h>
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<float, kTileSize>;
using V = hn::Vec<D>;
using M = hn::Mask<D>;

/// exp(-x) for x in [0, 1]: the polynomial of degree 5 that interpolates it at Chebyshev's nodes,
/// whose relative error is below 1.1e-6.
HWY_INLINE V exp_minus(V x) {
  const D d;
  V p = hn::Set(d, -0.00509972763F);
  p = hn::MulAdd(p, x, hn::Set(d, 0.0383389223F));
  p = hn::MulAdd(p, x, hn::Set(d, -0.165012717F));
  p = hn::MulAdd(p, x, hn::Set(d, 0.499620874F));
  p = hn::MulAdd(p, x, hn::Set(d, -0.999967851F));
  return hn::MulAdd(p, x, hn::Set(d, 0.999999554F));
}

/// A splat's values, spread over vectors, and what else the loops over its pixels need: in locals,
/// as the compiler must assume that stores to the A-buffer change any member.
struct Spread {
  V amplitude, k, epsilon, red, green, blue, alpha, depth_lo, depth_hi, tag, normal_x, normal_y,
      normal_z;
  V full, cutoff;
  float* data;
  std::size_t stride;
  int layers, squarings;
};

template <bool kNormals, bool kOpaqueSplats>
class Rasterizer {
 public:
  Rasterizer(const TileJob& job, TileABuffer& tile)
      : job_(job), tile_(tile), full_(hn::Set(D(), tile.full_weight)) {
    // exp(-beta) = exp(-beta / 2^n)^(2^n), with beta / 2^n at most 1.
    while (job.cutoff * scale_ > 1) {
      scale_ /= 2;
      ++squarings_;
    }
  }

  void run() {
    // How often the tile is checked for being covered; a check costs about as much as ten splats.
    constexpr std::size_t kCheckEvery = 128;
    // A tile's splats are strewn over the batch: without this, waiting for them takes half the
    // time.
    constexpr std::size_t kPrefetchAhead = 12;
    float hidden = find_hidden();
    for (std::size_t i = 0; i < job_.count; ++i) {
      if (i % kCheckEvery == kCheckEvery - 1) hidden = find_hidden();
      if (i + kPrefetchAhead < job_.count) prefetch(job_.order[i + kPrefetchAhead]);
      const std::uint32_t index = job_.order[i];
      const Splat& splat = job_.splats[index];
      if (splat.depth + (1 + job_.depth_epsilon) * splat.depth_range < hidden) continue;
      draw(splat, kNormals ? job_.normals + index : nullptr);
    }
  }

 private:
  static float infinity() { return __builtin_inff(); }

  void prefetch(std::uint32_t index) const {
    hwy::Prefetch(job_.splats + index);
    if constexpr (kNormals) hwy::Prefetch(job_.normals + index);
  }

  /// Notes for every pixel the depth of its nearest opaque surface that covers it (minus infinity:
  /// none), behind which nothing is seen. Returns the least of them in the tile.
  float find_hidden() {
    const D d;
    V least = hn::Set(d, infinity());
    for (int y = 0; y < tile_.height; ++y) {
      for (int x = 0; x < tile_.width; x += static_cast<int>(hn::Lanes(d))) {
        const std::size_t pixel =
            static_cast<std::size_t>(y) * kTileSize + static_cast<std::size_t>(x);
        V hidden = hn::Set(d, -infinity());
        for (int layer = 0; layer < tile_.layout.layers; ++layer) {
          const float* fragment = tile_.data + tile_.layout.layer_stride() * layer + pixel;
          const V weight = hn::Load(d, fragment + kWeight * kTilePixels);
          const M hides = covers(fragment, weight, full_);
          const V depth = hn::Div(hn::Load(d, fragment + kDepth * kTilePixels), weight);
          hidden = hn::IfThenElse(hides, hn::Max(hidden, depth), hidden);
        }
        hn::Store(hidden, d, hidden_ + pixel);
        // Pixels outside of the picture do not count.
        const M inside = hn::FirstN(d, static_cast<std::size_t>(tile_.width - x));
        least = hn::IfThenElse(inside, hn::Min(least, hidden), least);
      }
    }
    return hn::GetLane(hn::MinOfLanes(d, least));
  }

  /// Fragments that nothing behind is seen through.
  static M covers(const float* fragment, V weight, V full_weight) {
    const D d;
    // Merged fragments have a negative weight and never pass.
    M full = hn::Ge(weight, full_weight);
    if constexpr (!kOpaqueSplats) {
      const V alpha = hn::Load(d, fragment + kAlpha * kTilePixels);
      full = hn::And(full, hn::Ge(alpha, hn::Mul(weight, hn::Set(d, 0.9995F))));
    }
    return full;
  }

  void draw(const Splat& splat, const SplatNormal* normal) {
    const D d;
    const float cx = splat.x - static_cast<float>(tile_.x0) - 0.5F;  // of pixel centres
    const float cy = splat.y - static_cast<float>(tile_.y0) - 0.5F;
    // First and last row whose centre lies within; the bounds are tested before they are converted.
    const float first_row = std::ceil(std::max(0.0F, cy - splat.half_y));
    const float last_row =
        std::floor(std::min(static_cast<float>(tile_.height - 1), cy + splat.half_y));
    if (!(first_row <= last_row)) return;

    Spread s;
    s.amplitude = hn::Set(d, splat.amplitude);
    s.k = hn::Set(d, splat.k * scale_);
    s.epsilon = hn::Set(d, splat.depth_range * job_.depth_epsilon);
    s.red = hn::Set(d, splat.red);
    s.green = hn::Set(d, splat.green);
    s.blue = hn::Set(d, splat.blue);
    s.alpha = hn::Set(d, splat.alpha);
    s.depth_lo = hn::Set(d, splat.depth - splat.depth_range);
    s.depth_hi = hn::Set(d, splat.depth + splat.depth_range);
    s.tag = hn::Set(d, std::bit_cast<float>(splat.tag));
    if constexpr (kNormals) {
      s.normal_x = hn::Set(d, normal->x);
      s.normal_y = hn::Set(d, normal->y);
      s.normal_z = hn::Set(d, normal->z);
    }
    s.full = full_;
    s.cutoff = hn::Set(d, job_.cutoff * scale_);
    s.data = tile_.data;
    s.stride = tile_.layout.layer_stride();
    s.layers = tile_.layout.layers;
    s.squarings = squarings_;
    const V m = hn::Set(d, splat.m);
    const V depth_dy = hn::Set(d, splat.depth_dy);
    const float q = splat.q * scale_;
    for (int x = 0; x < tile_.width; x += static_cast<int>(hn::Lanes(d))) {
      // At the first row; advanced from row to row (at most 15 additions).
      const float dy0 = first_row - cy;
      const V dx = hn::Sub(hn::Iota(d, static_cast<float>(x)), hn::Set(d, cx));
      V e = hn::NegMulAdd(m, hn::Set(d, dy0), dx);
      V plane = hn::MulAdd(hn::Set(d, splat.depth_dx), dx,
                           hn::Set(d, splat.depth + splat.depth_dy * dy0));
      std::size_t pixel =
          static_cast<std::size_t>(first_row) * kTileSize + static_cast<std::size_t>(x);
      for (float dy = dy0; dy <= last_row - cy; dy += 1.0F) {
        draw_row(splat, normal, s, pixel, hn::Set(d, q * dy * dy), e, plane);
        e = hn::Sub(e, m);
        plane = hn::Add(plane, depth_dy);
        pixel += kTileSize;
      }
    }
  }

  /// A vector of pixels of one row: e = dx - m dy, `plane` the depth on the tangent plane.
  HWY_INLINE void draw_row(const Splat& splat, const SplatNormal* normal, const Spread& s,
                           std::size_t pixel, V row_beta, V e, V plane) {
    const D d;
    const V beta = hn::MulAdd(hn::Mul(s.k, e), e, row_beta);
    const V depth = hn::Min(hn::Max(plane, s.depth_lo), s.depth_hi);
    // What lies within epsilon of the hiding surface may belong to it.
    const M seen = hn::Ge(hn::Add(depth, s.epsilon), hn::Load(d, hidden_ + pixel));
    const M inside = hn::And(seen, hn::Lt(beta, s.cutoff));
    if (hn::AllFalse(d, inside)) return;
    V rho = exp_minus(hn::IfThenElseZero(inside, beta));
    for (int i = 0; i < s.squarings; ++i) rho = hn::Mul(rho, rho);
    add(splat, normal, s, pixel, inside, hn::Mul(s.amplitude, rho), depth);
  }

  /// Accumulate or separate, SS01 section 6, for a vector of pixels.
  HWY_INLINE void add(const Splat& splat, const SplatNormal* normal, const Spread& s,
                      std::size_t pixel, M open, V rho, V depth) {
    const D d;
    const hn::RebindToUnsigned<D> du;
    const auto side = hn::Set(du, 1u);
    float* fragment = s.data + pixel;
    for (int layer = 0; layer < s.layers; ++layer, fragment += s.stride) {
      const V weight = hn::Load(d, fragment + kWeight * kTilePixels);
      const V weighted_depth = hn::Load(d, fragment + kDepth * kTilePixels);
      const V tag = hn::Load(d, fragment + kTag * kTilePixels);
      // depth - fragment's depth, times the fragment's weight, to save the division.
      const V behind = hn::MulSub(depth, weight, weighted_depth);
      const M near = hn::Lt(hn::Abs(behind), hn::Mul(s.epsilon, weight));
      const M same_side = hn::RebindMask(
          d, hn::Eq(hn::And(hn::Xor(hn::BitCast(du, tag), hn::BitCast(du, s.tag)), side),
                    hn::Zero(du)));
      const M free = hn::Eq(weight, hn::Zero(d));
      const M joins = hn::And(open, hn::Or(free, hn::And(near, same_side)));
      if (!hn::AllFalse(d, joins)) {
        if (!hn::AllFalse(d, free)) {
          hn::Store(hn::IfThenElse(free, s.tag, tag), d, fragment + kTag * kTilePixels);
        }
        accumulate(fragment, s, hn::IfThenElseZero(joins, rho), depth, weight, weighted_depth);
        open = hn::AndNot(joins, open);
        if (hn::AllFalse(d, open)) return;
      }
      const M hidden = hn::And(covers(fragment, weight, s.full), hn::Lt(behind, hn::Zero(d)));
      open = hn::AndNot(hidden, open);
      if (hn::AllFalse(d, open)) return;
    }
    // No layer is left in these pixels.
    HWY_ALIGN float rhos[kTileSize];
    HWY_ALIGN float depths[kTileSize];
    HWY_ALIGN float lanes[kTileSize];
    hn::Store(rho, d, rhos);
    hn::Store(depth, d, depths);
    hn::Store(hn::IfThenElseZero(open, hn::Set(d, 1.0F)), d, lanes);
    for (std::size_t lane = 0; lane < hn::Lanes(d); ++lane) {
      if (lanes[lane] == 0) continue;
      insert_by_merging(tile_, static_cast<int>(pixel + lane), rhos[lane], depths[lane],
                        splat.depth_range * job_.depth_epsilon, splat, normal);
    }
  }

  /// Adds rho, which is zero where a pixel does not take part.
  static void accumulate(float* fragment, const Spread& s, V rho, V depth, V weight,
                         V weighted_depth) {
    const D d;
    const auto add_to = [&](int channel, V value) {
      float* plane = fragment + channel * kTilePixels;
      hn::Store(hn::MulAdd(rho, value, hn::Load(d, plane)), d, plane);
    };
    hn::Store(hn::Add(weight, rho), d, fragment + kWeight * kTilePixels);
    hn::Store(hn::MulAdd(rho, depth, weighted_depth), d, fragment + kDepth * kTilePixels);
    add_to(kRed, s.red);
    add_to(kGreen, s.green);
    add_to(kBlue, s.blue);
    if constexpr (!kOpaqueSplats) add_to(kAlpha, s.alpha);
    if constexpr (kNormals) {
      add_to(kNormalX, s.normal_x);
      add_to(kNormalY, s.normal_y);
      add_to(kNormalZ, s.normal_z);
    }
  }

  const TileJob& job_;
  TileABuffer& tile_;
  const V full_;
  float scale_ = 1;    ///< 2^-n, applied to beta and the cutoff.
  int squarings_ = 0;  ///< n.
  HWY_ALIGN float hidden_[kTilePixels];
};

}  // namespace

void rasterize_tile_simd(const TileJob& job, TileABuffer& tile) {
  if (job.normals) {
    job.opaque ? Rasterizer<true, true>(job, tile).run() : Rasterizer<true, false>(job, tile).run();
  } else {
    job.opaque ? Rasterizer<false, true>(job, tile).run()
               : Rasterizer<false, false>(job, tile).run();
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {

HWY_EXPORT(rasterize_tile_simd);

void rasterize_tile(const TileJob& job, TileABuffer& tile) {
  HWY_DYNAMIC_DISPATCH(rasterize_tile_simd)(job, tile);
}

}  // namespace surfel
#endif
