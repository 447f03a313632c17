#include <gtest/gtest.h>
#include <surfel/base/random.h>
#include <surfel/sample/noise.h>

namespace surfel {
namespace {

TEST(GradientNoise, DerivativeMatchesFiniteDifferences) {
  constexpr double kStep = 1e-5;
  for (std::uint64_t i = 0; i < 200; ++i) {
    const Eigen::Vector3d p(20 * random_uniform(1, i, 0) - 10, 20 * random_uniform(1, i, 1) - 10,
                            20 * random_uniform(1, i, 2) - 10);
    const NoiseValue<3> noise = fractal_noise<3>(p, {3, 0.7, 0.5}, 5);
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d step = kStep * Eigen::Vector3d::Unit(k);
      const double difference = (fractal_noise<3>(p + step, {3, 0.7, 0.5}, 5).value -
                                 fractal_noise<3>(p - step, {3, 0.7, 0.5}, 5).value) /
                                (2 * kStep);
      EXPECT_NEAR(noise.gradient[k], difference, 1e-6);
    }
  }
}

TEST(GradientNoise, ValueIsTheSameWithoutTheDerivative) {
  for (std::uint64_t i = 0; i < 200; ++i) {
    const Eigen::Vector2d p(20 * random_uniform(1, i, 0) - 10, 20 * random_uniform(1, i, 1) - 10);
    const NoiseValue<2> alone = fractal_noise<2, false>(p, {3, 0.7, 0.5}, 5);
    EXPECT_EQ(alone.value, fractal_noise<2>(p, {3, 0.7, 0.5}, 5).value);
    EXPECT_TRUE(alone.gradient.isZero(0));
  }
}

TEST(GradientNoise, VariesWithSeedAndVanishesOnTheLattice) {
  EXPECT_EQ(gradient_noise<2>({3, -4}, 1).value, 0);
  EXPECT_NE(gradient_noise<2>({0.3, 0.4}, 1).value, gradient_noise<2>({0.3, 0.4}, 2).value);
}

}  // namespace
}  // namespace surfel
