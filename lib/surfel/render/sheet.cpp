// See sheet.h.

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <numeric>

#include <surfel/render/sheet.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/render/sheet.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <surfel/base/compress-inl.h>
#include <surfel/base/fused-inl.h>
#include <surfel/base/lane_sums-inl.h>
#include <surfel/render/kernel_raster-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {
namespace {

/// Adds the splats of a sheet to a picture whose pixels hold all their sums side by side, so that a
/// splat's few pixels fill vectors, and keeps that patch by patch, as the A-buffer is stored.
/// \tparam kNormals  Pictures are shaded.
template <bool kNormals>
class SheetRaster {
 public:
  SheetRaster(const TileJob& job, const SplatView& view, const SheetSplats& sheet, SheetSums& sums)
      : job_(job),
        sheet_(sheet),
        sums_(sums),
        x0_(view.clip_x0),
        y0_(view.clip_y0),
        end_x_(hn::Set(D(), view.clip_x1)),
        end_y_(hn::Set(D(), view.clip_y1)) {}

  void run() {
    begin_picture();
    draw();
    keep();
  }

 private:
  static constexpr std::size_t kGroup = 4;  ///< Channels that lie together in the picture.
  static constexpr std::size_t kGroups = kNormals ? 3 : 2;
  static constexpr std::size_t kLanes = hn::MaxLanes(D());

  /// Makes an empty picture of the patches that the sheet meets, and room for what kernels'
  /// windows reach beyond.
  void begin_picture() {
    box_ = {255, 255, 0, 0};
    for (std::size_t i = 0; i < sheet_.count; ++i) {
      const PixelBox& b = sheet_.splats[sheet_.members[i]].box;
      box_ = {std::min(box_.x0, b.x0), std::min(box_.y0, b.y0), std::max(box_.x1, b.x1),
              std::max(box_.y1, b.y1)};
    }
    first_x_ = box_.x0 / kStripWidth * kStripWidth;
    first_y_ = box_.y0 / kStripWidth * kStripWidth;
    const auto along = [](int first, int last) {
      return static_cast<std::size_t>((last / kStripWidth + 1) * kStripWidth - first);
    };
    width_ = along(first_x_, box_.x1);
    height_ = along(first_y_, box_.y1);
    pitch_ = width_ + kStripWidth;
    group_size_ = kGroup * pitch_ * (height_ + kStripWidth);
    const std::size_t size = kGroups * group_size_ + kPatchPixels;
    if (sums_.picture.size() < size) sums_.picture.resize(2 * size);
    const std::uintptr_t start = reinterpret_cast<std::uintptr_t>(sums_.picture.data());
    picture_ = sums_.picture.data() + (64 - start % 64) % 64 / sizeof(float);
    std::fill_n(picture_, kGroups * group_size_, 0.0F);
  }

  /// The place in the picture of a pixel of the block; of one beyond the picture it may be
  /// negative.
  std::ptrdiff_t place(int x, int y) const {
    return static_cast<std::ptrdiff_t>(kGroup) *
           ((y - first_y_) * static_cast<std::ptrdiff_t>(pitch_) + (x - first_x_));
  }

  void draw() {
    // Splats that follow one another overlap: each would wait for what the one before has stored.
    constexpr std::size_t kApart = 8;
    const Windows windows(*this);
    FragmentCounter fragments;
    const std::size_t stride = (sheet_.count + kApart - 1) / kApart;
    for (std::size_t first = 0; first < stride; ++first) {
      for (std::size_t i = first; i < sheet_.count; i += stride) {
        const std::uint32_t splat = sheet_.members[i];
        const PixelBox box = sheet_.splats[splat].box;
        int y = box.y0;
        do {
          int x = box.x0;
          do {
            windows.draw(splat, x, y, fragments);
            x += kStripWidth;
          } while (HWY_UNLIKELY(x <= box.x1));
          y += kStripWidth;
        } while (HWY_UNLIKELY(y <= box.y1));
      }
    }
    sums_.fragments += fragments.total();
  }

  /// Adds splats to windows of 4 x 4 pixels. Small, as SplatSampler is.
  class Windows {
   public:
    explicit Windows(const SheetRaster& m)
        : sampler_(m.job_, static_cast<int>(m.x0_), static_cast<int>(m.y0_)),
          splats_(m.job_.splats),
          normals_(m.job_.normals),
          x0_(m.x0_ + 0.5F),
          y0_(m.y0_ + 0.5F),
          end_x_(m.end_x_),
          end_y_(m.end_y_),
          cutoff_(hn::Set(D(), m.job_.rules->cutoff)),
          picture_(m.picture_),
          origin_(m.place(0, 0)),
          pitch_(static_cast<std::ptrdiff_t>(kGroup * m.pitch_)),
          group_size_(m.group_size_) {}

