// The lanes of a mask, one after the other; included once for each target, see Highway's
// documentation.

#if defined(SURFEL_BASE_COMPRESS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SURFEL_BASE_COMPRESS_INL_H_
#undef SURFEL_BASE_COMPRESS_INL_H_
#else
#define SURFEL_BASE_COMPRESS_INL_H_
#endif

#include <array>
#include <cstddef>
#include <cstdint>

#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// hn::Compress() of one mask for several vectors of 32-bit lanes.
///
/// AVX2 has no instruction for it, and Highway's table is not static there: GCC copies its 1 KB to
/// the stack at every call. The table here is static.
template <class D>
class Compressor {
 public:
  HWY_INLINE explicit Compressor(hn::Mask<D> mask)
      : lanes_(lanes(mask)), count_(hn::CountTrue(D(), mask)) {}

  /// Lanes of the mask.
  HWY_INLINE std::size_t count() const { return count_; }

  /// Writes the lanes of the mask, and values of no meaning after them up to a whole vector.
  template <class DV>
  HWY_INLINE void store(hn::Vec<DV> v, DV d, hn::TFromD<DV>* to) const {
    static_assert(sizeof(*to) == sizeof(std::uint32_t));
#if HWY_TARGET == HWY_AVX2
    hn::StoreU(hn::TableLookupLanes(v, hn::IndicesFromVec(d, lanes_)), d, to);
#else
    hn::StoreU(hn::Compress(v, hn::RebindMask(d, lanes_)), d, to);
#endif
  }

 private:
#if HWY_TARGET == HWY_AVX2
  using Lanes = hn::Vec<hn::RebindToUnsigned<D>>;  ///< Numbers of the mask's lanes, lowest first.
  static constexpr std::uint32_t kLaneBits = 4;    ///< Room for the number of a lane.

  /// For every mask of eight lanes the numbers of the lanes that it holds, kLaneBits each, lowest
  /// first.
  static constexpr std::array<std::uint32_t, 256> kLanesOf = [] {
    std::array<std::uint32_t, 256> lanes_of{};
    for (std::uint32_t mask = 0; mask < 256; ++mask) {
      std::uint32_t shift = 0;
      for (std::uint32_t lane = 0; lane < 8; ++lane) {
        if ((mask >> lane & 1) == 0) continue;
        lanes_of[mask] |= lane << shift;
        shift += kLaneBits;
      }
    }
    return lanes_of;
  }();

  static HWY_INLINE Lanes lanes(hn::Mask<D> mask) {
    static_assert(hn::MaxLanes(D()) <= 8);
    const hn::RebindToUnsigned<D> d;
    std::uint8_t bits[8];  // StoreMaskBits() may write eight bytes; the first holds the lanes.
    hn::StoreMaskBits(D(), mask, bits);
    const auto shift = hn::Mul(hn::Iota(d, 0), hn::Set(d, kLaneBits));
    return hn::And(hn::Shr(hn::Set(d, kLanesOf[bits[0]]), shift), hn::Set(d, 7));
  }
#else
  using Lanes = hn::Mask<D>;

  static HWY_INLINE Lanes lanes(hn::Mask<D> mask) { return mask; }
#endif

  Lanes lanes_;
  std::size_t count_;
};

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#endif
