#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <string>

#include <gtest/gtest.h>
#include <surfel/base/elementary.h>
#include <surfel/base/random.h>
#include <surfel/base/rotation.h>

namespace surfel {
namespace {

constexpr double kInfinite = std::numeric_limits<double>::infinity();
constexpr double kNotANumber = std::numeric_limits<double>::quiet_NaN();

using Function = std::function<double(double)>;
using Exact = std::function<long double(long double)>;

/// |value - truth| in units in the last place of a double.
double error_ulp(double value, long double truth) {
  const auto rounded = static_cast<double>(truth);
  if (std::isnan(value) || std::isnan(rounded)) {
    return std::isnan(value) && std::isnan(rounded) ? 0 : kInfinite;
  }
  if (std::isinf(value) || std::isinf(rounded)) return value == rounded ? 0 : kInfinite;
  int exponent = 0;
  std::frexp(rounded, &exponent);
  const double ulp = std::ldexp(1.0, std::max(exponent - 53, -1074));
  return static_cast<double>(std::fabs((value - truth) / static_cast<long double>(ulp)));
}

constexpr std::size_t kSamples = 20000;

/// Largest error of arguments spread evenly from `low` to `high`.
double worst_between(double low, double high, const Function& f, const Exact& exact) {
  double worst = 0;
  for (std::size_t i = 0; i < kSamples; ++i) {
    const double x = low + (high - low) * random_uniform(1, i);
    worst = std::max(worst, error_ulp(f(x), exact(x)));
  }
  return worst;
}

/// Largest error of arguments of both signs whose logarithms are spread evenly from 2^low to
/// 2^high.
double worst_magnitudes(double low, double high, const Function& f, const Exact& exact) {
  double worst = 0;
  for (std::size_t i = 0; i < kSamples; ++i) {
    const double exponent = low + (high - low) * random_uniform(2, i);
    const double x = (i % 2 == 0 ? 1 : -1) * std::exp2(exponent);
    worst = std::max(worst, error_ulp(f(x), exact(x)));
  }
  return worst;
}

#define SURFEL_PAIR(name) \
  [](double x) { return portable::name(x); }, [](long double x) { return std::name(x); }

TEST(Elementary, ExponentialIsAccurate) {
  EXPECT_LT(worst_between(-708, 710, SURFEL_PAIR(exp)), 0.53);
  EXPECT_LT(worst_between(-1, 1, SURFEL_PAIR(exp)), 0.53);
  EXPECT_LT(worst_between(-746, -708, SURFEL_PAIR(exp)), 1.03);
  EXPECT_LT(worst_magnitudes(-1074, 0, SURFEL_PAIR(exp)), 0.53);
  EXPECT_LT(worst_between(-41, 710, SURFEL_PAIR(expm1)), 1.5);
  EXPECT_LT(worst_between(-0.1, 0.1, SURFEL_PAIR(expm1)), 1.5);
  EXPECT_LT(worst_magnitudes(-1074, 9, SURFEL_PAIR(expm1)), 1.5);
}

TEST(Elementary, LogarithmIsAccurate) {
  EXPECT_LT(worst_magnitudes(-1074, 1023.9, SURFEL_PAIR(log)), 0.53);
  EXPECT_LT(worst_between(0.5, 2, SURFEL_PAIR(log)), 0.53);
  EXPECT_LT(worst_between(0.99, 1.01, SURFEL_PAIR(log)), 0.53);
  EXPECT_LT(worst_magnitudes(-1074, 1023.9, SURFEL_PAIR(log2)), 0.53);
  EXPECT_LT(worst_between(0.9, 1.1, SURFEL_PAIR(log2)), 0.53);
  EXPECT_LT(worst_magnitudes(-1074, 1023.9, SURFEL_PAIR(log10)), 0.53);
  EXPECT_LT(worst_between(0.9, 1.1, SURFEL_PAIR(log10)), 0.53);
}

TEST(Elementary, LogarithmsOfPowersAreExact) {
  for (int i = -1074; i < 1024; ++i) EXPECT_EQ(portable::log2(std::ldexp(1.0, i)), i);
  double power = 1;  // Exact up to 10^22.
  for (int i = 0; i <= 22; ++i, power *= 10) EXPECT_EQ(portable::log10(power), i);
}

TEST(Elementary, PowerIsAccurate) {
  for (const double y : {2.4, 1 / 2.4, -0.7, 1e-3, 17.0}) {
    const Function f = [&](double x) { return portable::pow(std::fabs(x), y); };
    const Exact exact = [&](long double x) {
      return std::pow(std::fabs(x), static_cast<long double>(y));
    };
    EXPECT_LT(worst_between(0, 1, f, exact), 0.53) << y;
    EXPECT_LT(worst_magnitudes(-50, 50, f, exact), 0.53) << y;
  }
  // Large exponents make the most of errors of the logarithm.
  const double near_one = 1.0009765625;
  EXPECT_LT(worst_between(
                -725000, 727000, [&](double y) { return portable::pow(near_one, y); },
                [&](long double y) { return std::pow(static_cast<long double>(near_one), y); }),
            0.53);
}

TEST(Elementary, TrigonometryIsAccurate) {
  // The last two reach all numbers, also numbers whose whole turns take a thousand bits of pi.
  for (const double high : {0.7, 4.0, 1e6}) {
    EXPECT_LT(worst_between(-high, high, SURFEL_PAIR(sin)), 0.8) << high;
    EXPECT_LT(worst_between(-high, high, SURFEL_PAIR(cos)), 0.8) << high;
    EXPECT_LT(worst_between(-high, high, SURFEL_PAIR(tan)), 0.9) << high;
  }
  EXPECT_LT(worst_magnitudes(-1074, 1023.9, SURFEL_PAIR(sin)), 0.8);
  EXPECT_LT(worst_magnitudes(-1074, 1023.9, SURFEL_PAIR(cos)), 0.8);
  EXPECT_LT(worst_magnitudes(-1074, 1023.9, SURFEL_PAIR(tan)), 0.9);
  // The double nearest to a multiple of pi / 2, relatively.
  const double hard = 6381956970095103.0 * 0x1p797;
  EXPECT_LT(error_ulp(portable::cos(hard), std::cos(static_cast<long double>(hard))), 0.8);
}

TEST(Elementary, InverseTrigonometryIsAccurate) {
  EXPECT_LT(worst_between(-1, 1, SURFEL_PAIR(asin)), 0.7);
  EXPECT_LT(worst_between(-1, 1, SURFEL_PAIR(acos)), 0.7);
  EXPECT_LT(worst_magnitudes(-1074, 0, SURFEL_PAIR(asin)), 0.7);
  EXPECT_LT(worst_between(1 - 1e-9, 1, SURFEL_PAIR(acos)), 0.7);
  EXPECT_LT(worst_between(-5, 5, SURFEL_PAIR(atan)), 0.7);
  EXPECT_LT(worst_magnitudes(-1020, 1023.9, SURFEL_PAIR(atan)), 0.7);
  for (const double x : {-0.3, 1e-300, -1e300, 5.0}) {
    EXPECT_LT(worst_magnitudes(
                  -1000, 1000, [&](double y) { return portable::atan2(y, x); },
                  [&](long double y) { return std::atan2(y, static_cast<long double>(x)); }),
              1.2)
        << x;
  }
}

TEST(Elementary, OtherFunctionsAreAccurate) {
  EXPECT_LT(worst_between(-21, 21, SURFEL_PAIR(tanh)), 3);
  EXPECT_LT(worst_magnitudes(-1074, 5, SURFEL_PAIR(tanh)), 3);
  EXPECT_LT(worst_between(-7, 26, SURFEL_PAIR(erfc)), 5);
  EXPECT_LT(worst_between(-1, 1, SURFEL_PAIR(erfc)), 5);
  for (const double y : {0.7, 1e-310, 1e308}) {
    EXPECT_LT(worst_magnitudes(
                  -1074, 1022, [&](double x) { return portable::hypot(x, y); },
                  [&](long double x) { return std::hypot(x, static_cast<long double>(y)); }),
              1.1)
        << y;
  }
  EXPECT_EQ(portable::hypot(2.0, 3.0, 6.0), 7);
}

TEST(Elementary, SpecialValuesAreTheStandards) {
  const double values[] = {0.0,  -0.0, 1.0,   -1.0,      0.5,        -2.5,        3.0,
                           -3.0, 4.0,  1e300, kInfinite, -kInfinite, kNotANumber, -1e-300};
  const auto same = [](double a, double b) {
    return (std::isnan(a) && std::isnan(b)) || (a == b && std::signbit(a) == std::signbit(b));
  };
  for (const double x : values) {
    for (const double y : values) {
      const bool exact = std::abs(x) <= 1 || !std::isfinite(x) || y == 0 || !std::isfinite(y);
      if (exact && std::abs(x) != 0.5) {
        EXPECT_TRUE(same(portable::pow(x, y), std::pow(x, y))) << x << " to " << y;
      }
      if (x == 0 || y == 0 || !std::isfinite(x) || !std::isfinite(y)) {
        EXPECT_TRUE(same(portable::atan2(y, x), std::atan2(y, x))) << y << ", " << x;
        EXPECT_TRUE(same(portable::hypot(x, y),
                         std::isnan(x) && !std::isinf(y) ? kNotANumber : std::hypot(x, y)))
            << x << ", " << y;
      }
    }
  }
  for (const double x : {0.0, -0.0, kInfinite, -kInfinite, kNotANumber}) {
    EXPECT_TRUE(same(portable::exp(x), std::exp(x))) << x;
    EXPECT_TRUE(same(portable::expm1(x), std::expm1(x))) << x;
    EXPECT_TRUE(same(portable::tanh(x), std::tanh(x))) << x;
    EXPECT_TRUE(same(portable::erfc(x), std::erfc(x))) << x;
    EXPECT_TRUE(same(portable::sin(x), std::sin(x)) || std::isinf(x)) << x;
    EXPECT_TRUE(same(portable::tan(x), std::tan(x)) || std::isinf(x)) << x;
    EXPECT_TRUE(same(portable::atan(x), std::atan(x))) << x;
  }
  for (const double x : {kInfinite, -kInfinite, kNotANumber}) {
    EXPECT_TRUE(std::isnan(portable::sin(x)) && std::isnan(portable::cos(x)) &&
                std::isnan(portable::tan(x)));
    EXPECT_TRUE(std::isnan(portable::asin(x)) && std::isnan(portable::acos(x)));
  }
  EXPECT_EQ(portable::log(0.0), -kInfinite);
  EXPECT_EQ(portable::log(kInfinite), kInfinite);
  EXPECT_TRUE(std::isnan(portable::log(-1.0)) && std::isnan(portable::log(kNotANumber)));
  EXPECT_EQ(portable::acos(1.0), 0);
  EXPECT_EQ(portable::acos(-1.0), std::acos(-1.0));
  EXPECT_EQ(portable::exp(1000.0), kInfinite);
  EXPECT_EQ(portable::exp(-1000.0), 0);
}

TEST(Elementary, FloatsAreNearlyAlwaysRoundedCorrectly) {
  int wrong = 0;
  for (std::size_t i = 0; i < kSamples; ++i) {
    const auto x = static_cast<float>(random_uniform(3, i));
    if (portable::exp(-x) != static_cast<float>(std::exp(static_cast<long double>(-x)))) ++wrong;
    if (portable::acos(x) != static_cast<float>(std::acos(static_cast<long double>(x)))) ++wrong;
  }
  EXPECT_EQ(wrong, 0);
}

TEST(Rotation, IsEigens) {
  const Vec3d axis = Vec3d(1, -2, 3).normalized();
  for (const double angle : {0.0, 0.3, -1.2, 3.1}) {
    const Quaternion ours = rotation_about(axis, angle);
    const Eigen::Matrix3d expected = Eigen::AngleAxisd(angle, axis).toRotationMatrix();
    EXPECT_LT((ours.matrix() - expected).norm(), 1e-15);
    EXPECT_NEAR(rotation_angle(ours), std::abs(angle), 1e-15);
  }
}

}  // namespace
}  // namespace surfel
