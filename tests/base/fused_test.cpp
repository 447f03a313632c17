// Kernels of every instruction set compute the same bits.

#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/random.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "base/fused_test.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <surfel/base/fused-inl.h>
#include <surfel/base/lane_sums-inl.h>
#include <surfel/base/normal_cdf-inl.h>
#include <surfel/base/power-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

/// a b + c, a b - c and c - a b of consecutive numbers, whose count is a multiple of 16.
template <class T>
void fuse(const T* a, const T* b, const T* c, std::size_t count, T* sum, T* difference,
          T* negative) {
  const hn::CappedTag<T, 16> d;
  for (std::size_t i = 0; i < count; i += hn::Lanes(d)) {
    const auto x = hn::LoadU(d, a + i);
    const auto y = hn::LoadU(d, b + i);
    const auto z = hn::LoadU(d, c + i);
    hn::StoreU(mul_add(x, y, z), d, sum + i);
    hn::StoreU(mul_sub(x, y, z), d, difference + i);
    hn::StoreU(neg_mul_add(x, y, z), d, negative + i);
  }
}

void fuse_floats(const float* a, const float* b, const float* c, std::size_t count, float* sum,
                 float* difference, float* negative) {
  fuse(a, b, c, count, sum, difference, negative);
}
void fuse_doubles(const double* a, const double* b, const double* c, std::size_t count, double* sum,
                  double* difference, double* negative) {
  fuse(a, b, c, count, sum, difference, negative);
}

/// Powers of consecutive numbers, whose count is a multiple of 16.
void power(const float* x, const float* exponent, std::size_t count, float* out) {
  const hn::CappedTag<float, 16> d;
  for (std::size_t i = 0; i < count; i += hn::Lanes(d)) {
    hn::StoreU(power_of_floats(d, hn::LoadU(d, x + i), hn::LoadU(d, exponent + i)), d, out + i);
  }
}

float total(const float* values, std::size_t count) {
  const hn::CappedTag<float, 16> d;
  LaneSums<decltype(d), 16> sums;
  for (std::size_t i = 0; i < count; i += hn::Lanes(d)) sums.add(i, hn::LoadU(d, values + i));
  return sums.total();
}

