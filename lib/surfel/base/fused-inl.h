// Products and sums that are rounded once, alike for every instruction set; included once for each
// target, see Highway's documentation.

#if defined(SURFEL_BASE_FUSED_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SURFEL_BASE_FUSED_INL_H_
#undef SURFEL_BASE_FUSED_INL_H_
#else
#define SURFEL_BASE_FUSED_INL_H_
#endif

#include <cmath>
#include <cstddef>

#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

#if HWY_TARGET == HWY_AVX2 || HWY_TARGET == HWY_AVX3 || HWY_TARGET == HWY_AVX3_DL

/// a b + c, rounded once. These targets have an instruction for it.
template <class V>
HWY_INLINE V mul_add(V a, V b, V c) {
  return hn::MulAdd(a, b, c);
}
/// a b - c, rounded once.
template <class V>
HWY_INLINE V mul_sub(V a, V b, V c) {
  return hn::MulSub(a, b, c);
}
/// c - a b, rounded once.
template <class V>
HWY_INLINE V neg_mul_add(V a, V b, V c) {
  return hn::NegMulAdd(a, b, c);
}

#else

/// a b + c of every lane by the C library, whose function is exact on every processor.
template <class V>
HWY_INLINE V mul_add(V a, V b, V c) {
  const hn::DFromV<V> d;
  constexpr std::size_t kLanes = hn::MaxLanes(hn::DFromV<V>());
  HWY_ALIGN hn::TFromD<hn::DFromV<V> > x[kLanes], y[kLanes], z[kLanes];
  hn::Store(a, d, x);
  hn::Store(b, d, y);
  hn::Store(c, d, z);
  for (std::size_t i = 0; i < kLanes; ++i) z[i] = std::fma(x[i], y[i], z[i]);
  return hn::Load(d, z);
}

/// a b - c, rounded once.
template <class V>
HWY_INLINE V mul_sub(V a, V b, V c) {
  return mul_add(a, b, hn::Neg(c));
}
/// c - a b, rounded once.
template <class V>
HWY_INLINE V neg_mul_add(V a, V b, V c) {
  return mul_add(hn::Neg(a), b, c);
}

#endif

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#endif
