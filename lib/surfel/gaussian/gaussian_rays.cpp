// Kernels along rays, in the order of every pixel's depths: Radl et al., "StopThePop", SIGGRAPH
// 2024, whose short windows of a fixed length are lists here that end by bounds. Zwicker, Pfister,
// van Baar, Gross, "Surface Splatting", SIGGRAPH 2001 (SS01): surfaces.

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>

#include <surfel/gaussian/gaussian_raster.h>
#include <surfel/gaussian/gaussian_rays.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/gaussian/gaussian_rays.cpp"
#include <hwy/cache_control.h>
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <surfel/base/compress-inl.h>
#include <surfel/base/fused-inl.h>
#include <surfel/gaussian/gaussian_patch-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {
namespace {

constexpr std::size_t kLanes = hn::MaxLanes(D());
/// Vectors of pixels of a patch.
constexpr std::size_t kParts = kPatchPixels / kLanes;
/// Splats of a patch that share a bound of their depths.
constexpr std::size_t kBlock = 8;
/// Against the rounding of bounds of exponents.
constexpr float kSlackOfExcess = 0.02F;
/// Bounds of depths are lowered by this share, against rounding.
constexpr float kNearer = 1e-5F;

/// Alpha and depth of splats at a vector of pixels.
class RaySampler {
 public:
  RaySampler() = default;
  RaySampler(const GaussianView& view, V x, V y)
      : near_(view.near), density_(view.rule == AmplitudeRule::kDensity), x_(x), y_(y) {
    const V slope_x = hn::Mul(hn::Sub(x, all_lanes(view.center_x)), all_lanes(1 / view.focal_x));
    const V slope_y = hn::Mul(hn::Sub(y, all_lanes(view.center_y)), all_lanes(1 / view.focal_y));
    ray_length_ = hn::Sqrt(mul_add(slope_x, slope_x, mul_add(slope_y, slope_y, all_lanes(1))));
    if (view.orthographic) ray_length_ = all_lanes(1);
  }

  /// Alpha, 0 where there is none, and the depth of the largest contribution.
  HWY_INLINE void at(const GaussianSplat& s, const GaussianPerspective& p, V& alpha,
                     V& depth) const {
    const D d;
    const V zero = hn::Zero(d);
    const V dx = hn::Sub(x_, all_lanes(s.x));
    const V dy = hn::Sub(y_, all_lanes(s.y));
    const V across = mul_add(all_lanes(s.xx), dx, hn::Mul(all_lanes(s.xy), dy));
    const V form = mul_add(across, dx, hn::Mul(hn::Mul(all_lanes(s.yy), dy), dy));
    const V den_y = mul_add(mul_add(all_lanes(p.dyy), dy, all_lanes(p.dy)), dy, all_lanes(p.d));
    const V den_x = mul_add(all_lanes(p.dxy), dy, mul_add(all_lanes(p.dxx), dx, all_lanes(p.dx)));
    const V den = mul_add(den_x, dx, den_y);
    const V toward =
        mul_add(all_lanes(p.tx), dx, mul_add(all_lanes(p.ty), dy, all_lanes(s.z * p.d)));
    const V inv = hn::Div(all_lanes(1), den);
    const V exponent = hn::Max(hn::Mul(form, inv), zero);
    const V t = hn::Mul(toward, inv);
    const M covered = hn::And(hn::And(hn::Le(exponent, all_lanes(s.cut)), hn::Gt(den, zero)),
                              hn::Gt(t, all_lanes(near_)));
    V value = exp2_of(hn::Max(hn::Sub(all_lanes(s.log_opacity), exponent), all_lanes(-100)));
    if (density_) {
      const V tau = hn::Mul(hn::Mul(value, ray_length_), hn::Sqrt(inv));
      value = hn::Sub(all_lanes(1),
                      exp2_of(hn::Max(hn::Mul(all_lanes(-kLog2e), tau), all_lanes(-100))));
    }
    alpha = hn::IfThenElseZero(covered, value);
    // Pixels without a contribution keep the order that the splat has beside them, as far as it
    // reaches, lest they move through the list of contributions that wait.
    depth = hn::IfThenElse(hn::Gt(t, all_lanes(s.nearest)), t, all_lanes(s.nearest));
    const V farthest = all_lanes(2 * s.z - s.nearest);
    depth = hn::IfThenElse(hn::Gt(depth, farthest), farthest, depth);
  }

