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

/// A vector holds this many columns and rows of a strip of the tile.
constexpr int kColumns = std::min<int>(hn::MaxLanes(D()), kStripWidth);
constexpr int kRows = static_cast<int>(hn::MaxLanes(D())) / kColumns;

/// A splat and what else the loops over its pixels need: in locals, as the compiler must assume
/// that stores to the A-buffer change any member.
struct Drawing {
  Splat splat;
  SplatNormal normal;
  float k, q, depth_lo, depth_hi;
  V full, cutoff, epsilon;
  float* data;
  std::size_t stride;
  int layers, squarings;
};

template <bool kNormals, bool kOpaqueSplats>
class Rasterizer {
 public:
  Rasterizer(const TileJob& job, TileABuffer& tile)
      : job_(job), tile_(tile), full_(hn::Set(D(), tile.edge_weight)) {
    // exp(-beta) = exp(-beta / 2^n)^(2^n), with beta / 2^n at most 1.
    while (job.cutoff * scale_ > 1) {
      scale_ /= 2;
      ++squarings_;
    }
    for (int y = 0; y < kTileSize; ++y) {
      for (int x = 0; x < kTileSize; ++x) {
        outside_[tile_pixel(x, y)] = x < tile.width && y < tile.height ? -infinity() : infinity();
      }
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
    tile_.merges.dropped_weight += hn::GetLane(hn::SumOfLanes(D(), dropped_weight_));
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
    for (std::size_t pixel = 0; pixel < kTilePixels; pixel += hn::Lanes(d)) {
      V hidden = hn::Load(d, outside_ + pixel);
      for (int layer = 0; layer < tile_.layout.layers; ++layer) {
        const float* fragment = tile_.data + tile_.layout.layer_stride() * layer + pixel;
        const V weight = hn::Load(d, fragment + kWeight * kTilePixels);
        const V depth = hn::Load(d, fragment + kDepth * kTilePixels);
        hidden = hn::IfThenElse(covers(fragment, weight, full_),
                                hn::Max(hidden, hn::Div(depth, weight)), hidden);
        hidden = hn::IfThenElse(covers_merged(fragment, weight), hn::Max(hidden, depth), hidden);
      }
      hn::Store(hidden, d, hidden_ + pixel);
      least = hn::Min(least, hidden);
    }
    return hn::GetLane(hn::MinOfLanes(d, least));
  }

  /// Fragments that nothing behind is seen through.
  static M covers(const float* fragment, V weight, V full_weight) {
    const D d;
    // Merged fragments have a negative weight and never pass.
    M full = hn::Ge(weight, full_weight);
    if constexpr (!kOpaqueSplats) {
      const V alpha = hn::LoadU(d, fragment + kAlpha * kTilePixels);
      full = hn::And(full, hn::Ge(alpha, hn::Mul(weight, hn::Set(d, kOpaqueAlpha))));
    }
    return full;
  }

  /// Merged fragments that nothing behind is seen through.
  static M covers_merged(const float* fragment, V weight) {
    const D d;
    return hn::And(hn::Lt(weight, hn::Zero(d)),
                   hn::Ge(hn::LoadU(d, fragment + kAlpha * kTilePixels), hn::Set(d, kOpaqueAlpha)));
  }

  void draw(const Splat& splat, const SplatNormal* normal) {
    const D d;
    const float cx = splat.x - static_cast<float>(tile_.x0) - 0.5F;  // of pixel centres
    const float cy = splat.y - static_cast<float>(tile_.y0) - 0.5F;
    // First column and row, last column and row, whose centres lie within the bounding box: clamped
    // before they are converted, so that truncation rounds down. (The least that 0.9999 misses is
    // rejected by beta.)
    HWY_ALIGN const float corners[] = {cx - splat.half_x, cy - splat.half_y, cx + splat.half_x,
                                       cy + splat.half_y};
    HWY_ALIGN static constexpr float kToWhole[] = {0.9999F, 0.9999F, 0, 0};
    HWY_ALIGN std::int32_t box[4];
    const hn::CappedTag<float, 4> d4;
    const hn::RebindToSigned<decltype(d4)> di4;
    for (std::size_t i = 0; i < 4; i += hn::Lanes(d4)) {
      const auto clamped = hn::Min(hn::Max(hn::Load(d4, corners + i), hn::Zero(d4)),
                                   hn::Set(d4, static_cast<float>(kTileSize - 1)));
      hn::Store(hn::ConvertTo(di4, hn::Add(clamped, hn::Load(d4, kToWhole + i))), di4, box + i);
    }
    const int first_column = box[0], first_row = box[1], last_column = box[2], last_row = box[3];
    if (first_column > last_column || first_row > last_row) return;

    Drawing s;
    s.splat = splat;
    if constexpr (kNormals) s.normal = *normal;
    s.full = full_;
    s.cutoff = hn::Set(d, job_.cutoff * scale_);
    s.data = tile_.data;
    s.stride = tile_.layout.layer_stride();
    s.layers = tile_.layout.layers;
    s.squarings = squarings_;
    // As few vectors as hold the rows, moved up where the last would leave the strip.
    const int height = (last_row - first_row + kRows) / kRows * kRows;
    const int top = std::min(first_row, kTileSize - height);
    const V dy0 = hn::Add(hn::Load(d, kRowOfLane), hn::Set(d, static_cast<float>(top) - cy));
    const Box pixels{first_column, last_column, top, height, cx, dy0};
    if (splat.k < 0) {
      draw_exact(splat, normal, job_.exact[&splat - job_.splats], s, pixels);
      return;
    }
    s.k = splat.k * scale_;
    s.q = job_.cutoff * scale_ / (splat.half_y * splat.half_y);
    s.epsilon = hn::Set(d, splat.depth_range * job_.depth_epsilon);
    s.depth_lo = splat.depth - splat.depth_range;
    s.depth_hi = splat.depth + splat.depth_range;
    const V m = hn::Set(d, splat.m);
    const V depth_dx = hn::Set(d, splat.depth_dx);
    const V depth_dy = hn::Set(d, splat.depth_dy);
    const V depth = hn::Set(d, splat.depth);
    for_each_vector(pixels, [&](std::size_t pixel, V dx, V dy) {
      draw_vector(splat, normal, s, pixel, hn::NegMulAdd(m, dy, dx), dy,
                  hn::MulAdd(depth_dx, dx, hn::MulAdd(depth_dy, dy, depth)));
    });
  }

  /// Pixels of the tile that a splat's bounding box holds: columns, and rows in whole vectors.
  struct Box {
    int first_column, last_column;
    int top, height;
    float cx;  ///< The splat's centre, from the tile's first column.
    V dy0;     ///< Offsets of the first vector's rows from it.
  };

  /// Calls body(first pixel, offsets dx, dy from the splat's centre) for every vector of the box.
  template <class Body>
  static HWY_INLINE void for_each_vector(const Box& box, Body body) {
    const D d;
    for (int x = box.first_column / kColumns * kColumns; x <= box.last_column; x += kColumns) {
      const V dx = hn::Add(hn::Load(d, kColumnOfLane), hn::Set(d, static_cast<float>(x) - box.cx));
      V dy = box.dy0;
      const std::size_t first = tile_pixel(x, box.top);
      const std::size_t end = first + static_cast<std::size_t>(box.height) * kStripWidth;
      for (std::size_t pixel = first; pixel < end; pixel += kRows * kStripWidth) {
        body(pixel, dx, dy);
        dy = hn::Add(dy, hn::Set(d, static_cast<float>(kRows)));
      }
    }
  }

  /// The kernel where every pixel's ray meets the tangent plane: exact_kernel.h. Apart from the
  /// affine one's code, as few splats come here.
  HWY_NOINLINE void draw_exact(const Splat& splat, const SplatNormal* normal,
                               const ExactSplat& exact, Drawing& s, const Box& box) {
    const D d;
    const V h2 = hn::Set(d, job_.lowpass2);
    const V one = hn::Set(d, 1.0F);
    const V scale = hn::Set(d, 0.5F * scale_);
    for_each_vector(box, [&](std::size_t pixel, V dx, V dy) {
      const auto affine = [&](const float* f) {
        return hn::MulAdd(hn::Set(d, f[1]), dx, hn::MulAdd(hn::Set(d, f[2]), dy, hn::Set(d, f[0])));
      };
      // Plane coordinates of the hit, and z times their gradients on screen: J^-1 at this pixel.
      const V plane = affine(exact.depth);
      const V z = hn::Div(one, plane);
      const V u = hn::Mul(affine(exact.u), z);
      const V v = hn::Mul(affine(exact.v), z);
      const V ux = hn::NegMulAdd(u, hn::Set(d, exact.depth[1]), hn::Set(d, exact.u[1]));
      const V uy = hn::NegMulAdd(u, hn::Set(d, exact.depth[2]), hn::Set(d, exact.u[2]));
      const V vx = hn::NegMulAdd(v, hn::Set(d, exact.depth[1]), hn::Set(d, exact.v[1]));
      const V vy = hn::NegMulAdd(v, hn::Set(d, exact.depth[2]), hn::Set(d, exact.v[2]));
      // |I + h^2 J^-1 J^-T| and beta of (8), both as sums of positive terms.
      const auto sum2 = [](V a, V b) { return hn::MulAdd(a, a, hn::Mul(b, b)); };
      const V filter = hn::Mul(h2, hn::Mul(z, z));
      const V cross = hn::Mul(filter, hn::MulSub(ux, vy, hn::Mul(uy, vx)));
      const V det =
          hn::MulAdd(cross, cross, hn::MulAdd(filter, hn::Add(sum2(ux, uy), sum2(vx, vy)), one));
      const V skew = sum2(hn::MulSub(u, vx, hn::Mul(v, ux)), hn::MulSub(u, vy, hn::Mul(v, uy)));
      const V inv_det = hn::Div(one, det);
      const V beta = hn::Mul(hn::Mul(scale, inv_det), hn::MulAdd(filter, skew, sum2(u, v)));
      const V depth =
          hn::Min(hn::Max(plane, hn::Set(d, exact.depth_lo)), hn::Set(d, exact.depth_hi));
      s.epsilon = hn::Mul(hn::Mul(hn::Set(d, job_.depth_epsilon), depth),
                          hn::Sqrt(hn::MulAdd(hn::Set(d, exact.deviation2), hn::Mul(depth, depth),
                                              hn::Set(d, exact.pixel2))));
      const M met =
          hn::And(hn::Gt(plane, hn::Zero(d)), hn::Lt(plane, hn::Set(d, exact.depth_most)));
      const M seen = hn::Ge(hn::Add(depth, s.epsilon), hn::LoadU(d, hidden_ + pixel));
      const M inside = hn::And(hn::And(met, seen), hn::Lt(beta, s.cutoff));
      if (hn::AllFalse(d, inside)) return;
      const V amplitude = hn::Mul(hn::Set(d, exact.amplitude), hn::Sqrt(inv_det));
      add(splat, normal, s, pixel, inside, hn::Mul(amplitude, decay(s, inside, beta)), depth);
    });
  }

  /// exp(-beta) from beta scaled by 2^-n, where `inside`; 1 elsewhere.
  static HWY_INLINE V decay(const Drawing& s, M inside, V beta) {
    V rho = exp_minus(hn::IfThenElseZero(inside, beta));
    for (int i = 0; i < s.squarings; ++i) rho = hn::Mul(rho, rho);
    return rho;
  }

  /// A vector of pixels: e = dx - m dy, `plane` the depth on the tangent plane.
  HWY_INLINE void draw_vector(const Splat& splat, const SplatNormal* normal, const Drawing& s,
                              std::size_t pixel, V e, V dy, V plane) {
    const D d;
    const V beta =
        hn::MulAdd(hn::Mul(hn::Set(d, s.k), e), e, hn::Mul(hn::Mul(hn::Set(d, s.q), dy), dy));
    const V depth = hn::Min(hn::Max(plane, hn::Set(d, s.depth_lo)), hn::Set(d, s.depth_hi));
    // What lies within epsilon of the hiding surface may belong to it.
    const M seen = hn::Ge(hn::Add(depth, s.epsilon), hn::LoadU(d, hidden_ + pixel));
    const M inside = hn::And(seen, hn::Lt(beta, s.cutoff));
    if (hn::AllFalse(d, inside)) return;
    const V rho = hn::Mul(hn::Set(d, s.splat.amplitude), decay(s, inside, beta));
    add(splat, normal, s, pixel, inside, rho, depth);
  }

  /// Accumulate or separate, SS01 section 6, for a vector of pixels.
  HWY_INLINE void add(const Splat& splat, const SplatNormal* normal, const Drawing& s,
                      std::size_t pixel, M open, V rho, V depth) {
    const D d;
    const hn::RebindToUnsigned<D> du;
    const auto side = hn::Set(du, kFrontTag);
    float* fragment = s.data + pixel;
    for (int layer = 0; layer < s.layers; ++layer, fragment += s.stride) {
      const V weight = hn::LoadU(d, fragment + kWeight * kTilePixels);
      const V weighted_depth = hn::LoadU(d, fragment + kDepth * kTilePixels);
      const V tag = hn::LoadU(d, fragment + kTag * kTilePixels);
      // depth - fragment's depth, times the fragment's weight, to save the division.
      const V behind = hn::MulSub(depth, weight, weighted_depth);
      const M near = hn::Lt(hn::Abs(behind), hn::Mul(s.epsilon, weight));
      const M same_side = hn::RebindMask(
          d, hn::Eq(hn::And(hn::Xor(hn::BitCast(du, tag), hn::Set(du, s.splat.tag)), side),
                    hn::Zero(du)));
      const M free = hn::Eq(weight, hn::Zero(d));
      const M joins = hn::And(open, hn::Or(free, hn::And(near, same_side)));
      if (!hn::AllFalse(d, joins)) {
        if (!hn::AllFalse(d, free)) {
          hn::StoreU(hn::IfThenElse(free, hn::BitCast(d, hn::Set(du, s.splat.tag)), tag), d,
                     fragment + kTag * kTilePixels);
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
    open = add_to_merged(s, pixel, open, rho, depth);
    if (hn::AllFalse(d, open)) return;
    HWY_ALIGN float rhos[kTileSize];
    HWY_ALIGN float depths[kTileSize];
    HWY_ALIGN float lanes[kTileSize];
    hn::Store(rho, d, rhos);
    hn::Store(depth, d, depths);
    hn::Store(hn::IfThenElseZero(open, hn::Set(d, 1.0F)), d, lanes);
    for (std::size_t lane = 0; lane < hn::Lanes(d); ++lane) {
      if (lanes[lane] == 0) continue;
      insert_by_merging(tile_, static_cast<int>(pixel + lane), rhos[lane], depths[lane], splat,
                        normal);
    }
  }

  /// Contributions that come after their surface has been merged: those behind an opaque pair are
  /// not seen, those within a pair come too late and are dropped (and counted). Returns the others.
  HWY_INLINE M add_to_merged(const Drawing& s, std::size_t pixel, M open, V rho, V depth) {
    const D d;
    const float* fragment = s.data + pixel;
    for (int layer = 0; layer < s.layers; ++layer, fragment += s.stride) {
      const V weight = hn::LoadU(d, fragment + kWeight * kTilePixels);
      const V front = hn::LoadU(d, fragment + kDepth * kTilePixels);
      const V back = hn::LoadU(d, fragment + kBack * kTilePixels);
      open = hn::AndNot(hn::And(covers_merged(fragment, weight), hn::Lt(depth, front)), open);
      const M within = hn::And(hn::And(open, hn::Lt(weight, hn::Zero(d))),
                               hn::And(hn::Lt(hn::Sub(depth, s.epsilon), front),
                                       hn::Gt(hn::Add(depth, s.epsilon), back)));
      tile_.merges.dropped += hn::CountTrue(d, within);
      dropped_weight_ = hn::Add(dropped_weight_, hn::IfThenElseZero(within, rho));
      open = hn::AndNot(within, open);
    }
    return open;
  }

  /// Adds rho, which is zero where a pixel does not take part.
  static void accumulate(float* fragment, const Drawing& s, V rho, V depth, V weight,
                         V weighted_depth) {
    const D d;
    const auto add_to = [&](int channel, V value) {
      float* plane = fragment + channel * kTilePixels;
      hn::StoreU(hn::MulAdd(rho, value, hn::LoadU(d, plane)), d, plane);
    };
    hn::StoreU(hn::Add(weight, rho), d, fragment + kWeight * kTilePixels);
    hn::StoreU(hn::MulAdd(rho, depth, weighted_depth), d, fragment + kDepth * kTilePixels);
    add_to(kRed, hn::Set(d, s.splat.red));
    add_to(kGreen, hn::Set(d, s.splat.green));
    add_to(kBlue, hn::Set(d, s.splat.blue));
    if constexpr (!kOpaqueSplats) add_to(kAlpha, hn::Set(d, s.splat.alpha));
    if constexpr (kNormals) {
      add_to(kNormalX, hn::Set(d, s.normal.x));
      add_to(kNormalY, hn::Set(d, s.normal.y));
      add_to(kNormalZ, hn::Set(d, s.normal.z));
    }
  }

  const TileJob& job_;
  TileABuffer& tile_;
  const V full_;
  V dropped_weight_ = hn::Zero(D());
  float scale_ = 1;    ///< 2^-n, applied to beta and the cutoff.
  int squarings_ = 0;  ///< n.
  HWY_ALIGN float hidden_[kTilePixels];
  HWY_ALIGN float outside_[kTilePixels];  ///< Infinity outside of the picture: hidden for good.
  HWY_ALIGN static constexpr float kColumnOfLane[] = {0, 1, 2, 3, 0, 1, 2, 3,
                                                      0, 1, 2, 3, 0, 1, 2, 3};
  HWY_ALIGN static constexpr float kRowOfLane[] = {0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3};
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
