// What the rasters of Gaussians share: the pixels of a tile by patches, sums at a vector of them,
// and bounds of quadratic forms within patches; included once for each target, see Highway's
// documentation.

#if defined(SURFEL_GAUSSIAN_GAUSSIAN_PATCH_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SURFEL_GAUSSIAN_GAUSSIAN_PATCH_INL_H_
#undef SURFEL_GAUSSIAN_GAUSSIAN_PATCH_INL_H_
#else
#define SURFEL_GAUSSIAN_GAUSSIAN_PATCH_INL_H_
#endif

#include <cstddef>
#include <cstdint>

#include <hwy/highway.h>
#include <surfel/base/compress-inl.h>
#include <surfel/base/float_lanes-inl.h>
#include <surfel/base/fused-inl.h>
#include <surfel/gaussian/gaussian_raster.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

static_assert(hn::MaxLanes(D()) <= std::size_t{kGaussianTile});

/// Side of a patch, patches along a tile, patches of a tile, pixels of a patch.
inline constexpr int kPatch = 4;
inline constexpr int kPatchesAcross = kGaussianTile / kPatch;
inline constexpr std::size_t kPatches = std::size_t{kPatchesAcross} * kPatchesAcross;
inline constexpr std::size_t kPatchPixels = std::size_t{kPatch} * kPatch;
/// What a list has more room for than splats: a whole vector is stored at its end.
inline constexpr std::size_t kSpare = 16;

HWY_ALIGN inline constexpr float kColumnOfLane[] = {0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3};
HWY_ALIGN inline constexpr float kRowOfLane[] = {0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3};

/// Pixels whose transmittance would fall below this are complete.
inline constexpr float kLeastTransmittance = 1e-4F;
/// Against the rounding of exponents where patches are chosen.
inline constexpr float kSlack = 1e-3F;
inline constexpr float kLog2e = 1.44269504088896F;

HWY_INLINE V all_lanes(float value) { return hn::Set(D(), value); }

/// 2^x for x above -126, within 3e-7 of it, relatively; anything below.
HWY_INLINE V exp2_of(V x) {
  const D d;
  const Ints di;
  // Adding 1.5 2^23 rounds to a whole number, which is then in the lowest bits.
  const V magic = all_lanes(12582912.0F);
  const V shifted = hn::Add(x, magic);
  const V f = hn::Sub(x, hn::Sub(shifted, magic));
  // Interpolates 2^f at Chebyshev's nodes in [-1/2, 1/2].
  V value = all_lanes(1.33908634e-3F);
  for (const float c : {9.67603192e-3F, 5.55035711e-2F, 0.240221075F, 0.693147188F, 1.0F}) {
    value = mul_add(value, f, all_lanes(c));
  }
  const auto whole = hn::ShiftLeft<23>(hn::BitCast(di, shifted));
  return hn::BitCast(d, hn::Add(hn::BitCast(di, value), whole));
}

/// Where the pixels of a tile lie, in the order of GaussianTile.
class TilePixels {
 public:
  explicit TilePixels(const GaussianTileJob& job)
      : x0_(static_cast<float>(job.x0)),
        y0_(static_cast<float>(job.y0)),
        width_(static_cast<float>(job.view->width)),
        height_(static_cast<float>(job.view->height)) {}

  /// Centre of the tile's first pixel.
  float left() const { return x0_ + 0.5F; }
  float top() const { return y0_ + 0.5F; }
  /// Centres of the vector of pixels that begins with this one of the tile.
  HWY_INLINE V column(std::size_t pixel) const {
    const std::size_t patch = pixel / kPatchPixels;
    const float at = left() + static_cast<float>(patch % kPatchesAcross * kPatch);
    return hn::Add(hn::LoadU(D(), kColumnOfLane + pixel % kPatchPixels), all_lanes(at));
  }
  HWY_INLINE V row(std::size_t pixel) const {
    const std::size_t patch_row = pixel / kPatchPixels / kPatchesAcross;
    const float at = top() + static_cast<float>(patch_row * kPatch);
    return hn::Add(hn::LoadU(D(), kRowOfLane + pixel % kPatchPixels), all_lanes(at));
  }
  HWY_INLINE M in_picture(V x, V y) const {
    return hn::And(hn::Lt(x, all_lanes(width_)), hn::Lt(y, all_lanes(height_)));
  }

 private:
  float x0_, y0_;  ///< The tile's corner.
  float width_, height_;
};

/// Fields of a vector of splats, or of what belongs to them.
template <class Record>
class Fields {
 public:
  HWY_INLINE Fields(const Record* first, hn::Vec<Tags> index)
      : first_(reinterpret_cast<const float*>(first)),
        place_(hn::BitCast(Ints(), hn::ShiftLeft<kShift>(index))) {}
  HWY_INLINE V operator()(std::size_t offset) const {
    return hn::GatherIndex(D(), first_ + offset / sizeof(float), place_);
  }

 private:
  static_assert(sizeof(Record) == 32 || sizeof(Record) == 64);
  static constexpr int kShift = sizeof(Record) == 32 ? 3 : 4;

