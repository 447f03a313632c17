// Sums of vectors whose order does not depend on the width of the vectors; included once for each
// target, see Highway's documentation.

#if defined(SURFEL_BASE_LANE_SUMS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SURFEL_BASE_LANE_SUMS_INL_H_
#undef SURFEL_BASE_LANE_SUMS_INL_H_
#else
#define SURFEL_BASE_LANE_SUMS_INL_H_
#endif

#include <cstddef>

#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// v[0] + v[n / 2], v[1] + v[n / 2 + 1] and so on, in turn to one number.
template <class D>
HWY_INLINE hn::TFromD<D> sum_of_halves(D, hn::Vec<D> v) {
#if HWY_TARGET != HWY_SCALAR  // Which has no halves.
  if constexpr (hn::MaxLanes(D()) > 1) {
    const hn::Half<D> half;
    return sum_of_halves(half, hn::Add(hn::LowerHalf(half, v), hn::UpperHalf(half, v)));
  } else
#endif
  {
    return hn::GetLane(v);
  }
}

/// `kWidth` sums side by side, of the values whose places are equal modulo kWidth, however many
/// lanes of D make them.
template <class D, std::size_t kWidth>
class LaneSums {
 public:
  HWY_INLINE LaneSums() {
    for (auto& part : parts_) part = hn::Zero(D());
  }

  /// Adds the values of the places from `first` on, a multiple of D's lanes.
  HWY_INLINE void add(std::size_t first, hn::Vec<D> v) {
    hn::Vec<D>& part = parts_[first % kWidth / hn::MaxLanes(D())];
    part = hn::Add(part, v);
  }

  HWY_INLINE hn::TFromD<D> total() const {
    hn::Vec<D> left[kParts];
    for (std::size_t i = 0; i < kParts; ++i) left[i] = parts_[i];
    for (std::size_t count = kParts / 2; count > 0; count /= 2) {
      for (std::size_t i = 0; i < count; ++i) left[i] = hn::Add(left[i], left[i + count]);
    }
    return sum_of_halves(D(), left[0]);
  }

 private:
  static_assert(kWidth % hn::MaxLanes(D()) == 0);
  static constexpr std::size_t kParts = kWidth / hn::MaxLanes(D());
  hn::Vec<D> parts_[kParts];
};

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#endif
