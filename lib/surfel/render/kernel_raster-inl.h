// Zwicker, Pfister, van Baar, Gross, "Surface Splatting", SIGGRAPH 2001: section 4. What all SIMD
// rasterisers of a tile share; included once for each target, see Highway's documentation.

#if defined(SURFEL_RENDER_KERNEL_RASTER_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SURFEL_RENDER_KERNEL_RASTER_INL_H_
#undef SURFEL_RENDER_KERNEL_RASTER_INL_H_
#else
#define SURFEL_RENDER_KERNEL_RASTER_INL_H_
#endif

#include <algorithm>
#include <cmath>

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

/// For the body of the innermost loop: vectors passed to a function go through memory.
#undef SURFEL_INLINE_LAMBDA
#define SURFEL_INLINE_LAMBDA __attribute__((always_inline))

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

/// A splat at a vector of pixels: what its kernel and its plane are there.
struct Sample {
  V beta;       ///< Scaled, see KernelRaster::cutoff().
  V depth;      ///< Of the plane, within the kernel's reach.
  V epsilon;    ///< Depths within this are of one surface.
  V amplitude;  ///< rho where beta is 0.
};

/// Evaluates the splats of one tile at its pixels, a vector at a time.
class KernelRaster {
 public:
  KernelRaster(const TileJob& job, int x0, int y0)
      : job_(job), x0_(static_cast<float>(x0) + 0.5F), y0_(static_cast<float>(y0) + 0.5F) {
    // exp(-beta) = exp(-beta / 2^n)^(2^n), with beta / 2^n at most 1.
    while (job.cutoff * scale_ > 1) {
      scale_ /= 2;
      ++squarings_;
    }
  }

  /// What visitors compare scaled betas with: pixels are inside where beta is less.
  float cutoff() const { return job_.cutoff * scale_; }

  /// Calls visit(splat's index, first pixel, Sample) for every vector of pixels that the box of a
  /// splat in [begin, end) of the order meets, in that order; but for splats that lie behind the
  /// depth `hidden` with all that is within epsilon of them.
  template <class Visit>
  HWY_INLINE void draw(std::size_t begin, std::size_t end, float hidden, const Visit& visit) const {
    // Vectors are listed first and visited then: the loops over a splat's columns and rows end
    // after one or two rounds, which costs more than the round itself where it is guessed wrong.
    HWY_ALIGN Place places[kPlaces + kMostPlaces];
    while (begin < end) {
      std::size_t count = 0;
      for (; begin < end && count <= kPlaces; ++begin) {
        prefetch(begin);
        const std::uint32_t index = job_.order[begin];
        const Splat& splat = job_.splats[index];
        if (splat.depth + (1 + job_.depth_epsilon) * splat.depth_range < hidden) continue;
        count += list(index, splat, places + count);
      }
      for (std::size_t p = 0; p < count; ++p) {
        visit(places[p].splat, places[p].pixel, sample(places[p]));
      }
    }
  }

  /// exp(-beta) from a scaled beta where `inside`; 1 elsewhere.
  HWY_INLINE V decay(M inside, V beta) const {
    V rho = exp_minus(hn::IfThenElseZero(inside, beta));
    for (int i = 0; i < squarings_; ++i) rho = hn::Mul(rho, rho);
    return rho;
  }

 private:
  /// A vector of pixels that the box of a splat meets.
  struct Place {
    std::uint32_t splat;
    std::uint32_t pixel;  ///< The first.
    float dx, dy;         ///< Its offset from the splat's centre.
  };
  static constexpr std::size_t kPlaces = 240;
  /// Most of one splat.
  static constexpr std::size_t kMostPlaces = kTilePixels / (kColumns * kRows);

  /// A tile's splats are strewn over the block.
  HWY_INLINE void prefetch(std::size_t place) const {
    constexpr std::size_t kPrefetchAhead = 16;
    if (place + kPrefetchAhead >= job_.count) return;
    const std::uint32_t index = job_.order[place + kPrefetchAhead];
    hwy::Prefetch(job_.splats + index);
    if (job_.normals) hwy::Prefetch(job_.normals + index);
  }