void normal(const float* z, std::size_t count, float* result) {
  const hn::CappedTag<float, 16> d;
  for (std::size_t i = 0; i < count; i += hn::Lanes(d)) {
    hn::StoreU(normal_cdf(hn::LoadU(d, z + i)), d, result + i);
  }
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {
namespace {

HWY_EXPORT(fuse_floats);
HWY_EXPORT(fuse_doubles);
HWY_EXPORT(power);
HWY_EXPORT(normal);
HWY_EXPORT(total);

/// Calls test(name) once for each instruction set.
template <class Test>
void for_each_target(const Test& test) {
  int tested = 0;
  for (const std::int64_t target : {HWY_STATIC_TARGET, HWY_AVX2, HWY_AVX3}) {
    if ((hwy::SupportedTargets() & HWY_TARGETS & target) == 0) continue;
    hwy::SetSupportedTargetsForTest(target);
    test(std::string(hwy::TargetName(target)));
    hwy::SetSupportedTargetsForTest(0);
    ++tested;
  }
  EXPECT_GT(tested, 1) << "no instruction set beyond the baseline";
}

template <class T>
struct Terms {
  std::vector<T> a, b, c;

  void add(T x, T y, T z) {
    a.push_back(x);
    b.push_back(y);
    c.push_back(z);
  }
};

/// Numbers whose products and sums are hard to round: random ones of all magnitudes and of near
/// ones, sums that nearly cancel, ties of the last bit, denormal and infinite ones.
template <class T>
Terms<T> hard_terms() {
  using Limits = std::numeric_limits<T>;
  Terms<T> terms;
  std::uint64_t calls = 0;
  const auto uniform = [&](double low, double high) {
    return low + (high - low) * random_uniform(5, calls++);
  };
  const auto number = [&](double range) {
    const double value = std::ldexp(uniform(1, 2), static_cast<int>(uniform(-range, range)));
    return static_cast<T>(uniform(0, 1) < 0.5 ? value : -value);
  };
  const double all = Limits::max_exponent;
  for (int i = 0; i < 20000; ++i) {
    terms.add(number(all), number(all), number(all));
    terms.add(number(3), number(3), number(30));
    const T a = number(all / 2 - 2);
    const T b = number(all / 2 - 2);
    terms.add(a, b, -a * b);
    terms.add(a, b, std::nextafter(-a * b, T(0)));
    // Half of the sum's last bit, more, or less, by a term far below.
    const T tiny = std::ldexp(T(1), -Limits::digits);
    const T odd = 1 + 2 * tiny * std::floor(static_cast<T>(uniform(0, 1e6)));
    const T below = std::ldexp(tiny, -static_cast<int>(uniform(0, 60)));
    terms.add(1 + below, tiny, odd);
    terms.add(1 - below, tiny, odd);
    terms.add(-(1 - below), tiny, odd);
    // Results at the border of denormal numbers, and below.
    const int lowest = Limits::min_exponent;
    terms.add(std::ldexp(a, lowest / 2 - std::ilogb(a)), std::ldexp(b, lowest / 2 - std::ilogb(b)),
              std::ldexp(number(3), lowest - 5));
    terms.add(number(3), std::ldexp(number(3), lowest - Limits::digits / 2),
              std::ldexp(number(3), lowest - Limits::digits / 2));
    // And at the border of infinity.
    terms.add(std::ldexp(number(1), Limits::max_exponent - 3), number(3),
              std::ldexp(number(1), Limits::max_exponent - 3));
  }
  const T special[] = {0,
                       T(-0.0),
                       1,
                       -1,
                       Limits::max(),
                       -Limits::max(),
                       Limits::infinity(),
                       -Limits::infinity(),
                       Limits::quiet_NaN(),
                       Limits::denorm_min(),
                       Limits::min(),
                       Limits::epsilon()};
  for (const T x : special) {
    for (const T y : special) {
      for (const T z : special) terms.add(x, y, z);
    }
  }
  while (terms.a.size() % 16 != 0) terms.add(0, 0, 0);
  return terms;
}

template <class T>
bool same_bits(T a, T b) {
  return (std::isnan(a) && std::isnan(b)) || (a == b && std::signbit(a) == std::signbit(b));
}

template <class T, class Fuse>
void expect_fused(const Fuse& fuse) {
  const Terms<T> terms = hard_terms<T>();
  const std::size_t count = terms.a.size();
  std::vector<T> sum(count), difference(count), negative(count);
  for_each_target([&](const std::string& name) {
    fuse(terms.a.data(), terms.b.data(), terms.c.data(), count, sum.data(), difference.data(),
         negative.data());
    std::size_t wrong = 0;
    for (std::size_t i = 0; i < count; ++i) {
      const T a = terms.a[i], b = terms.b[i], c = terms.c[i];
      if (same_bits(sum[i], std::fma(a, b, c)) && same_bits(difference[i], std::fma(a, b, -c)) &&
          same_bits(negative[i], std::fma(-a, b, c))) {
        continue;
      }
      if (wrong++ == 0) ADD_FAILURE() << name << ": " << a << " * " << b << " + " << c;
    }
    EXPECT_EQ(wrong, 0U) << name;
  });
}

TEST(Fused, FloatsAreRoundedOnce) {
  expect_fused<float>([](auto... arguments) { HWY_DYNAMIC_DISPATCH(fuse_floats)(arguments...); });
}

TEST(Fused, DoublesAreRoundedOnce) {
  expect_fused<double>([](auto... arguments) { HWY_DYNAMIC_DISPATCH(fuse_doubles)(arguments...); });
}

TEST(Power, IsAccurateAndAlikeForEveryInstructionSet) {
  std::vector<float> x, exponent;
  for (std::size_t i = 0; i < 4096; ++i) {
    x.push_back(static_cast<float>(random_uniform(1, i)));
    exponent.push_back(static_cast<float>(std::exp2(12 * random_uniform(2, i) - 2)));
  }
  for (const float special : {0.0F, -1.0F, 1.0F, 1e-40F, 1e-30F, 0.5F, -0.0F, 1e-38F}) {
    x.insert(x.end(), 2, special);
    exponent.insert(exponent.end(), {1.0F, 50.0F});
  }
  std::vector<float> first;
  for_each_target([&](const std::string& name) {
    std::vector<float> result(x.size());
    HWY_DYNAMIC_DISPATCH(power)(x.data(), exponent.data(), x.size(), result.data());
    for (std::size_t i = 0; i < x.size(); ++i) {
      const double truth = x[i] > 0 ? std::pow(static_cast<double>(x[i]), exponent[i]) : 0;
      // The logarithm's rounding error is multiplied by the exponent.
      const double size = truth > 0 ? 1 + std::abs(std::log(truth)) : 1;
      ASSERT_NEAR(result[i], truth, 1e-37 + 4e-7 * size * truth)
          << name << ": " << x[i] << " to " << exponent[i];
    }
    if (first.empty()) first = result;
    for (std::size_t i = 0; i < x.size(); ++i) ASSERT_TRUE(same_bits(result[i], first[i])) << name;
  });
}

TEST(NormalCdf, IsAccurateAndAlikeForEveryInstructionSet) {
  std::vector<float> z;
  for (int i = -2048; i < 2048; ++i) z.push_back(static_cast<float>(i) / 256);
  z.insert(z.end(), {0.0F, 1e-30F, 40.0F, -40.0F, 1e18F, -1e18F, 1e38F, -1e38F});
  z.resize((z.size() + 15) / 16 * 16, 1.0F);
  std::vector<float> first;
  for_each_target([&](const std::string& name) {
    std::vector<float> result(z.size());
    HWY_DYNAMIC_DISPATCH(normal)(z.data(), z.size(), result.data());
    for (std::size_t i = 0; i < z.size(); ++i) {
      ASSERT_NEAR(result[i], std::erfc(-z[i] / std::sqrt(2.0)) / 2,
                  std::abs(z[i]) < 4 ? 1e-5 : 4e-5)
          << name << ": " << z[i];
    }
    if (first.empty()) first = result;
    for (std::size_t i = 0; i < z.size(); ++i) ASSERT_TRUE(same_bits(result[i], first[i])) << name;
  });
}

TEST(LaneSums, HaveOneOrder) {
  std::vector<float> values;
  for (std::size_t i = 0; i < 160; ++i) values.push_back(static_cast<float>(random_uniform(1, i)));
  float parts[16] = {};
  for (std::size_t i = 0; i < values.size(); ++i) parts[i % 16] += values[i];
  for (std::size_t half = 8; half > 0; half /= 2) {
    for (std::size_t i = 0; i < half; ++i) parts[i] += parts[i + half];
  }
  for_each_target([&](const std::string& name) {
    EXPECT_EQ(HWY_DYNAMIC_DISPATCH(total)(values.data(), values.size()), parts[0]) << name;
  });
}

}  // namespace
}  // namespace surfel
#endif
