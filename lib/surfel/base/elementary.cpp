// Dekker, "A floating-point technique for extending the available precision", Numerische Mathematik
// 18, 1971: sums and products with their rounding errors.
// Tang, "Table-driven implementation of the exponential function in IEEE floating-point
// arithmetic", ACM TOMS 15(2), 1989, and the same of the logarithm, 16(4), 1990: tables of a
// function, and a short polynomial beside them. Payne, Hanek, "Radian reduction for trigonometric
// functions", ACM SIGNUM Newsletter 18(1), 1983. Chiarella, Reichel, "On the evaluation of
// integrals related to the error function", Mathematics of Computation 22, 1968: erfc by the
// trapezoidal rule.

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>

#include <surfel/base/elementary.h>

namespace surfel::portable {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

/// The sum of two numbers, of which the second is what rounding took from the first.
struct Pair {
  double hi;
  double lo = 0;

  constexpr Pair operator-() const { return {-hi, -lo}; }
};

/// a + b, exactly, of |a| >= |b| or a = 0.
constexpr Pair sum_of_ordered(double a, double b) {
  const double sum = a + b;
  return {sum, b - (sum - a)};
}

/// a + b, exactly.
constexpr Pair sum(double a, double b) {
  const double s = a + b;
  const double from_b = s - a;
  return {s, (a - (s - from_b)) + (b - from_b)};
}

/// a b, exactly, where neither overflow nor underflow is near.
constexpr Pair product(double a, double b) {
  constexpr double kSplit = 134217729;  // 2^27 + 1
  const double high_a = kSplit * a - (kSplit * a - a);
  const double high_b = kSplit * b - (kSplit * b - b);
  const double low_a = a - high_a;
  const double low_b = b - high_b;
  const double p = a * b;
  return {p, low_a * low_b - (((p - high_a * high_b) - low_a * high_b) - high_a * low_b)};
}

constexpr Pair operator+(const Pair& a, const Pair& b) {
  const Pair s = sum(a.hi, b.hi);
  return sum_of_ordered(s.hi, s.lo + (a.lo + b.lo));
}

constexpr Pair operator*(const Pair& a, const Pair& b) {
  const Pair p = product(a.hi, b.hi);
  return sum_of_ordered(p.hi, p.lo + (a.hi * b.lo + a.lo * b.hi));
}

constexpr Pair operator/(const Pair& a, const Pair& b) {
  const double inverse = 1 / b.hi;
  const double q = a.hi * inverse;
  const Pair p = product(q, b.hi);
  return sum_of_ordered(q, (((a.hi - p.hi) - p.lo) + (a.lo - q * b.lo)) * inverse);
}

Pair root(const Pair& v) {
  const double s = std::sqrt(v.hi);
  if (s == 0) return {0};
  const Pair square = product(s, s);
  return sum_of_ordered(s, (((v.hi - square.hi) - square.lo) + v.lo) / (2 * s));
}

/// c[0] + c[1] x + c[2] x^2 and so on.
template <std::size_t kCount>
constexpr double polynomial(double x, const double (&c)[kCount]) {
  double value = c[kCount - 1];
  for (std::size_t i = kCount - 1; i-- > 0;) value = value * x + c[i];
  return value;
}

/// The nearest whole number to |x| < 2^51.
double whole(double x) {
  constexpr double kShift = 0x1.8p52;
  return (x + kShift) - kShift;
}

/// x 2^e, rounded once.
double scaled(double x, int e) {
  const auto power = [](int n) {
    return std::bit_cast<double>(static_cast<std::uint64_t>(n + 1023) << 52U);
  };
  const int half = e / 2;
  return x * power(half) * power(e - half);
}

// ------------------------------------------------------------------ exponential function

constexpr Pair kLog2{0x1.62e42fefa39efp-1, 0x1.abc9e3b39803fp-56};
/// ln 2 again: products of the first with numbers of 17 bits are exact.
constexpr double kLog2High = 0x1.62e42fefa0000p-1;
constexpr double kLog2Low = 0x1.cf79abc9e3b3ap-40;

constexpr int kExpSteps = 64;
/// 2^(i / kExpSteps), by the Taylor series.
constexpr auto kExpTable = [] {
  std::array<Pair, kExpSteps> table{};
  for (int i = 0; i < kExpSteps; ++i) {
    const Pair x = kLog2 * Pair{i / static_cast<double>(kExpSteps)};
    Pair value{1};
    for (int n = 30; n > 0; --n) value = Pair{1} + value * (x / Pair{static_cast<double>(n)});
    table[i] = value;
  }
  return table;
}();

/// exp(x) = 2^exponent (table (1 + rest)).
struct ExpParts {
  int exponent;
  Pair table;
  double rest;  ///< The sum that is added to 1; at most 0.0055.
};

/// Of an x whose exponential is a finite number.
ExpParts exp_parts(const Pair& x) {
  const double k = whole(x.hi * (kExpSteps / kLog2.hi));
  const double high = x.hi - k * (kLog2High / kExpSteps);
  const Pair r = sum_of_ordered(high, -k * (kLog2Low / kExpSteps));
  const double low = r.lo + x.lo;
  const double tail =
      r.hi * r.hi * polynomial(r.hi, {1.0 / 2, 1.0 / 6, 1.0 / 24, 1.0 / 120, 1.0 / 720});
  const auto step = static_cast<int>(k);
  const int entry = step & (kExpSteps - 1);
  return {(step - entry) / kExpSteps, kExpTable[entry], r.hi + (tail + low * (1 + r.hi))};
}

/// exp() of a sum whose parts may be infinite or not a number.
double exp_of(const Pair& x) {
  if (!(x.hi < 710)) return x.hi >= 710 ? kInfinity : x.hi;
  if (x.hi < -746) return 0;
  const ExpParts e = exp_parts(x);
  return scaled(e.table.hi + (e.table.lo + e.table.hi * e.rest), e.exponent);
}

// ------------------------------------------------------------------ logarithm

constexpr int kLogSteps = 128;
constexpr int kLogFirst = 90;  ///< kLogSteps / sqrt(2), rounded down.
constexpr int kLogLast = 182;  ///< kLogSteps sqrt(2), rounded up.
/// log(i / kLogSteps) for i from kLogFirst on: 2 atanh((c - 1) / (c + 1)), by the Taylor series.
constexpr auto kLogTable = [] {
  std::array<Pair, kLogLast - kLogFirst + 1> table{};
  for (int i = kLogFirst; i <= kLogLast; ++i) {
    const Pair t =
        Pair{static_cast<double>(i - kLogSteps)} / Pair{static_cast<double>(i + kLogSteps)};
    const Pair square = t * t;
    Pair value{0};
    for (int n = 51; n > 0; n -= 2) value = Pair{1} / Pair{static_cast<double>(n)} + square * value;
    table[i - kLogFirst] = Pair{2} * t * value;
  }
  return table;
}();

/// The logarithm of a positive finite number; its relative error is below 2^-66.
Pair log_of(double x) {
  int exponent = 0;
  if (x < std::numeric_limits<double>::min()) {
    x *= 0x1p54;
    exponent = -54;
  }
  // The mantissa lies between the roots of 1/2 and 2.
  const auto bits = std::bit_cast<std::uint64_t>(x);
  constexpr auto kRootHalf = std::bit_cast<std::uint64_t>(std::numbers::sqrt2 / 2);
  const auto up = static_cast<std::int64_t>(bits - kRootHalf) >> 52;
  exponent += static_cast<int>(up);
  const auto m = std::bit_cast<double>(bits - (static_cast<std::uint64_t>(up) << 52U));
  const auto entry = static_cast<int>(m * kLogSteps + 0.5);
  // The difference is exact.
  const double c = entry / static_cast<double>(kLogSteps);
  const Pair r = Pair{m - c} / Pair{c};
  const Pair square = product(r.hi, r.hi);
  const double tail =
      r.hi * square.hi *
      polynomial(r.hi, {1.0 / 3, -1.0 / 4, 1.0 / 5, -1.0 / 6, 1.0 / 7, -1.0 / 8, 1.0 / 9});
  const Pair& log_c = kLogTable[entry - kLogFirst];
  const Pair table = sum(exponent * kLog2High, log_c.hi);
  const Pair first = sum(table.hi, r.hi);
  const Pair second = sum(first.hi, -square.hi / 2);
  const double low = ((tail - square.lo / 2) + (r.lo - r.hi * r.lo)) +
                     (exponent * kLog2Low + (log_c.lo + table.lo));
  return sum_of_ordered(second.hi, second.lo + (first.lo + low));
}

/// log(x) times a number.
double scaled_log(double x, const Pair& scale) {
  if (!(x > 0)) return x == 0 ? -kInfinity : kNan;
  if (x == kInfinity) return x;
  const Pair value = log_of(x) * scale;
  return value.hi + value.lo;
}

bool is_whole(double y) { return std::trunc(y) == y; }
bool is_odd(double y) { return is_whole(y) && std::fmod(y, 2) != 0; }

// ------------------------------------------------------------------ trigonometry

constexpr Pair kHalfPi{0x1.921fb54442d18p+0, 0x1.1a62633145c07p-54};
constexpr Pair kPi{2 * kHalfPi.hi, 2 * kHalfPi.lo};

/// An angle as a multiple of a quarter turn, modulo 4, and the rest, at most pi / 4.
struct Angle {
  int quarter;
  Pair rest;
};

/// By the bits of 2 / pi that neither make whole turns nor are lost in rounding.
Angle reduce_large(double x) {
  constexpr std::array<std::uint64_t, 22> kTwoOverPi = {0,
                                                        0,
                                                        0xa2f9836e4e441529,
                                                        0xfc2757d1f534ddc0,
                                                        0xdb6295993c439041,
                                                        0xfe5163abdebbc561,
                                                        0xb7246e3a424dd2e0,
                                                        0x06492eea09d1921c,
                                                        0xfe1deb1cb129a73e,
                                                        0xe88235f52ebb4484,
                                                        0xe99c7026b45f7e41,
                                                        0x3991d639835339f4,
                                                        0x9c845f8bbdf9283b,
                                                        0x1ff897ffde05980f,
                                                        0xef2f118b5a0a6d1f,
                                                        0x6d367ecf27cb09b7,
                                                        0x4f463f669e5fea2d,
                                                        0x7527bac7ebe5f17b,
                                                        0x3d0739f78a5292ea,
                                                        0x6bfb5fb11f8d5d08,
                                                        0x56033046fc7b6bab,
                                                        0};
  const auto bits = std::bit_cast<std::uint64_t>(x);
  const auto exponent = static_cast<int>(bits >> 52U & 2047) - 1075;
  const std::uint64_t mantissa = (bits & ((std::uint64_t{1} << 52U) - 1)) | std::uint64_t{1} << 52U;
  // x is mantissa 2^exponent. Bit i after the point of 2 / pi, times x, is a multiple of 4 up to
  // i = exponent - 2; 192 bits from the next one on make the angle.
  const auto begin = static_cast<unsigned>(exponent - 2 + 128);
  std::uint64_t window[3];
  for (unsigned i = 0; i < 3; ++i) {
    const std::uint64_t* word = &kTwoOverPi[begin / 64 + i];
    const unsigned shift = begin % 64;
    window[i] = shift == 0 ? word[0] : word[0] << shift | word[1] >> (64 - shift);
  }
  // The lowest 192 bits of the product with the mantissa, by halves of words.
  std::array<std::uint64_t, 6> digits{};
  for (int i = 0; i < 6; ++i) {
    const std::uint64_t digit = window[2 - i / 2] >> (i % 2 * 32U) & 0xffffffff;
    const std::uint64_t low = digit * (mantissa & 0xffffffff);
    digits[i] += low & 0xffffffff;
    if (i < 5) digits[i + 1] += low >> 32U;
    const std::uint64_t high = digit * (mantissa >> 32U);
    if (i < 5) digits[i + 1] += high & 0xffffffff;
    if (i < 4) digits[i + 2] += high >> 32U;
  }
  for (int i = 0; i < 5; ++i) {
    digits[i + 1] += digits[i] >> 32U;
    digits[i] &= 0xffffffff;
  }
  digits[5] &= 0xffffffff;
  // The highest two bits are quarters of a turn. A rest above one half is taken from the next one.
  auto quarter = static_cast<int>(digits[5] >> 30U);
  digits[5] &= 0x3fffffff;
  const bool above = digits[5] >= 0x20000000;
  Pair part{above ? -1.0 : 0.0};
  double unit = 0x1p-30;
  for (int i = 5; i >= 0; --i, unit *= 0x1p-32) {
    part = part + Pair{static_cast<double>(digits[i]) * unit};
  }
  if (above) ++quarter;
  const Pair rest = part * kHalfPi;
  const bool negative = x < 0;
  return {(negative ? -quarter : quarter) & 3, negative ? -rest : rest};
}

Angle reduce(double x) {
  constexpr double kLarge = 0x1p20;
  if (std::abs(x) <= std::numbers::pi / 4) return {0, {x}};
  if (!(std::abs(x) < kLarge)) return reduce_large(x);
  // The sum of these parts is pi / 2; products of all parts but the last with whole numbers of
  // 20 bits are exact.
  constexpr double kPart[] = {0x1.921fb54400000p+0, 0x1.0b4611a600000p-34, 0x1.3198a2e000000p-69,
                              0x1.b839a252049c1p-104};
  const double k = whole(x / kHalfPi.hi);
  const Pair first = sum(x - k * kPart[0], -k * kPart[1]);
  const Pair second = sum(first.hi, -k * kPart[2]);
  return {static_cast<int>(k) & 3,
          sum_of_ordered(second.hi, (second.lo + first.lo) - k * kPart[3])};
}

/// Of angles up to pi / 4.
Pair small_sine(const Pair& x) {
  const double z = x.hi * x.hi;
  const double tail =
      x.hi * z *
      polynomial(z, {-1.0 / 6, 1.0 / 120, -1.0 / 5040, 1.0 / 362880, -1.0 / 39916800,
                     1.0 / 6227020800, -1.0 / 1307674368000, 1.0 / 355687428096000});
  return sum_of_ordered(x.hi, tail + x.lo * (1 - z / 2));
}
Pair small_cosine(const Pair& x) {
  const Pair z = product(x.hi, x.hi);
  const double tail =
      z.hi * z.hi *
      polynomial(z.hi, {1.0 / 24, -1.0 / 720, 1.0 / 40320, -1.0 / 3628800, 1.0 / 479001600,
                        -1.0 / 87178291200, 1.0 / 20922789888000, -1.0 / 6402373705728000});
  const Pair s = sum_of_ordered(1, -z.hi / 2);
  return sum_of_ordered(s.hi, tail + ((s.lo - z.lo / 2) - x.hi * x.lo));
}

/// The sine of an angle that is so many quarter turns more.
Pair sine(const Angle& angle, int quarters) {
  const int quarter = (angle.quarter + quarters) & 3;
  const Pair value = (quarter & 1) != 0 ? small_cosine(angle.rest) : small_sine(angle.rest);
  return (quarter & 2) != 0 ? -value : value;
}

constexpr int kAtanSteps = 64;
/// atan(i / kAtanSteps): each adds the angle to its neighbour, of which the Taylor series is short.
constexpr auto kAtanTable = [] {
  std::array<Pair, kAtanSteps + 1> table{};
  for (int i = 1; i <= kAtanSteps; ++i) {
    const Pair t = Pair{static_cast<double>(kAtanSteps)} /
                   Pair{static_cast<double>(kAtanSteps * kAtanSteps + i * (i - 1))};
    const Pair square = t * t;
    Pair value{0};
    for (int n = 21; n > 0; n -= 2) {
      value = Pair{1} / Pair{static_cast<double>(n)} + -(square * value);
    }
    table[i] = table[i - 1] + t * value;
  }
  return table;
}();

/// atan(y / x) of 0 <= y <= x, x > 0.
Pair small_angle(const Pair& y, const Pair& x) {
  const Pair q = y / x;
  // Near zero the series is taken of the quotient itself, so that its relative error stays small.
  const int entry = q.hi < 1.0 / 16 ? 0 : static_cast<int>(q.hi * kAtanSteps + 0.5);
  const double c = entry / static_cast<double>(kAtanSteps);
  Pair t = q;
  if (entry > 0) t = {((q.hi - c) + q.lo) / (1 + c * q.hi)};
  const double z = t.hi * t.hi;
  const double tail =
      t.hi * z * polynomial(z, {-1.0 / 3, 1.0 / 5, -1.0 / 7, 1.0 / 9, -1.0 / 11, 1.0 / 13});
  const Pair s = sum_of_ordered(kAtanTable[entry].hi, t.hi);
  return sum_of_ordered(s.hi, s.lo + (tail + (t.lo + kAtanTable[entry].lo)));
}

/// atan2() of finite numbers, y >= 0 and not both 0.
double angle_of(const Pair& y, Pair x) {
  const bool left = x.hi < 0;
  if (left) x = -x;
  Pair angle = y.hi > x.hi ? kHalfPi + -small_angle(x, y) : small_angle(y, x);
  if (left) angle = kPi + -angle;
  return angle.hi + angle.lo;
}

/// The root of 1 - x^2, of |x| <= 1.
Pair other_side(double x) {
  const Pair square = product(x, x);
  const Pair s = sum_of_ordered(1, -square.hi);
  return root(sum_of_ordered(s.hi, s.lo - square.lo));
}

}  // namespace