 private:
  float near_ = 0;
  bool density_ = false;
  V x_, y_, ray_length_;
};

/// Draws one tile: its splats are ordered by their depths about the middle of the tile, listed by
/// patches with bounds of the depths that they have there, and each patch puts their contributions
/// into the order of every pixel.
class RayTile {
 public:
  RayTile(const GaussianTileJob& job, GaussianRayScratch& scratch, GaussianTile& tile)
      : job_(job), scratch_(scratch), tile_(tile), pixels_(job), room_(job.count + kSpare) {}

  template <bool kDepth>
  void draw() {
    order();
    list();
    for (std::size_t patch = 0; patch < kPatches; ++patch) {
      if (count_[patch] == 0) continue;
      if (job_.view->rule == AmplitudeRule::kSurfel) {
        blend<SurfaceBlend<kDepth>>(patch);
      } else {
        blend<Blend<kDepth>>(patch);
      }
    }
  }

 private:
  /// Depth of the largest contribution on the ray of (x, y) from the splat's centre, as far as the
  /// splat reaches: on its plane, where it is flat.
  static HWY_INLINE V depth_at(const Fields<GaussianSplat>& splat,
                               const Fields<GaussianPerspective>& p, V x, V y) {
    const V z = splat(offsetof(GaussianSplat, z));
    const V near = splat(offsetof(GaussianSplat, nearest));
    const V d = p(offsetof(GaussianPerspective, d));
    const V den_y = mul_add(
        mul_add(p(offsetof(GaussianPerspective, dyy)), y, p(offsetof(GaussianPerspective, dy))), y,
        d);
    const V den_x = mul_add(
        p(offsetof(GaussianPerspective, dxy)), y,
        mul_add(p(offsetof(GaussianPerspective, dxx)), x, p(offsetof(GaussianPerspective, dx))));
    const V den = mul_add(den_x, x, den_y);
    const V toward = mul_add(p(offsetof(GaussianPerspective, tx)), x,
                             mul_add(p(offsetof(GaussianPerspective, ty)), y, hn::Mul(z, d)));
    const V t = hn::Div(toward, den);
    const V farthest = hn::Sub(hn::Add(z, z), near);
    const V least = hn::Max(near, hn::Zero(D()));
    const V bounded = hn::IfThenElse(hn::Gt(t, least), t, least);
    return hn::IfThenElse(hn::Gt(bounded, farthest), farthest, bounded);
  }

  HWY_INLINE hn::Vec<Tags> splats_from(const std::uint32_t* first, std::size_t left) const {
    const Tags du;
    return hn::IfThenElseZero(hn::FirstN(du, left), hn::LoadU(du, first));
  }

  /// Orders the tile's splats by their depths about its middle: two passes of a radix sort by the
  /// 16 highest bits in which they differ. The order need not be strict, since bounds tell when
  /// nothing nearer can come.
  void order() {
    const D d;
    const std::size_t count = job_.count;
    scratch_.depth.resize(room_);
    V least = all_lanes(__builtin_inff());
    V most = hn::Zero(d);
    const V middle_x = all_lanes(pixels_.left() + 0.5F * (kGaussianTile - 1));
    const V middle_y = all_lanes(pixels_.top() + 0.5F * (kGaussianTile - 1));
    for (std::size_t i = 0; i < count; i += kLanes) {
      for (std::size_t k = i + 2 * kLanes; k < std::min(i + 3 * kLanes, count); ++k) {
        hwy::Prefetch(job_.splats + job_.order[k]);
        hwy::Prefetch(job_.perspective + job_.order[k]);
      }
      const auto index = splats_from(job_.order + i, count - i);
      const Fields<GaussianSplat> splat(job_.splats, index);
      const V x = hn::Sub(middle_x, splat(offsetof(GaussianSplat, x)));
      const V y = hn::Sub(middle_y, splat(offsetof(GaussianSplat, y)));
      const V t = depth_at(splat, {job_.perspective, index}, x, y);
      const M exists = hn::FirstN(d, count - i);
      least = hn::Min(least, hn::IfThenElse(exists, t, least));
      most = hn::Max(most, hn::IfThenElseZero(exists, t));
      hn::StoreU(t, d, scratch_.depth.data() + i);
    }
    constexpr int kBits = 8;
    constexpr std::size_t kBuckets = std::size_t{1} << kBits;
    const auto low = std::bit_cast<std::uint32_t>(hn::GetLane(hn::MinOfLanes(d, least)));
    const auto high = std::bit_cast<std::uint32_t>(hn::GetLane(hn::MaxOfLanes(d, most)));
    const int shift = std::max(0, static_cast<int>(std::bit_width(high - low)) - 2 * kBits);
    std::uint32_t begin[2][kBuckets] = {};
    scratch_.order.resize(count);
    scratch_.spare.resize(count);
    for (std::size_t i = 0; i < count; ++i) {
      const std::uint32_t key = (std::bit_cast<std::uint32_t>(scratch_.depth[i]) - low) >> shift;
      scratch_.order[i] = {key, job_.order[i]};
      ++begin[0][key % kBuckets];
      ++begin[1][key / kBuckets];
    }
    for (auto& pass : begin) {
      std::uint32_t sum = 0;
      for (std::uint32_t& bucket : pass) {
        const std::uint32_t here = bucket;
        bucket = sum;
        sum += here;
      }
    }
    for (const auto& o : scratch_.order) scratch_.spare[begin[0][o.key % kBuckets]++] = o;
    scratch_.splat.resize(room_);
    for (const auto& o : scratch_.spare) {
      scratch_.splat[begin[1][o.key / kBuckets]++] = o.splat;
    }
    std::fill_n(scratch_.splat.data() + count, kSpare, 0U);
  }

