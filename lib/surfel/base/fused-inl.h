// Products and sums that are rounded once, alike for every instruction set; included once for each
// target, see Highway's documentation.
//
// Boldo, Melquiond, "Emulation of FMA and correctly rounded sums: proved algorithms using rounding
// to odd", IEEE Transactions on Computers 57(4), 2008.
// Dekker, "A floating-point technique for extending the available precision", Numerische Mathematik
// 18, 1971.

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

#elif HWY_TARGET == HWY_SCALAR || HWY_TARGET == HWY_EMU128

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

#else

namespace fused {

/// The sum of two numbers, and what rounding took from it (Knuth).
template <class V>
struct ExactSum {
  V sum, rest;

  HWY_INLINE ExactSum(V a, V b) : sum(hn::Add(a, b)) {
    const V from_b = hn::Sub(sum, a);
    rest = hn::Add(hn::Sub(a, hn::Sub(sum, from_b)), hn::Sub(b, from_b));
  }
};

/// a + b, rounded to odd: of a sum that is not exact the neighbour whose last bit is set, so that
/// to round it once more, to fewer bits, is to round the exact sum.
template <class V>
HWY_INLINE V add_to_odd(V a, V b) {
  const hn::DFromV<V> d;
  const hn::RebindToSigned<decltype(d)> di;
  const ExactSum<V> exact(a, b);
  const auto bits = hn::BitCast(di, exact.sum);
  const auto one = hn::Set(di, 1);
  const auto even = hn::Eq(hn::And(bits, one), hn::Zero(di));
  // The rest of a sum that overflows is not a number, which no comparison holds for.
  const auto inexact = hn::Gt(hn::Abs(exact.rest), hn::Zero(d));
  // A rest with the sum's sign leads away from zero, which is one up in the bits.
  const auto step = hn::Or(hn::BroadcastSignBit(hn::Xor(bits, hn::BitCast(di, exact.rest))), one);
  const auto moved = hn::And(even, hn::RebindMask(di, inexact));
  return hn::BitCast(d, hn::Add(bits, hn::IfThenElseZero(moved, step)));
}

/// The product of two numbers, and what rounding took from it (Dekker); true of factors below
/// 2^990 and products above 2^-900.
template <class V>
struct ExactProduct {
  V product, rest;

  HWY_INLINE ExactProduct(V a, V b) : product(hn::Mul(a, b)) {
    const V high_a = high_half(a);
    const V high_b = high_half(b);
    const V low_a = hn::Sub(a, high_a);
    const V low_b = hn::Sub(b, high_b);
    const V first = hn::Sub(product, hn::Mul(high_a, high_b));
    const V second = hn::Sub(first, hn::Mul(low_a, high_b));
    rest = hn::Sub(hn::Mul(low_a, low_b), hn::Sub(second, hn::Mul(high_a, low_b)));
  }

 private:
  static HWY_INLINE V high_half(V x) {
    const V scaled = hn::Mul(x, hn::Set(hn::DFromV<V>(), 134217729.0));  // 2^27 + 1
    return hn::Sub(scaled, hn::Sub(scaled, x));
  }
};

/// a b + c where an intermediate result might be too large or too small for doubles.
template <class V>
HWY_NOINLINE V mul_add_any(V a, V b, V c) {
  const hn::DFromV<V> d;
  constexpr std::size_t kLanes = hn::MaxLanes(hn::DFromV<V>());
  HWY_ALIGN double x[kLanes], y[kLanes], z[kLanes];
  hn::Store(a, d, x);
  hn::Store(b, d, y);
  hn::Store(c, d, z);
  for (std::size_t i = 0; i < kLanes; ++i) z[i] = std::fma(x[i], y[i], z[i]);
  return hn::Load(d, z);
}

template <class D, class V = hn::Vec<D> >
HWY_INLINE V mul_add_doubles(D d, V a, V b, V c) {
  const V zero = hn::Zero(d);
  const ExactProduct<V> ab(a, b);
  const auto below = [&](V x, double bound)
                         HWY_ATTR { return hn::Lt(hn::Abs(x), hn::Set(d, bound)); };
  const auto nothing = hn::Or(hn::Eq(a, zero), hn::Eq(b, zero));
  const auto enough = hn::Or(nothing, hn::Ge(hn::Abs(ab.product), hn::Set(d, 0x1p-900)));
  const auto factors = hn::And(below(a, 0x1p990), below(b, 0x1p990));
  const auto terms = hn::And(below(ab.product, 0x1p1000), below(c, 0x1p1000));
  if (HWY_UNLIKELY(!hn::AllTrue(d, hn::And(enough, hn::And(factors, terms))))) {
    return mul_add_any(a, b, c);
  }
  const ExactSum<V> low(c, ab.rest);
  const ExactSum<V> high(ab.product, low.sum);
  const V sum = hn::Add(high.sum, add_to_odd(low.rest, high.rest));
  // Where the product is zero the plain sum is exact, and a sum of zeros has the right sign.
  return hn::IfThenElse(nothing, hn::Add(ab.product, c), sum);
}

/// Of floats the product is exact in double precision.
template <class D>
HWY_INLINE hn::Vec<D> mul_add_floats(D d, hn::Vec<D> a, hn::Vec<D> b, hn::Vec<D> c) {
  const hn::Rebind<double, D> wide;
  const auto product = hn::Mul(hn::PromoteTo(wide, a), hn::PromoteTo(wide, b));
  return hn::DemoteTo(d, add_to_odd(product, hn::PromoteTo(wide, c)));
}

}  // namespace fused

/// a b + c, rounded once, by operations that round.
template <class V>
HWY_INLINE V mul_add(V a, V b, V c) {
  const hn::DFromV<V> d;
  using D = hn::DFromV<V>;
  if constexpr (sizeof(hn::TFromD<D>) == sizeof(double)) {
    return fused::mul_add_doubles(d, a, b, c);
  } else if constexpr (hn::MaxLanes(D()) * sizeof(double) <= 16) {
    return fused::mul_add_floats(d, a, b, c);
  } else {
    const hn::Half<D> half;
    const auto upper = fused::mul_add_floats(half, hn::UpperHalf(half, a), hn::UpperHalf(half, b),
                                             hn::UpperHalf(half, c));
    const auto lower = fused::mul_add_floats(half, hn::LowerHalf(half, a), hn::LowerHalf(half, b),
                                             hn::LowerHalf(half, c));
    return hn::Combine(d, upper, lower);
  }
}

#endif

#if HWY_TARGET != HWY_AVX2 && HWY_TARGET != HWY_AVX3 && HWY_TARGET != HWY_AVX3_DL

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