  /// Lists the vectors of a splat, a column of them after the other. Returns how many.
  HWY_INLINE std::size_t list(std::uint32_t index, const Splat& splat, Place* out) const {
    const auto within = [](int pixel, int origin) {
      return std::min(std::max(pixel - origin, 0), kTileSize - 1);
    };
    const int first_row = within(splat.box.y0, job_.box_y);
    const int first = within(splat.box.x0, job_.box_x) / kColumns;
    const int last = within(splat.box.x1, job_.box_x) / kColumns;
    // As few vectors as hold the rows, moved up where the last would leave the tile.
    const int height = (within(splat.box.y1, job_.box_y) - first_row + kRows) / kRows * kRows;
    const int top = std::min(first_row, kTileSize - height);
    const auto put = [&](int column, int row, std::size_t at) {
      out[at] = {index, static_cast<std::uint32_t>(tile_pixel(column * kColumns, row)),
                 static_cast<float>(column * kColumns) + x0_ - splat.x,
                 static_cast<float>(row) + y0_ - splat.y};
    };
    // Nearly all are small: no branch on whether one has a second column.
    if (height == kRows && last - first <= 1) {
      put(first, top, 0);
      put(last, top, 1);
      return static_cast<std::size_t>(1 + last - first);
    }
    std::size_t count = 0;
    for (int column = first; column <= last; ++column) {
      for (int row = top; row < top + height; row += kRows) put(column, row, count++);
    }
    return count;
  }

  HWY_INLINE Sample sample(const Place& place) const {
    const D d;
    const Splat& splat = job_.splats[place.splat];
    const V dx = hn::Add(hn::Load(d, kColumnOfLane), hn::Set(d, place.dx));
    const V dy = hn::Add(hn::Load(d, kRowOfLane), hn::Set(d, place.dy));
    if (HWY_UNLIKELY(splat.k < 0)) return exact(job_.exact[place.splat], dx, dy);
    const V depth = hn::Set(d, splat.depth);
    const V range = hn::Set(d, splat.depth_range);
    const V plane = hn::MulAdd(hn::Set(d, splat.depth_dx), dx,
                               hn::MulAdd(hn::Set(d, splat.depth_dy), dy, depth));
    const V e = hn::NegMulAdd(hn::Set(d, splat.m), dy, dx);
    Sample s;
    s.beta = hn::Mul(hn::MulAdd(hn::Mul(hn::Set(d, splat.k), e), e,
                                hn::Mul(hn::Mul(hn::Set(d, splat.q), dy), dy)),
                     hn::Set(d, scale_));
    s.depth = hn::Min(hn::Max(plane, hn::Sub(depth, range)), hn::Add(depth, range));
    s.epsilon = hn::Mul(range, hn::Set(d, job_.depth_epsilon));
    s.amplitude = hn::Set(d, splat.amplitude);
    return s;
  }

  /// The kernel where every pixel's ray meets the tangent plane: exact_kernel.h. Apart from the
  /// affine one's code, as few splats come here.
  HWY_NOINLINE Sample exact(const ExactSplat& exact, V dx, V dy) const {
    const D d;
    const V h2 = hn::Set(d, job_.lowpass2);
    const V one = hn::Set(d, 1.0F);
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
    const V beta =
        hn::Mul(hn::Mul(hn::Set(d, 0.5F * scale_), inv_det), hn::MulAdd(filter, skew, sum2(u, v)));
    const M met = hn::And(hn::Gt(plane, hn::Zero(d)), hn::Lt(plane, hn::Set(d, exact.depth_most)));
    Sample s;
    s.beta = hn::IfThenElse(met, beta, hn::Set(d, __builtin_inff()));
    s.depth = hn::Min(hn::Max(plane, hn::Set(d, exact.depth_lo)), hn::Set(d, exact.depth_hi));
    s.epsilon = hn::Mul(hn::Mul(hn::Set(d, job_.depth_epsilon), s.depth),
                        hn::Sqrt(hn::MulAdd(hn::Set(d, exact.deviation2), hn::Mul(s.depth, s.depth),
                                            hn::Set(d, exact.pixel2))));
    s.amplitude = hn::Mul(hn::Set(d, exact.amplitude), hn::Sqrt(inv_det));
    return s;
  }

  const TileJob& job_;
  float x0_, y0_;      ///< Centre of the tile's first pixel in the picture.
  float scale_ = 1;    ///< 2^-n, applied to beta and the cutoff.
  int squarings_ = 0;  ///< n.
};

/// Adds a contribution to a vector of fragments, `fragment` being the first one's weight; rho is
/// zero where a pixel does not take part. The fragments' old weights and weighted depths are given.
template <bool kNormals, bool kOpaqueSplats>
HWY_INLINE void accumulate(float* fragment, const Splat& splat, const SplatNormal* normal, V rho,
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
    add_to(kNormalX, normal->x);
    add_to(kNormalY, normal->y);
    add_to(kNormalZ, normal->z);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#endif