double exp(double x) noexcept { return exp_of({x}); }

double expm1(double x) noexcept {
  // Beyond 40 the 1 is lost in rounding, below -40 the exponential is.
  if (!(x <= 40)) return exp(x);
  if (x < -40) return -1;
  const ExpParts e = exp_parts({x});
  // The sum of 1 and the rest has no cancellation where the table's part is 1.
  if (e.exponent == 0 && e.table.hi == 1) return std::abs(x) < 0x1p-54 ? x : e.rest;
  const double high = scaled(e.table.hi, e.exponent);
  const Pair s = sum(high, -1);
  return s.hi + (s.lo + (scaled(e.table.lo, e.exponent) + high * e.rest));
}

double log(double x) noexcept {
  if (!(x > 0 && x < kInfinity)) return scaled_log(x, {1});
  const Pair value = log_of(x);
  return value.hi + value.lo;
}
double log2(double x) noexcept {
  return scaled_log(x, {0x1.71547652b82fep+0, 0x1.777d0ffda0d24p-56});
}
double log10(double x) noexcept {
  return scaled_log(x, {0x1.bcb7b1526e50ep-2, 0x1.95355baaafad3p-57});
}

double pow(double x, double y) noexcept {
  if (y == 0 || x == 1) return 1;
  if (std::isnan(x) || std::isnan(y)) return kNan;
  const double size = std::abs(x);
  const bool grows = (size > 1) == (y > 0);
  if (std::isinf(y)) return size == 1 ? 1 : grows ? kInfinity : 0;
  const double sign = std::signbit(x) && is_odd(y) ? -1 : 1;
  if (x == 0 || std::isinf(x)) return sign * (grows ? kInfinity : 0);
  if (x < 0 && !is_whole(y)) return kNan;
  if (size == 1) return sign;
  // Beyond these, products with logarithms, of 2^-53 to 745, are beyond all exponents or nothing.
  if (std::abs(y) > 0x1p65) return sign * (grows ? kInfinity : 0);
  if (std::abs(y) < 0x1p-65) return 1;
  const Pair log = log_of(size);
  const Pair p = product(log.hi, y);
  return sign * exp_of(sum_of_ordered(p.hi, p.lo + log.lo * y));
}

