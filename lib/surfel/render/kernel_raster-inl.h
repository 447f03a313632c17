// Zwicker, Pfister, van Baar, Gross, "Surface Splatting", SIGGRAPH 2001: section 4. What all SIMD
// rasterisers of a tile share; included once for each target, see Highway's documentation.

#if defined(SURFEL_RENDER_KERNEL_RASTER_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SURFEL_RENDER_KERNEL_RASTER_INL_H_
#undef SURFEL_RENDER_KERNEL_RASTER_INL_H_
#else
#define SURFEL_RENDER_KERNEL_RASTER_INL_H_
#endif

#include <hwy/cache_control.h>
#include <hwy/highway.h>
#include <surfel/render/a_buffer.h>
#include <surfel/render/tile_raster.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {

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
inline constexpr int kColumns = std::min<int>(hn::MaxLanes(D()), kStripWidth);
inline constexpr int kRows = static_cast<int>(hn::MaxLanes(D())) / kColumns;

HWY_ALIGN inline constexpr float kColumnOfLane[] = {0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3};
HWY_ALIGN inline constexpr float kRowOfLane[] = {0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3};

/// Evaluates the splats of one tile at its pixels, a vector at a time.
class KernelRaster {
 public:
  KernelRaster(const TileJob& job, int x0, int y0)
      : job_(job), x0_(static_cast<float>(x0)), y0_(static_cast<float>(y0)) {
    // exp(-beta) = exp(-beta / 2^n)^(2^n), with beta / 2^n at most 1.
    while (job.cutoff * scale_ > 1) {
      scale_ /= 2;
      ++squarings_;
    }
  }

  /// A tile's splats are strewn over the batch: without this, waiting for them takes half the
  /// time. To be called for every place of the order.
  HWY_INLINE void prefetch(std::size_t place) const {
    constexpr std::size_t kPrefetchAhead = 12;
    if (place + kPrefetchAhead >= job_.count) return;
    const std::uint32_t index = job_.order[place + kPrefetchAhead];
    hwy::Prefetch(job_.splats + index);
    if (job_.normals) hwy::Prefetch(job_.normals + index);
  }

  /// Is the splat's kernel above rounding? Edge-on ones are not, and would leave fragments without
  /// weight.
  bool contributes(std::uint32_t index) const {
    const Splat& splat = job_.splats[index];
    return (splat.k < 0 ? job_.exact[index].amplitude : splat.amplitude) > 1e-30F;
  }

  /// What visitors compare scaled betas with: pixels are inside where beta is less.
  float cutoff() const { return job_.cutoff * scale_; }

  /// Calls visit(first pixel, scaled beta, depth, epsilon, amplitude()) for every vector of pixels
  /// that the splat's box meets; amplitude() is a function as few need it before they know more.
  template <class Visit>
  HWY_INLINE void draw(std::uint32_t index, const Visit& visit) const {
    const D d;
    const Splat& splat = job_.splats[index];
    const float cx = splat.x - x0_ - 0.5F;  // of pixel centres
    const float cy = splat.y - y0_ - 0.5F;
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

    // As few vectors as hold the rows, moved up where the last would leave the strip.
    const int height = (last_row - first_row + kRows) / kRows * kRows;
    const int top = std::min(first_row, kTileSize - height);
    const V dy0 = hn::Add(hn::Load(d, kRowOfLane), hn::Set(d, static_cast<float>(top) - cy));
    const Box pixels{first_column, last_column, top, height, cx, dy0};
    if (splat.k < 0) {
      draw_exact(job_.exact[index], pixels, visit);
      return;
    }
    const V k = hn::Set(d, splat.k * scale_);
    const V q = hn::Set(d, job_.cutoff * scale_ / (splat.half_y * splat.half_y));
    const V epsilon = hn::Set(d, splat.depth_range * job_.depth_epsilon);
    const V depth_lo = hn::Set(d, splat.depth - splat.depth_range);
    const V depth_hi = hn::Set(d, splat.depth + splat.depth_range);
    const V m = hn::Set(d, splat.m);
    const V depth_dx = hn::Set(d, splat.depth_dx);
    const V depth_dy = hn::Set(d, splat.depth_dy);
    const V depth = hn::Set(d, splat.depth);
    const float peak = splat.amplitude;  // The visitor's stores might change the splat's.
    for_each_vector(pixels, [&](std::size_t pixel, V dx, V dy) HWY_ATTR {
      const V e = hn::NegMulAdd(m, dy, dx);
      const V plane = hn::MulAdd(depth_dx, dx, hn::MulAdd(depth_dy, dy, depth));
      const V beta = hn::MulAdd(hn::Mul(k, e), e, hn::Mul(hn::Mul(q, dy), dy));
      visit(pixel, beta, hn::Min(hn::Max(plane, depth_lo), depth_hi), epsilon,
            [&]() HWY_ATTR { return hn::Set(D(), peak); });
    });
  }