  const float* first_;
  hn::Vec<Ints> place_;
};

/// The patches of a tile that the boxes of a vector of splats meet.
class PatchBoxes {
 public:
  HWY_INLINE PatchBoxes(const GaussianTileJob& job, const Fields<GaussianSplat>& field,
                        hn::Mask<Tags> exists) {
    const Tags du;
    const Ints di;
    const auto first = hn::BitCast(du, field(offsetof(GaussianSplat, x0)));
    const auto last = hn::BitCast(du, field(offsetof(GaussianSplat, x1)));
    // Patches along an axis, from pixels within the picture.
    const auto patch_of = [&](hn::Vec<Tags> pixel, int origin) HWY_ATTR {
      const auto in_tile = hn::Sub(hn::BitCast(di, pixel), hn::Set(di, origin));
      return hn::ShiftRight<2>(
          hn::Min(hn::Max(in_tile, hn::Set(di, -1)), hn::Set(di, kGaussianTile)));
    };
    const auto low = hn::Set(du, 0xffff);
    const auto left = patch_of(hn::And(first, low), job.x0);
    const auto top = patch_of(hn::ShiftRight<16>(first), job.y0);
    const auto right = patch_of(hn::And(last, low), job.x0);
    const auto bottom = patch_of(hn::ShiftRight<16>(last), job.y0);
    for (int p = 0; p < kPatchesAcross; ++p) {
      const auto before = hn::Set(di, p - 1);
      const auto after = hn::Set(di, p + 1);
      const auto meets = [&](const hn::Vec<Ints>& from, const hn::Vec<Ints>& to) HWY_ATTR {
        return hn::RebindMask(du, hn::And(hn::Lt(from, after), hn::Gt(to, before)));
      };
      columns_[p] = meets(left, right);
      rows_[p] = hn::And(exists, meets(top, bottom));
    }
  }
  HWY_INLINE hn::Mask<Tags> met(int column, int row) const {
    return hn::And(columns_[column], rows_[row]);
  }

 private:
  hn::Mask<Tags> columns_[kPatchesAcross];
  hn::Mask<Tags> rows_[kPatchesAcross];
};

/// The least values of the exponents' quadratic forms of splats within patches. The least value of
/// a quadratic form in a rectangle that its centre is not in lies on a side that faces the centre.
class LeastForms {
 public:
  /// \param left, top  the centre of the tile's first pixel.
  HWY_INLINE LeastForms(const Fields<GaussianSplat>& field, float left, float top)
      : xx_(field(offsetof(GaussianSplat, xx))), yy_(field(offsetof(GaussianSplat, yy))) {
    const V zero = hn::Zero(D());
    const V x = field(offsetof(GaussianSplat, x));
    const V y = field(offsetof(GaussianSplat, y));
    const V xy = field(offsetof(GaussianSplat, xy));
    const V along_y = hn::Div(hn::Mul(all_lanes(-0.5F), xy), yy_);
    const V along_x = hn::Div(hn::Mul(all_lanes(-0.5F), xy), xx_);
    for (int p = 0; p < kPatchesAcross; ++p) {
      const auto at = static_cast<float>(p * kPatch);
      x0_[p] = hn::Sub(all_lanes(left + at), x);
      x1_[p] = hn::Add(x0_[p], all_lanes(kPatch - 1));
      y0_[p] = hn::Sub(all_lanes(top + at), y);
      y1_[p] = hn::Add(y0_[p], all_lanes(kPatch - 1));
      const V nearest_x = hn::Min(hn::Max(zero, x0_[p]), x1_[p]);
      const V nearest_y = hn::Min(hn::Max(zero, y0_[p]), y1_[p]);
      form_x_[p] = hn::Mul(xx_, hn::Mul(nearest_x, nearest_x));
      form_y_[p] = hn::Mul(yy_, hn::Mul(nearest_y, nearest_y));
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
  /// From the splats' centres to the middle of a column or a row of patches, pixels.
  HWY_INLINE V to_column(int column) const { return middle(x0_[column]); }
  HWY_INLINE V to_row(int row) const { return middle(y0_[row]); }

 private:
  static HWY_INLINE V middle(V first) { return hn::Add(first, all_lanes(0.5F * (kPatch - 1))); }

  V xx_, yy_;
  V x0_[kPatchesAcross], x1_[kPatchesAcross], y0_[kPatchesAcross], y1_[kPatchesAcross];
  V form_x_[kPatchesAcross], form_y_[kPatchesAcross];
  V mixed_x_[kPatchesAcross], mixed_y_[kPatchesAcross];
  V best_x_[kPatchesAcross], best_y_[kPatchesAcross];
};

/// Sums at a vector of pixels.
template <bool kDepth>
struct Sums {
  V red, green, blue, transmittance, depth, median;

  HWY_INLINE Sums() = default;
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
      median = hn::IfThenElse(hn::And(where, hn::Gt(transmittance, all_lanes(0.5F))), z, median);
    }
    transmittance = hn::IfThenElse(where, left, transmittance);
  }
};

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#endif