double tanh(double x) noexcept {
  if (std::abs(x) > 20) return std::copysign(1.0, x);
  const double t = expm1(2 * std::abs(x));
  return std::copysign(t / (t + 2), x);
}

double erfc(double x) noexcept {
  if (!(x == x)) return x;
  const double size = std::abs(x);
  if (size < 0.5) {
    const double z = x * x;
    double sum_of_terms = 0;
    double term = 1;
    for (int n = 0; n < 14; ++n) {
      sum_of_terms += term / (2 * n + 1);
      term *= -z / (n + 1);
    }
    return 1 - 2 * std::numbers::inv_sqrtpi * x * sum_of_terms;
  }
  double value = 0;
  if (size < 28) {
    constexpr double kStep = 0.5;
    constexpr int kTerms = 13;
    // exp(-(n kStep)^2)
    static const auto kWeight = [] {
      std::array<double, kTerms + 1> weight{};
      for (int n = 0; n <= kTerms; ++n) weight[n] = exp(-n * kStep * n * kStep);
      return weight;
    }();
    const Pair square = product(size, size);
    double terms = 0;
    for (int n = kTerms; n > 0; --n) terms += kWeight[n] / (n * kStep * n * kStep + square.hi);
    terms += 0.5 / square.hi;
    value = 2 * kStep / std::numbers::pi * size * exp_of(-square) * terms;
    // The pole of the integrand, where it is near enough.
    if (size < 6) value -= 2 / expm1(2 * std::numbers::pi / kStep * size);
  }
  return x < 0 ? 2 - value : value;
}

