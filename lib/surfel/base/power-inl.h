// Powers of vectors, alike for every instruction set; included once for each target, see Highway's
// documentation, whose own logarithms and exponentials are not alike.

#if defined(SURFEL_BASE_POWER_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SURFEL_BASE_POWER_INL_H_
#undef SURFEL_BASE_POWER_INL_H_
#else
#define SURFEL_BASE_POWER_INL_H_
#endif

#include <hwy/highway.h>
#include <surfel/base/fused-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// The natural logarithm of positive normal floats, within 1e-7 of it and of 1.
template <class D, class V = hn::Vec<D>>
HWY_INLINE V log_of_floats(D d, V x) {
  const hn::RebindToSigned<D> di;
  // x = m 2^e, with m between the roots of 1/2 and 2.
  const auto root_half = hn::Set(di, 0x3f3504f3);
  const auto bits = hn::BitCast(di, x);
  const auto e = hn::ShiftRight<23>(hn::Sub(bits, root_half));
  const V m = hn::BitCast(d, hn::Sub(bits, hn::ShiftLeft<23>(e)));
  // log(m) = 2 atanh((m - 1) / (m + 1)), by the Taylor series.
  const V one = hn::Set(d, 1.0F);
  const V s = hn::Div(hn::Sub(m, one), hn::Add(m, one));
  const V z = hn::Mul(s, s);
  V tail = hn::Set(d, 2.0F / 9);
  for (const float c : {2.0F / 7, 2.0F / 5, 2.0F / 3}) tail = mul_add(tail, z, hn::Set(d, c));
  const V log_m = mul_add(hn::Mul(s, z), tail, hn::Add(s, s));
  return mul_add(hn::ConvertTo(d, e), hn::Set(d, 0.693147181F), log_m);
}

/// The exponential of floats up to 88, within 1e-6 of it, relatively; 0 below -87.
template <class D, class V = hn::Vec<D>>
HWY_INLINE V exp_of_floats(D d, V x) {
  const hn::RebindToSigned<D> di;
  const V lowest = hn::Set(d, -87.0F);
  const auto inside = hn::Ge(x, lowest);
  const V bounded = hn::Max(x, lowest);
  const V k = hn::Round(hn::Mul(bounded, hn::Set(d, 1.44269504F)));
  // The logarithm of 2 in two parts.
  const V high = neg_mul_add(k, hn::Set(d, 0.693147182F), bounded);
  const V r = mul_add(k, hn::Set(d, 1.90465421e-9F), high);
  V value = hn::Set(d, 1.0F / 5040);
  for (const float c : {1.0F / 720, 1.0F / 120, 1.0F / 24, 1.0F / 6, 0.5F, 1.0F, 1.0F}) {
    value = mul_add(value, r, hn::Set(d, c));
  }
  const auto power = hn::ShiftLeft<23>(hn::Add(hn::ConvertTo(di, k), hn::Set(di, 127)));
  return hn::IfThenElseZero(inside, hn::Mul(value, hn::BitCast(d, power)));
}

/// x to an exponent > 0, of x up to 1; of negative x and 0 it is 0.
template <class D, class V = hn::Vec<D>>
HWY_INLINE V power_of_floats(D d, V x, V exponent) {
  const V least = hn::Set(d, 1.17549435e-38F);
  const auto above = hn::Ge(x, least);
  const V log = log_of_floats(d, hn::IfThenElse(above, x, least));
  return hn::IfThenElseZero(above, exp_of_floats(d, hn::Mul(exponent, log)));
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#endif