  /// exp(-beta) from a scaled beta where `inside`; 1 elsewhere.
  HWY_INLINE V decay(M inside, V beta) const {
    V rho = exp_minus(hn::IfThenElseZero(inside, beta));
    for (int i = 0; i < squarings_; ++i) rho = hn::Mul(rho, rho);
    return rho;
  }

 private:
  /// Pixels of the tile that a splat's bounding box holds: columns, and rows in whole vectors.
  struct Box {
    int first_column, last_column;
    int top, height;
    float cx;  ///< The splat's centre, from the tile's first column.
    V dy0;     ///< Offsets of the first vector's rows from it.
  };

  /// Calls body(first pixel, offsets dx, dy from the splat's centre) for every vector of the box.
  template <class Body>
  static HWY_INLINE void for_each_vector(const Box& box, const Body& body) {
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
  template <class Visit>
  HWY_NOINLINE void draw_exact(const ExactSplat& exact, const Box& box, const Visit& visit) const {
    const D d;
    const V h2 = hn::Set(d, job_.lowpass2);
    const V one = hn::Set(d, 1.0F);
    const V scale = hn::Set(d, 0.5F * scale_);
    for_each_vector(box, [&](std::size_t pixel, V dx, V dy) HWY_ATTR {
      const auto affine = [&](const float* f) HWY_ATTR {
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
      const auto sum2 = [](V a, V b) HWY_ATTR { return hn::MulAdd(a, a, hn::Mul(b, b)); };
      const V filter = hn::Mul(h2, hn::Mul(z, z));
      const V cross = hn::Mul(filter, hn::MulSub(ux, vy, hn::Mul(uy, vx)));
      const V det =
          hn::MulAdd(cross, cross, hn::MulAdd(filter, hn::Add(sum2(ux, uy), sum2(vx, vy)), one));
      const V skew = sum2(hn::MulSub(u, vx, hn::Mul(v, ux)), hn::MulSub(u, vy, hn::Mul(v, uy)));
      const V inv_det = hn::Div(one, det);
      const V beta = hn::Mul(hn::Mul(scale, inv_det), hn::MulAdd(filter, skew, sum2(u, v)));
      const V depth =
          hn::Min(hn::Max(plane, hn::Set(d, exact.depth_lo)), hn::Set(d, exact.depth_hi));
      const V epsilon =
          hn::Mul(hn::Mul(hn::Set(d, job_.depth_epsilon), depth),
                  hn::Sqrt(hn::MulAdd(hn::Set(d, exact.deviation2), hn::Mul(depth, depth),
                                      hn::Set(d, exact.pixel2))));
      const M met =
          hn::And(hn::Gt(plane, hn::Zero(d)), hn::Lt(plane, hn::Set(d, exact.depth_most)));
      visit(pixel, hn::IfThenElse(met, beta, hn::Set(d, __builtin_inff())), depth, epsilon,
            [&]() HWY_ATTR { return hn::Mul(hn::Set(D(), exact.amplitude), hn::Sqrt(inv_det)); });
    });
  }

  const TileJob& job_;
  float x0_, y0_;      ///< Top left pixel of the tile in the picture.
  float scale_ = 1;    ///< 2^-n, applied to beta and the cutoff.
  int squarings_ = 0;  ///< n.
};

/// Adds a contribution to a vector of fragments, `fragment` being the first one's weight; rho is
/// zero where a pixel does not take part. The fragments' old weights and weighted depths are given.
template <bool kNormals, bool kOpaqueSplats>
HWY_INLINE void accumulate(float* fragment, const Splat& splat, const SplatNormal& normal, V rho,
                           V depth, V weight, V weighted_depth) {
  const D d;
  const auto add_to = [&](int channel, float value) HWY_ATTR {
    float* plane = fragment + channel * kTilePixels;
    hn::StoreU(hn::MulAdd(rho, hn::Set(d, value), hn::LoadU(d, plane)), d, plane);
  };
  hn::StoreU(hn::Add(weight, rho), d, fragment + kWeight * kTilePixels);
  hn::StoreU(hn::MulAdd(rho, depth, weighted_depth), d, fragment + kDepth * kTilePixels);
  add_to(kRed, splat.red);
  add_to(kGreen, splat.green);
  add_to(kBlue, splat.blue);
  if constexpr (!kOpaqueSplats) add_to(kAlpha, splat.alpha);
  if constexpr (kNormals) {
    add_to(kNormalX, normal.x);
    add_to(kNormalY, normal.y);
    add_to(kNormalZ, normal.z);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#endif
