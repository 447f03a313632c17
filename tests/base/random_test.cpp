#include <array>
#include <cmath>
#include <set>

#include <gtest/gtest.h>
#include <surfel/base/random.h>

namespace surfel {
namespace {

constexpr int kCount = 100000;

// Five standard deviations: a sound generator fails one such comparison in two million.
constexpr double kSigmas = 5;

TEST(Random, IsUniform) {
  constexpr int kBins = 64;
  std::array<int, kBins> bins{};
  double sum = 0;
  for (int i = 0; i < kCount; ++i) {
    const double u = random_uniform(42, i);
    ASSERT_GE(u, 0);
    ASSERT_LT(u, 1);
    ++bins[static_cast<std::size_t>(u * kBins)];
    sum += u;
  }
  EXPECT_NEAR(sum / kCount, 0.5, kSigmas / std::sqrt(12.0 * kCount));
  double chi_squared = 0;
  const double expected = static_cast<double>(kCount) / kBins;
  for (const int count : bins) chi_squared += (count - expected) * (count - expected) / expected;
  EXPECT_NEAR(chi_squared, kBins - 1, kSigmas * std::sqrt(2.0 * (kBins - 1)));
}

/// Correlation coefficient of two sequences of uniform numbers.
template <class A, class B>
double correlation(A a, B b) {
  double sum = 0;
  for (int i = 0; i < kCount; ++i) sum += (a(i) - 0.5) * (b(i) - 0.5);
  return 12 * sum / kCount;
}

TEST(Random, NeighboursInIndexDimensionAndSeedAreUncorrelated) {
  const double limit = kSigmas / std::sqrt(kCount);
  const auto base = [](int i) { return random_uniform(7, i); };
  EXPECT_NEAR(correlation(base, base), 1, 0.05);
  EXPECT_NEAR(correlation(base, [](int i) { return random_uniform(7, i + 1); }), 0, limit);
  EXPECT_NEAR(correlation(base, [](int i) { return random_uniform(7, i, 1); }), 0, limit);
  EXPECT_NEAR(correlation(base, [](int i) { return random_uniform(8, i); }), 0, limit);
}

TEST(Random, EveryBitIsAFairCoin) {
  std::array<int, 64> ones{};
  for (int i = 0; i < kCount; ++i) {
    const std::uint64_t bits = random_bits(3, i, 2);
    for (int b = 0; b < 64; ++b) ones[b] += static_cast<int>(bits >> b & 1);
  }
  for (int b = 0; b < 64; ++b) {
    EXPECT_NEAR(ones[b], kCount / 2.0, kSigmas * std::sqrt(kCount) / 2) << "bit " << b;
  }
}

TEST(Random, IsTheSameEverywhere) {
  // Samples made on one machine must be made again on another: these values never change.
  // They were worked out apart, from the paper's constants.
  EXPECT_EQ(random_bits(0, 0), 12035550249420947055ULL);
  EXPECT_EQ(random_bits(1, 2, 3), 1072907043932612987ULL);
}

TEST(Random, SmallCountersDoNotCollide) {
  std::set<std::uint64_t> seen;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    for (std::uint64_t index = 0; index < 20; ++index) {
      for (std::uint64_t dimension = 0; dimension < 20; ++dimension) {
        seen.insert(random_bits(seed, index, dimension));
      }
    }
  }
  EXPECT_EQ(seen.size(), 20 * 20 * 20);
}

}  // namespace
}  // namespace surfel