  /// Bounds of a vector of splats within patches.
  class Bounds {
   public:
    HWY_INLINE Bounds(const Fields<GaussianSplat>& splat, const Fields<GaussianPerspective>& p,
                      const TilePixels& pixels)
        : forms_(splat, pixels.left(), pixels.top()),
          z_d_(hn::Mul(splat(offsetof(GaussianSplat, z)), p(offsetof(GaussianPerspective, d)))),
          nearest_(splat(offsetof(GaussianSplat, nearest))),
          dxy_(p(offsetof(GaussianPerspective, dxy))) {
      const V d = p(offsetof(GaussianPerspective, d));
      const V dx = p(offsetof(GaussianPerspective, dx));
      const V dy = p(offsetof(GaussianPerspective, dy));
      const V dxx = p(offsetof(GaussianPerspective, dxx));
      const V dyy = p(offsetof(GaussianPerspective, dyy));
      const V tx = p(offsetof(GaussianPerspective, tx));
      const V ty = p(offsetof(GaussianPerspective, ty));
      spread_ = hn::Mul(all_lanes(kHalf), hn::Add(hn::Abs(tx), hn::Abs(ty)));
      // Second derivatives over a patch.
      const V bend = hn::Mul(all_lanes(kHalf * kHalf), hn::Add(hn::Add(dxx, dyy), hn::Abs(dxy_)));
      for (int k = 0; k < kPatchesAcross; ++k) {
        x_[k] = forms_.to_column(k);
        y_[k] = forms_.to_row(k);
        den_x_[k] = mul_add(mul_add(dxx, x_[k], dx), x_[k], hn::Add(d, bend));
        den_y_[k] = hn::Mul(mul_add(dyy, y_[k], dy), y_[k]);
        slope_x_[k] = mul_add(hn::Add(dxx, dxx), x_[k], dx);
        slope_y_[k] = mul_add(hn::Add(dyy, dyy), y_[k], dy);
        toward_x_[k] = mul_add(tx, x_[k], z_d_);
        toward_y_[k] = hn::Mul(ty, y_[k]);
      }
    }
    /// \param exponent  no kernel has a smaller one within the patch, base 2.
    /// \param depth     no contribution within the patch is nearer.
    /// Returns whether there is any.
    HWY_INLINE M within(int column, int row, V& exponent, V& depth) const {
      const V mixed = hn::Mul(dxy_, y_[row]);
      const V den = mul_add(mixed, x_[column], hn::Add(den_x_[column], den_y_[row]));
      const V slope = hn::Add(hn::Abs(hn::Add(slope_x_[column], mixed)),
                              hn::Abs(mul_add(dxy_, x_[column], slope_y_[row])));
      const V most_den = mul_add(all_lanes(kHalf), slope, den);
      const V toward = hn::Sub(hn::Add(toward_x_[column], toward_y_[row]), spread_);
      const V inv = hn::Div(all_lanes(1 - kNearer), most_den);
      exponent = hn::Mul(forms_.least(column, row), inv);
      const V bound = hn::Mul(toward, inv);
      depth = hn::IfThenElse(hn::Gt(bound, nearest_), bound, nearest_);
      return hn::Gt(most_den, hn::Zero(D()));
    }