    /// Adds a splat to the pixels from (x, y) of the block on.
    HWY_INLINE void draw(std::uint32_t index, int x, int y, FragmentCounter& fragments) const {
      const D d;
      const Splat& splat = splats_[index];
      float* const window =
          picture_ + (origin_ + y * pitch_ + x * static_cast<std::ptrdiff_t>(kGroup));
      const V left = hn::Set(d, x0_ + static_cast<float>(x));
      const V top = hn::Set(d, y0_ + static_cast<float>(y));
      for (std::size_t v = 0; v < kPatchPixels / kLanes; ++v) {
        const V column = hn::LoadU(d, kColumnOfLane + v * kLanes % kStripWidth);
        const V px = hn::Add(left, column);
        const std::size_t row = v * kLanes / kStripWidth;
        const V py =
            hn::Add(top, hn::Add(hn::Load(d, kRowOfLane), hn::Set(d, static_cast<float>(row))));
        const Sample s = sampler_.uncut_at(index, px, py);
        const M in_block = hn::And(hn::Lt(px, end_x_), hn::Lt(py, end_y_));
        const M inside = hn::And(in_block, hn::Lt(s.beta, cutoff_));
        fragments.add(inside);
        const V rho = hn::IfThenElseZero(inside, hn::Mul(s.amplitude, sampler_.decay(s.beta)));
        const V by_depth = hn::Mul(rho, s.depth);
        for (std::size_t g = 0; g < kGroup; ++g) {
          const auto pixels = hn::SetTableIndices(d, kPixelsOfGroup[g].data());
          const std::size_t first = g * kLanes % kGroup;  // Channel of the first lane.
          const auto is = [&](std::uint32_t channel) HWY_ATTR { return lanes_of(channel, first); };
          const V shape = hn::IfThenElse(is(2), s.epsilon,
                                         hn::IfThenElse(is(3), hn::Zero(d), hn::Set(d, 1.0F)));
          const V weight = hn::TableLookupLanes(rho, pixels);
          const V weight_or_depth =
              hn::IfThenElse(is(1), hn::TableLookupLanes(by_depth, pixels), weight);
          const std::size_t pixel = v * kLanes + g * kLanes / kGroup;
          float* to = window + static_cast<std::ptrdiff_t>(pixel / kStripWidth) * pitch_ +
                      kGroup * (pixel % kStripWidth) + first;
          hn::StoreU(mul_add(weight_or_depth, shape, hn::LoadU(d, to)), d, to);
          to += group_size_;
          hn::StoreU(mul_add(weight, color(splat, first), hn::LoadU(d, to)), d, to);
          if constexpr (kNormals) {
            to += group_size_;
            const SplatNormal& normal = normals_[index];
            const V n =
                hn::IfThenElse(is(0), hn::Set(d, normal.x),
                               hn::IfThenElse(is(1), hn::Set(d, normal.y), hn::Set(d, normal.z)));
            hn::StoreU(mul_add(weight, n, hn::LoadU(d, to)), d, to);
          }
        }
      }
    }

   private:
    /// The colour's channels from `first` on, again and again.
    static HWY_INLINE V color(const Splat& splat, std::size_t first) {
      if constexpr (kLanes >= kGroup) {
        return hn::LoadDup128(D(), &splat.red);
      } else {
        return hn::LoadU(D(), &splat.red + first);
      }
    }

    SplatSampler sampler_;
    const Splat* splats_;
    const SplatNormal* normals_;
    float x0_, y0_;  ///< Centre of the block's first pixel in the picture.
    V end_x_, end_y_, cutoff_;
    float* picture_;
    std::ptrdiff_t origin_;  ///< Place of the block's first pixel.
    std::ptrdiff_t pitch_;
    std::size_t group_size_;
  };

  /// Lanes of a channel of its group, where the first lane has channel `first`.
  static HWY_INLINE M lanes_of(std::uint32_t channel, std::size_t first) {
    const hn::RebindToUnsigned<D> du;
    const auto channels = hn::And(hn::Iota(du, static_cast<std::uint32_t>(first)),
                                  hn::Set(du, static_cast<std::uint32_t>(kGroup - 1)));
    return hn::RebindMask(D(), hn::Eq(channels, hn::Set(du, channel)));
  }

