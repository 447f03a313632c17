// The normal distribution's cumulative function for vectors of floats, with the same bits for every
// instruction set; included once for each target, see Highway's documentation.

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

/// Phi(z), the normal distribution's cumulative function: within 1e-5 of it for |z| < 4 and within
/// 4e-5 for all other numbers, and Phi(z) + Phi(-z) = 1 within rounding. Fifteen instructions, no
/// division.
template <class V>
HWY_INLINE V normal_cdf(V z) {
  const hn::DFromV<V> d;
  // (Phi(z) - 1/2) / z is a polynomial of z^2: the one that interpolates it at Chebyshev's nodes of
  // [0, 16].
  constexpr float kPolynomial[] = {0.398939041F,    -0.0664573931F,  0.00991699387F,
                                   -0.00114901053F, 0.000101978877F, -6.65088957e-6F,
                                   2.95175639e-7F,  -7.83297548e-9F, 9.26824375e-11F};
  const V x = hn::Min(hn::Max(z, hn::Set(d, -4.0F)), hn::Set(d, 4.0F));
  // Estrin's scheme: what follows waits for half as many instructions as by Horner's.
  const V x2 = hn::Mul(x, x);
  const V x4 = hn::Mul(x2, x2);
  const V x8 = hn::Mul(x4, x4);
  const auto pair = [&](int i) HWY_ATTR {
    return mul_add(hn::Set(d, kPolynomial[i + 1]), x2, hn::Set(d, kPolynomial[i]));
  };
  const V low = mul_add(pair(2), x4, pair(0));
  const V high = mul_add(hn::Set(d, kPolynomial[8]), x8, mul_add(pair(6), x4, pair(4)));
  const V p = mul_add(high, x8, low);
  return mul_add(p, x, hn::Set(d, 0.5F));
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#endif