   private:
    /// From the middle of a patch to the centres of its outer pixels.
    static constexpr float kHalf = 0.5F * (kPatch - 1);

    LeastForms forms_;
    V z_d_, nearest_, dxy_, spread_;
    V x_[kPatchesAcross], y_[kPatchesAcross];
    V den_x_[kPatchesAcross], den_y_[kPatchesAcross];
    V slope_x_[kPatchesAcross], slope_y_[kPatchesAcross];
    V toward_x_[kPatchesAcross], toward_y_[kPatchesAcross];
  };

  /// Lists the splats by the patches that they meet, in their order.
  void list() {
    const D d;
    const Tags du;
    const std::size_t needed = kPatches * room_;
    if (scratch_.listed.size() < needed) {
      scratch_.listed.resize(needed);
      scratch_.nearest.resize(needed);
      scratch_.excess.resize(needed);
    }
    for (Array<float>* field :
         {&scratch_.red, &scratch_.green, &scratch_.blue, &scratch_.epsilon}) {
      field->resize(room_);
    }
    std::fill_n(count_, kPatches, std::size_t{0});
    for (std::size_t i = 0; i < job_.count; i += kLanes) {
      const auto exists = hn::FirstN(du, job_.count - i);
      const auto index = hn::LoadU(du, scratch_.splat.data() + i);
      const Fields<GaussianSplat> splat(job_.splats, index);
      hn::StoreU(splat(offsetof(GaussianSplat, red)), d, scratch_.red.data() + i);
      hn::StoreU(splat(offsetof(GaussianSplat, green)), d, scratch_.green.data() + i);
      hn::StoreU(splat(offsetof(GaussianSplat, blue)), d, scratch_.blue.data() + i);
      hn::StoreU(splat(offsetof(GaussianSplat, epsilon)), d, scratch_.epsilon.data() + i);
      const auto place = hn::Iota(du, static_cast<std::uint32_t>(i));
      const V cut = splat(offsetof(GaussianSplat, cut));
      const PatchBoxes boxes(job_, splat, exists);
      const Bounds bounds(splat, {job_.perspective, index}, pixels_);
      for (int r = 0; r < kPatchesAcross; ++r) {
        for (int c = 0; c < kPatchesAcross; ++c) {
          V exponent, depth;
          const M any = bounds.within(c, r, exponent, depth);
          const V excess = hn::Sub(exponent, cut);
          const M near = hn::And(any, hn::Le(excess, all_lanes(kSlackOfExcess)));
          const auto patch = static_cast<std::size_t>(r * kPatchesAcross + c);
          const Compressor<Tags> met(hn::And(boxes.met(c, r), hn::RebindMask(du, near)));
          const std::size_t to = patch * room_ + count_[patch];
          met.store(place, du, scratch_.listed.data() + to);
          met.store(depth, d, scratch_.nearest.data() + to);
          met.store(excess, d, scratch_.excess.data() + to);
          count_[patch] += met.count();
        }
      }
    }
  }

  /// Bounds of the depths of a patch's splats from each block of them on.
  void bound_blocks(const float* nearest, std::size_t count) {
    scratch_.bound.resize(count / kBlock + 1);
    float least = __builtin_inff();
    for (std::size_t block = (count + kBlock - 1) / kBlock; block-- > 0;) {
      const std::size_t first = block * kBlock;
      float here = nearest[first];
      for (std::size_t i = first + 1; i < std::min(first + kBlock, count); ++i) {
        here = std::min(here, nearest[i]);
      }
      scratch_.bound[block] = least = std::min(least, here);
    }
  }

  /// Contributions to the pixels of a patch, nearest first in every pixel: rows of depths, alphas
  /// and places of splats.
  class Fragments {
   public:
    explicit Fragments(Array<float>& rows) : rows_(rows) {}

