// Splats from vectors to records; included once for each target, see Highway's documentation.

#if defined(SURFEL_RENDER_SPLAT_WRITER_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SURFEL_RENDER_SPLAT_WRITER_INL_H_
#undef SURFEL_RENDER_SPLAT_WRITER_INL_H_
#else
#define SURFEL_RENDER_SPLAT_WRITER_INL_H_
#endif

#include <cstddef>
#include <cstdint>
#include <cstring>

#include <hwy/cache_control.h>
#include <hwy/highway.h>
#include <surfel/base/compress-inl.h>
#include <surfel/base/fused-inl.h>
#include <surfel/render/projected_splats-inl.h>
#include <surfel/render/splat_setup.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {

/// Fetches the columns of a cluster into the caches, a vector at a time.
class Fetcher {
 public:
  explicit Fetcher(const SurfelColumns* surfels) {
    if (!surfels) return;
    const SurfelColumns& s = *surfels;
    for (const float* column :
         {s.x,         s.y,           s.z,           s.normal_x,        s.normal_y,
          s.normal_z,  s.deviation_u, s.deviation_v, s.tangent_x,       s.tangent_y,
          s.tangent_z, s.area,        s.red,         s.green,           s.blue,
          s.alpha,     s.clip[0].x,   s.clip[0].y,   s.clip[0].z,       s.clip[0].distance,
          s.clip[1].x, s.clip[1].y,   s.clip[1].z,   s.clip[1].distance}) {
      if (column) columns_[count_++] = column;
    }
  }
  HWY_INLINE void fetch(int i) const {
    for (int column = 0; column < count_; ++column) hwy::Prefetch(columns_[column] + i);
  }

 private:
  const float* columns_[sizeof(SurfelColumns) / sizeof(const float*)];
  int count_ = 0;
};

/// Writes splats and lists which surfels they are of.
/// \tparam kClips  Some surfels may be cut by half-planes.
template <bool kClips>
class SplatWriter {
 public:
  SplatWriter(const SurfelColumns& in, const SplatView& view, Splat* splats, SplatClip* clips,
              SetUpSplats& out)
      : in_(in),
        splats_(splats),
        clips_(clips),
        out_(out),
        first_column_(view.first_column),
        first_row_(view.first_row),
        filtered_diagonal2_(diagonal2(view, 1)),
        no_diagonal2_(diagonal2(view, 0)),
        spacing_scale_(hn::Div(hn::Set(D(), 1 / (kSpacingStep * kSpacingStep)), no_diagonal2_)) {}

  /// The surfels from i on.
  HWY_INLINE void write(int i, const Projected& s) {
    HWY_ALIGN float quarters[4][4 * kTileSize];
    interleave(i, s, quarters);
    const D d;
    const Ints di;
    HWY_ALIGN std::int32_t taken[kTileSize];
    hn::Store(hn::VecFromMask(di, hn::RebindMask(di, s.classes.visible)), di, taken);
    if constexpr (kClips) {
      if (!hn::AllFalse(d, s.cuts.clipped)) {
        HWY_ALIGN float clips[3][4 * kTileSize];
        interleave(s.cuts, clips);
        put(clips, taken, clips_ + (splats_ - first_splat_));
      }
    }
    splats_ = put(quarters, taken, splats_);
    M first = s.classes.visible;
    if (!first_column_) first = hn::And(first, hn::Ge(s.columns.unclipped, hn::Zero(d)));
    if (!first_row_) first = hn::And(first, hn::Ge(s.rows.unclipped, hn::Zero(d)));
    first_count_ += hn::CountTrue(d, first);
    note(i, s.classes.visible, out_.visible, visible_count_);
    if (!hn::AllFalse(d, s.classes.exact)) note(i, s.classes.exact, out_.exact, exact_count_);
  }

  void finish() const {
    out_.visible_count = visible_count_;
    out_.exact_count = exact_count_;
    out_.first_count = static_cast<int>(first_count_);
  }

 private:
  /// Bytes of four fields that follow one another in a Splat or SplatClip.
  static constexpr std::size_t kQuarter = 4 * sizeof(float);

  /// Puts the records of the lanes that are taken (-1; 0: not) one after the other. Returns where
  /// the next one goes. A member would be read from memory again at every lane, since what is
  /// written might alias it.
  /// \param quarters  of the records of all lanes.
  template <std::size_t kQuarters, class Record>
  static HWY_INLINE Record* put(const float (&quarters)[kQuarters][4 * kTileSize],
                                const std::int32_t* taken, Record* next) {
    static_assert(sizeof(Record) >= kQuarters * kQuarter);
    Record dropped;
    for (std::size_t lane = 0; lane < hn::Lanes(D()); ++lane) {
      // Records that are not taken go where nobody reads.
      auto* const to = reinterpret_cast<std::byte*>(taken[lane] != 0 ? next : &dropped);
      for (std::size_t q = 0; q < kQuarters; ++q) {
        std::memcpy(to + q * kQuarter, quarters[q] + 4 * lane, kQuarter);
      }
      next -= taken[lane];
    }
    return next;
  }