double sin(double x) noexcept {
  if (!std::isfinite(x)) return kNan;
  if (std::abs(x) < 0x1p-27) return x;
  const Pair value = sine(reduce(x), 0);
  return value.hi + value.lo;
}

double cos(double x) noexcept {
  if (!std::isfinite(x)) return kNan;
  const Pair value = sine(reduce(x), 1);
  return value.hi + value.lo;
}

double tan(double x) noexcept {
  if (!std::isfinite(x)) return kNan;
  if (std::abs(x) < 0x1p-27) return x;
  const Angle angle = reduce(x);
  const Pair value = sine(angle, 0) / sine(angle, 1);
  return value.hi + value.lo;
}

double asin(double x) noexcept {
  if (!(std::abs(x) <= 1)) return kNan;
  if (std::abs(x) < 0x1p-27) return x;
  return std::copysign(angle_of({std::abs(x)}, other_side(x)), x);
}

double acos(double x) noexcept {
  if (!(std::abs(x) <= 1)) return kNan;
  return angle_of(other_side(x), {x});
}

double atan(double x) noexcept { return atan2(x, 1); }

double atan2(double y, double x) noexcept {
  if (std::isnan(x) || std::isnan(y)) return kNan;
  double up = std::abs(y);
  double along = std::abs(x);
  if (up == 0 && along == 0) return std::copysign(std::signbit(x) ? kPi.hi : 0, y);
  // Infinite numbers are so much larger than others, or alike.
  if (std::isinf(up) || std::isinf(along)) {
    up = std::isinf(up) ? 1 : 0;
    along = std::isinf(along) ? 1 : 0;
  }
  // Products with the larger one must neither overflow nor underflow.
  const double larger = std::max(up, along);
  const double scale = larger > 0x1p900 ? 0x1p-200 : larger < 0x1p-700 ? 0x1p300 : 1;
  return std::copysign(angle_of({up * scale}, {std::copysign(along * scale, x)}), y);
}

double hypot(double x, double y, double z) noexcept {
  if (std::isinf(x) || std::isinf(y) || std::isinf(z)) return kInfinity;
  const double largest = std::max({std::abs(x), std::abs(y), std::abs(z)});
  const double scale = largest > 0x1p400 ? 0x1p-700 : largest < 0x1p-400 ? 0x1p700 : 1;
  const auto square = [&](double side) { return product(side * scale, side * scale); };
  const Pair length = root(square(x) + square(y) + square(z));
  return (length.hi + length.lo) / scale;
}

}  // namespace surfel::portable