    bool empty() const { return head_ == tail_; }
    const float* first() const { return rows_.data() + head_ * kRow; }
    void drop_first() {
      if (++head_ == tail_) head_ = tail_ = 0;
    }
    /// Makes room for so many rows, which begin() to add().
    void reserve(std::size_t rows) {
      if ((tail_ + rows) * kRow > rows_.size()) rows_.resize(2 * (tail_ + rows) * kRow);
    }
    /// Rows that are not yet in their places.
    float* fresh(std::size_t number) { return rows_.data() + (tail_ + number) * kRow; }
    /// Moves the contributions of the next fresh row to their places.
    HWY_INLINE void sift_in() {
      const D d;
      float* const row = fresh(0);
      for (std::size_t part = 0; part < kParts; ++part) {
        float* at = row + part * kLanes;
        float* const end = rows_.data() + head_ * kRow + part * kLanes;
        V depth = hn::Load(d, at);
        if (at == end || hn::AllFalse(d, hn::Lt(depth, hn::Load(d, at - kRow)))) continue;
        V alpha = hn::Load(d, at + kPatchPixels);
        V place = hn::Load(d, at + 2 * kPatchPixels);
        for (; at > end; at -= kRow) {
          const float* const before = at - kRow;
          const V other = hn::Load(d, before);
          const M nearer = hn::Lt(depth, other);
          if (hn::AllFalse(d, nearer)) break;
          const V other_alpha = hn::Load(d, before + kPatchPixels);
          const V other_place = hn::Load(d, before + 2 * kPatchPixels);
          write(at, hn::Max(depth, other), hn::IfThenElse(nearer, other_alpha, alpha),
                hn::IfThenElse(nearer, other_place, place));
          depth = hn::Min(depth, other);
          alpha = hn::IfThenElse(nearer, alpha, other_alpha);
          place = hn::IfThenElse(nearer, place, other_place);
        }
        write(at, depth, alpha, place);
      }
      ++tail_;
    }
    static HWY_INLINE void write(float* to, V depth, V alpha, V place) {
      const D d;
      hn::Store(depth, d, to);
      hn::Store(alpha, d, to + kPatchPixels);
      hn::Store(place, d, to + 2 * kPatchPixels);
    }

   private:
    static constexpr std::size_t kRow = 3 * kPatchPixels;

    Array<float>& rows_;
    std::size_t head_ = 0;
    std::size_t tail_ = 0;
  };

  /// The sums of a patch, to which contributions are added front to back.
  template <bool kDepth>
  class Blend {
   public:
    Blend(const TilePixels& pixels, const GaussianRayScratch& scratch, const GaussianTile& tile,
          std::size_t patch)
        : scratch_(scratch) {
      for (std::size_t part = 0; part < kParts; ++part) {
        const std::size_t pixel = patch * kPatchPixels + part * kLanes;
        sums_[part] = Sums<kDepth>(tile, pixel);
        const M inside = pixels.in_picture(pixels.column(pixel), pixels.row(pixel));
        live_[part] = hn::IfThenElseZero(inside, all_lanes(1));
      }
    }
    /// Adds a row of fragments.
    HWY_INLINE void add(const float* row) {
      const D d;
      for (std::size_t part = 0; part < kParts; ++part) {
        const Contribution c(scratch_, row + part * kLanes);
        add(part, hn::Gt(c.alpha, hn::Zero(d)), c);
      }
    }
    /// The largest transmittance of pixels that are not complete; 0: all are.
    HWY_INLINE float transmittance() const {
      const D d;
      V most = hn::Zero(d);
      for (std::size_t part = 0; part < kParts; ++part) {
        most = hn::Max(most, hn::Mul(live_[part], sums_[part].transmittance));
      }
      return hn::GetLane(hn::MaxOfLanes(d, most));
    }
    HWY_INLINE void store(GaussianTile& tile, std::size_t patch) const {
      for (std::size_t part = 0; part < kParts; ++part) {
        sums_[part].store(tile, patch * kPatchPixels + part * kLanes);
      }
    }

   protected:
    /// A vector of a row's fragments.
    struct Contribution {
      V depth, alpha, red, green, blue;

