// The normal distribution's cumulative function for vectors of floats, with the same bits for every
// instruction set; included once for each target, see Highway's documentation. Abramowitz, Stegun,
// Handbook of Mathematical Functions, 1964: 7.1.28.

#if defined(SURFEL_BASE_NORMAL_CDF_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SURFEL_BASE_NORMAL_CDF_INL_H_
#undef SURFEL_BASE_NORMAL_CDF_INL_H_
#else
#define SURFEL_BASE_NORMAL_CDF_INL_H_
#endif

#include <hwy/highway.h>
#include <surfel/base/fused-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// Phi(z), the normal distribution's cumulative function: within 1e-6 of it for all numbers, and
/// Phi(z) + Phi(-z) = 1 within rounding.
template <class V>
HWY_INLINE V normal_cdf(V z) {
  const hn::DFromV<V> d;
  // 1 / (2 erfc(|z| / sqrt(2))) = p^16 / 2 with a polynomial p of |z|: the coefficients of 7.1.28
  // times powers of sqrt(1/2).
  constexpr float kPolynomial[] = {4.98673471e-02F, 2.11410061e-02F, 3.27762632e-03F,
                                   3.80035750e-05F, 4.88906356e-05F, 5.38297500e-06F};
  const V x = hn::Abs(z);
  V p = hn::Set(d, kPolynomial[5]);
  for (int i = 4; i >= 0; --i) p = mul_add(p, x, hn::Set(d, kPolynomial[i]));
  p = mul_add(p, x, hn::Set(d, 1.0F));
  for (int i = 0; i < 4; ++i) p = hn::Mul(p, p);
  const V tail = hn::Div(hn::Set(d, 0.5F), p);
  return hn::IfThenElse(hn::Lt(z, hn::Zero(d)), tail, hn::Sub(hn::Set(d, 1.0F), tail));
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#endif