  /// Keeps the picture's patches that are not empty.
  void keep() {
    constexpr int kChannels = kNormals ? kNormalZ + 1 : kTag + 1;
    constexpr std::size_t kSize = kChannels * kPatchPixels;
    const std::size_t most = sums_.used + kSize * (width_ / kStripWidth) * (height_ / kStripWidth);
    if (sums_.sums.size() < most + kPatchPixels) sums_.sums.resize(2 * most + kPatchPixels);
    const D d;
    HWY_ALIGN float pixels[kGroup * kPatchPixels];
    for (int y = first_y_; y <= box_.y1; y += kStripWidth) {
      for (int x = first_x_; x <= box_.x1; x += kStripWidth) {
        const float* const from = picture_ + place(x, y);
        float* const to = sums_.sums.data() + sums_.used;
        const auto transpose = [&](std::size_t group, int c0, int c1, int c2, int c3) HWY_ATTR {
          for (std::size_t row = 0; row < kStripWidth; ++row) {
            std::memcpy(pixels + kGroup * kStripWidth * row,
                        from + group * group_size_ + kGroup * pitch_ * row,
                        sizeof(float) * kGroup * kStripWidth);
          }
          for (std::size_t p = 0; p < kPatchPixels; p += kLanes) {
            V a, b, c, e;
            hn::LoadInterleaved4(d, pixels + kGroup * p, a, b, c, e);
            hn::StoreU(a, d, to + c0 * kPatchPixels + p);
            hn::StoreU(b, d, to + c1 * kPatchPixels + p);
            hn::StoreU(c, d, to + c2 * kPatchPixels + p);
            if (c3 >= 0) hn::StoreU(e, d, to + c3 * kPatchPixels + p);
          }
        };
        transpose(0, kWeight, kDepth, kSheetEpsilon, -1);
        V heaviest = hn::Zero(d);
        for (std::size_t p = 0; p < kPatchPixels; p += kLanes) {
          heaviest = hn::Max(heaviest, hn::LoadU(d, to + kWeight * kPatchPixels + p));
        }
        if (is_zero(heaviest)) continue;
        transpose(1, kRed, kGreen, kBlue, kAlpha);
        if constexpr (kNormals) transpose(2, kNormalX, kNormalY, kNormalZ, -1);
        const int patch = tile_pixel(x % kTileSize, y % kTileSize) / kPatchPixels;
        sums_.patches.push_back({static_cast<std::uint8_t>(x),
                                 static_cast<std::uint8_t>(y),
                                 {sheet_.depth, sheet_.splats[sheet_.members[0]].tag,
                                  static_cast<std::uint32_t>(sums_.used / kPatchPixels),
                                  static_cast<std::uint32_t>(patch)}});
        sums_.used += kSize;
      }
    }
  }

  /// Of the four vectors that hold the channels of a vector of pixels, the pixel of each lane.
  static constexpr auto kPixelsOfGroup = [] {
    std::array<std::array<std::int32_t, kLanes>, kGroup> pixels{};
    for (std::size_t g = 0; g < kGroup; ++g) {
      for (std::size_t lane = 0; lane < kLanes; ++lane) {
        pixels[g][lane] = static_cast<std::int32_t>((g * kLanes + lane) / kGroup);
      }
    }
    return pixels;
  }();

  const TileJob& job_;
  const SheetSplats& sheet_;
  SheetSums& sums_;
  float x0_, y0_;  ///< First pixel of the block in the picture.
  V end_x_, end_y_;
  PixelBox box_{};  ///< Around all splats' boxes.
  int first_x_ = 0, first_y_ = 0;
  std::size_t width_ = 0, height_ = 0, pitch_ = 0, group_size_ = 0;
  float* picture_ = nullptr;
};

}  // namespace

void add_sheet_simd(const TileJob& job, const SplatView& view, const SheetSplats& sheet,
                    SheetSums& sums) {
  job.normals ? SheetRaster<true>(job, view, sheet, sums).run()
              : SheetRaster<false>(job, view, sheet, sums).run();
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {

HWY_EXPORT(add_sheet_simd);

void add_sheet(const FragmentRules& rules, const SplatView& view, const SheetSplats& sheet,
               SheetSums& sums) {
  TileJob job;
  job.rules = &rules;
  job.splats = sheet.splats;
  job.normals = sheet.normals;
  HWY_DYNAMIC_DISPATCH(add_sheet_simd)(job, view, sheet, sums);
}

}  // namespace surfel
#endif