      Contribution() = default;
      HWY_INLINE Contribution(const GaussianRayScratch& scratch, const float* from) {
        const D d;
        const auto place = hn::BitCast(Ints(), hn::Load(d, from + 2 * kPatchPixels));
        depth = hn::Load(d, from);
        alpha = hn::Load(d, from + kPatchPixels);
        red = hn::GatherIndex(d, scratch.red.data(), place);
        green = hn::GatherIndex(d, scratch.green.data(), place);
        blue = hn::GatherIndex(d, scratch.blue.data(), place);
      }
    };
    /// Adds contributions to some pixels of a part, if they are not complete.
    HWY_INLINE void add(std::size_t part, M where, const Contribution& c) {
      const D d;
      Sums<kDepth>& sums = sums_[part];
      const V left = neg_mul_add(c.alpha, sums.transmittance, sums.transmittance);
      const M added = hn::And(where, hn::Gt(live_[part], hn::Zero(d)));
      const V weight = hn::IfThenElseZero(added, hn::Mul(c.alpha, sums.transmittance));
      sums.add(added, weight, left, c.red, c.green, c.blue, c.depth);
      live_[part] = hn::IfThenElseZero(hn::Ge(sums.transmittance, all_lanes(kLeastTransmittance)),
                                       live_[part]);
    }

    const GaussianRayScratch& scratch_;
    Sums<kDepth> sums_[kParts];
    V live_[kParts];  ///< 1 where a pixel may take more, else 0.
  };

  /// Contributions whose depths are within their epsilon of one another's mean are a surface: its
  /// colour and depth are their mean (SS01 (6), (9)), and kernels that sum up to 1 cover the pixel.
  /// Surfaces are blended front to back (SS01 (12)).
  template <bool kDepth>
  class SurfaceBlend : public Blend<kDepth> {
   public:
    using Contribution = typename Blend<kDepth>::Contribution;

    SurfaceBlend(const TilePixels& pixels, const GaussianRayScratch& scratch,
                 const GaussianTile& tile, std::size_t patch)
        : Blend<kDepth>(pixels, scratch, tile, patch) {
      for (Contribution& sum : surface_) {
        sum.depth = sum.alpha = sum.red = sum.green = sum.blue = hn::Zero(D());
      }
    }
    HWY_INLINE void add(const float* row) {
      const D d;
      for (std::size_t part = 0; part < kParts; ++part) {
        const float* const from = row + part * kLanes;
        const Contribution c(this->scratch_, from);
        const auto place = hn::BitCast(Ints(), hn::Load(d, from + 2 * kPatchPixels));
        const V epsilon = hn::GatherIndex(d, this->scratch_.epsilon.data(), place);
        Contribution& surface = surface_[part];
        const V behind = mul_sub(c.depth, surface.alpha, surface.depth);
        const M any = hn::Gt(c.alpha, hn::Zero(d));
        const M ends = hn::And(any, hn::Gt(hn::Abs(behind), hn::Mul(epsilon, surface.alpha)));
        if (!hn::AllFalse(d, ends)) close(part, ends);
        surface.depth = mul_add(c.alpha, c.depth, surface.depth);
        surface.red = mul_add(c.alpha, c.red, surface.red);
        surface.green = mul_add(c.alpha, c.green, surface.green);
        surface.blue = mul_add(c.alpha, c.blue, surface.blue);
        surface.alpha = hn::Add(surface.alpha, c.alpha);
      }
    }
    HWY_INLINE void store(GaussianTile& tile, std::size_t patch) {
      const D d;
      for (std::size_t part = 0; part < kParts; ++part) close(part, hn::FirstN(d, kLanes));
      Blend<kDepth>::store(tile, patch);
    }

   private:
    /// Blends the surfaces of some pixels, and opens new ones.
    HWY_INLINE void close(std::size_t part, M where) {
      const D d;
      Contribution& sum = surface_[part];
      const M any = hn::And(where, hn::Gt(sum.alpha, hn::Zero(d)));
      const V inv = hn::Div(all_lanes(1), hn::IfThenElse(any, sum.alpha, all_lanes(1)));
      Contribution mean;
      mean.depth = hn::Mul(sum.depth, inv);
      mean.alpha = hn::Min(sum.alpha, all_lanes(1));
      mean.red = hn::Mul(sum.red, inv);
      mean.green = hn::Mul(sum.green, inv);
      mean.blue = hn::Mul(sum.blue, inv);
      Blend<kDepth>::add(part, any, mean);
      for (V* value : {&sum.depth, &sum.alpha, &sum.red, &sum.green, &sum.blue}) {
        *value = hn::IfThenZeroElse(where, *value);
      }
    }

    Contribution surface_[kParts];  ///< Sums over the surfaces that are not yet complete.
  };