  /// The half-planes of all lanes: the fields of SplatClip, of which the last ones are not used.
  static HWY_INLINE void interleave(const Cuts& c, float (&quarters)[3][4 * kTileSize]) {
    const D d;
    static_assert(offsetof(SplatClip, outward) == 6 * sizeof(float) &&
                  offsetof(SplatClip, joint) == 10 * sizeof(float) &&
                  offsetof(SplatClip, beyond) == 11 * sizeof(float));
    hn::StoreInterleaved4(c.line[0][0], c.line[0][1], c.line[0][2], c.line[1][0], d, quarters[0]);
    hn::StoreInterleaved4(c.line[1][1], c.line[1][2], c.outward[0][0], c.outward[0][1], d,
                          quarters[1]);
    hn::StoreInterleaved4(c.outward[1][0], c.outward[1][1], c.joint, c.beyond, d, quarters[2]);
  }

  /// The splats of all lanes, a quarter of their fields at a time.
  HWY_INLINE void interleave(int i, const Projected& s, float (&quarters)[4][4 * kTileSize]) const {
    const D d;
    const Ints di;
    const hn::RebindToUnsigned<D> du;
    const auto byte_of = [&](V place)
                             HWY_ATTR { return hn::BitCast(du, hn::ConvertTo(di, place)); };
    const auto box =
        hn::Or(hn::Or(byte_of(s.columns.first), hn::ShiftLeft<8>(byte_of(s.rows.first))),
               hn::Or(hn::ShiftLeft<16>(byte_of(s.columns.last)),
                      hn::ShiftLeft<24>(byte_of(s.rows.last))));
    const auto flag = [&](M mask, std::uint32_t bit) HWY_ATTR {
      return hn::IfThenElseZero(hn::RebindMask(du, mask), hn::Set(du, bit));
    };
    const Kernels& k = s.kernels;
    const V diagonal2 = mul_add(k.half_x, k.half_x, hn::Mul(k.half_y, k.half_y));
    const M filtered = hn::Lt(diagonal2, filtered_diagonal2_);
    auto tag = hn::Or3(flag(s.planes.front, kFrontTag), flag(s.planes.grazing, kGrazingTag),
                       hn::Or(flag(filtered, kFilteredTag), spacing_bits(diagonal2)));
    if constexpr (kClips) tag = hn::Or(tag, flag(s.cuts.clipped, kClippedTag));
    // The exponent of the share, rounded up, tells how often it fits twice. The faces of a crease
    // share pixels by their sums only where kernels are no larger than the pixel filter: those of
    // larger splats are one fragment.
    constexpr float kLeast = 1.0F / (1 << kMostEven);
    const V even = hn::IfThenElse(filtered, s.planes.epsilon_share, hn::Set(d, 1));
    const V share = hn::Min(hn::Max(even, hn::Set(d, kLeast)), hn::Set(d, 1));
    const auto below = hn::Sub(hn::BitCast(du, share), hn::Set(du, 1));
    const auto halvings = hn::Sub(hn::Set(du, 126), hn::ShiftRight<23>(below));
    tag = hn::Or(tag, hn::ShiftLeft<kEvenShift>(halvings));
    const V alpha = in_.alpha ? hn::LoadU(d, in_.alpha + i) : hn::Set(d, 1.0F);
    const auto color = [&](const float* column)
                           HWY_ATTR { return hn::Mul(hn::LoadU(d, column + i), alpha); };
    hn::StoreInterleaved4(s.discs.x, s.discs.y, k.m, k.k, d, quarters[0]);
    hn::StoreInterleaved4(k.q, k.amplitude, s.planes.depth, s.planes.depth_dx, d, quarters[1]);
    hn::StoreInterleaved4(s.planes.depth_dy, s.planes.depth_range, hn::BitCast(d, box),
                          color(in_.red), d, quarters[2]);
    hn::StoreInterleaved4(color(in_.green), color(in_.blue), alpha, hn::BitCast(d, tag), d,
                          quarters[3]);
  }

  /// The bits of the tag for the spacing, of kernels by the squared half diagonals of their boxes.
  HWY_INLINE hn::VFromD<hn::RebindToUnsigned<D>> spacing_bits(V diagonal2) const {
    const D d;
    const V variance = hn::Mul(hn::Sub(diagonal2, no_diagonal2_), spacing_scale_);
    const V steps = hn::Sqrt(hn::Max(variance, hn::Zero(d)));
    const V step = hn::Min(steps, hn::Set(d, static_cast<float>(kCoarseStep)));
    return hn::ShiftLeft<kSpacingShift>(
        hn::BitCast(hn::RebindToUnsigned<D>(), hn::ConvertTo(Ints(), step)));
  }

  /// A whole vector fits: there are no more of either list than lanes before.
  static HWY_INLINE void note(int i, M mask, std::int32_t* to, int& noted) {
    const Ints di;
    const Compressor<D> listed(mask);
    listed.store(hn::Iota(di, i), di, to + noted);
    noted += static_cast<int>(listed.count());
  }

  const SurfelColumns& in_;
  Splat* splats_;
  const Splat* first_splat_ = splats_;
  SplatClip* clips_;  ///< Of first_splat_.
  SetUpSplats& out_;
  bool first_column_, first_row_;
  /// The squared half diagonal of the box of a kernel whose surfel has `times` the variance of the
  /// pixel filter.
  static V diagonal2(const SplatView& view, float times) {
    return hn::Set(D(), 4.0F * view.cutoff * (1 + times) * view.lowpass2);
  }

  V filtered_diagonal2_;  ///< Squared diagonal below which a kernel's box is the filter's,
  V no_diagonal2_;        ///< that of the filter alone,
  V spacing_scale_;       ///< and 1 / that of a filter of kSpacingStep deviations.
  int visible_count_ = 0;
  int exact_count_ = 0;
  std::size_t first_count_ = 0;
};

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#endif