  /// Hands the rows to a blend that are nearer than a bound in all pixels.
  template <class Blender>
  static HWY_INLINE void blend_before(float bound, Fragments& waiting, Blender& blend) {
    const D d;
    while (!waiting.empty()) {
      const float* const row = waiting.first();
      for (std::size_t part = 0; part < kParts; ++part) {
        if (!hn::AllTrue(d, hn::Lt(hn::Load(d, row + part * kLanes), all_lanes(bound)))) return;
      }
      blend.add(row);
      waiting.drop_first();
    }
  }

  /// A binary logarithm, interpolated between powers of two: at most 0.09 too small.
  static float about_log2(float value) {
    const auto bits = std::bit_cast<std::int32_t>(value) - std::bit_cast<std::int32_t>(1.0F);
    return static_cast<float>(bits) * 0x1p-23F;
  }

  /// \tparam Blender  Blend or SurfaceBlend.
  template <class Blender>
  void blend(std::size_t patch) {
    const D d;
    RaySampler samplers[kParts];
    for (std::size_t part = 0; part < kParts; ++part) {
      const std::size_t pixel = patch * kPatchPixels + part * kLanes;
      samplers[part] = RaySampler(*job_.view, pixels_.column(pixel), pixels_.row(pixel));
    }
    Blender blend(pixels_, scratch_, tile_, patch);
    Fragments waiting(scratch_.fragments);
    const std::size_t count = count_[patch];
    const std::uint32_t* const listed = scratch_.listed.data() + patch * room_;
    const float* const excess = scratch_.excess.data() + patch * room_;
    const std::uint32_t* const order = scratch_.splat.data();
    const GaussianSplat* const splats = job_.splats;
    const GaussianPerspective* const perspective = job_.perspective;
    bound_blocks(scratch_.nearest.data() + patch * room_, count);
    for (std::size_t begin = 0; begin < count; begin += kBlock) {
      blend_before(scratch_.bound[begin / kBlock], waiting, blend);
      const float transmittance = blend.transmittance();
      if (!(transmittance > 0)) break;
      // What a kernel that ends there adds to the picture is as little as before all surfaces.
      const float most_excess = kSlackOfExcess + about_log2(transmittance);
      const std::size_t end = std::min(begin + kBlock, count);
      for (std::size_t i = end; i < std::min(end + kBlock, count); ++i) {
        hwy::Prefetch(splats + order[listed[i]]);
        hwy::Prefetch(perspective + order[listed[i]]);
      }
      std::uint32_t chosen[kBlock];
      std::size_t fresh = 0;
      for (std::size_t i = begin; i < end; ++i) {
        chosen[fresh] = listed[i];
        fresh += excess[i] <= most_excess ? 1 : 0;
      }
      // All are evaluated before any is moved, as processors cannot look beyond the branches that
      // moving takes.
      waiting.reserve(fresh);
      for (std::size_t k = 0; k < fresh; ++k) {
        const std::uint32_t splat = order[chosen[k]];
        const V place = hn::BitCast(d, hn::Set(Tags(), chosen[k]));
        for (std::size_t part = 0; part < kParts; ++part) {
          V alpha, depth;
          samplers[part].at(splats[splat], perspective[splat], alpha, depth);
          Fragments::write(waiting.fresh(k) + part * kLanes, depth, alpha, place);
        }
      }
      for (std::size_t k = 0; k < fresh; ++k) waiting.sift_in();
    }
    for (; !waiting.empty(); waiting.drop_first()) blend.add(waiting.first());
    blend.store(tile_, patch);
  }

  const GaussianTileJob& job_;
  GaussianRayScratch& scratch_;
  GaussianTile& tile_;
  TilePixels pixels_;
  std::size_t room_;  ///< For all splats of the tile, and whole vectors.
  std::size_t count_[kPatches];
};

}  // namespace

void draw_gaussian_rays_simd(const GaussianTileJob& job, GaussianRayScratch& scratch,
                             GaussianTile& tile) {
  RayTile raster(job, scratch, tile);
  job.depth ? raster.draw<true>() : raster.draw<false>();
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {

HWY_EXPORT(draw_gaussian_rays_simd);

void draw_gaussian_rays(const GaussianTileJob& job, GaussianRayScratch& scratch,
                        GaussianTile& tile) {
  HWY_DYNAMIC_DISPATCH(draw_gaussian_rays_simd)(job, scratch, tile);
}

}  // namespace surfel
#endif
