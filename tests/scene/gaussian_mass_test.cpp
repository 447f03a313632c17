#include <cmath>
#include <numbers>

#include <gtest/gtest.h>
#include <surfel/scene/gaussian_mass.h>

namespace surfel::test {
namespace {

/// The mean over directions, by the middles of a grid with equal areas, of 2 pi times the root of
/// the determinant of the projected variance, which is n' adj(S) n.
double mean_by_directions(const Vec3d& s) {
  constexpr int kSteps = 600;
  double sum = 0;
  for (int i = 0; i < kSteps; ++i) {
    const double z = (i + 0.5) / kSteps;
    for (int k = 0; k < kSteps; ++k) {
      const double angle = (k + 0.5) / kSteps * std::numbers::pi / 2;
      const double r = std::sqrt(1 - z * z);
      const Vec3d n(r * std::cos(angle), r * std::sin(angle), z);
      sum += Vec3d(n[0] * s[1] * s[2], n[1] * s[0] * s[2], n[2] * s[0] * s[1]).norm();
    }
  }
  return 2 * std::numbers::pi * sum / (kSteps * kSteps);
}

TEST(MeanProjection, IsTheMeanOverDirections) {
  for (const Vec3d& s :
       {Vec3d(1, 2, 3), Vec3d(1, 1, 0.01), Vec3d(0.3, 5, 0.2), Vec3d(1, 1, 1.001)}) {
    EXPECT_NEAR(mean_projection(s) / mean_by_directions(s), 1, 1e-5) << s.transpose();
  }
}

TEST(MeanProjection, ClosedForms) {
  EXPECT_NEAR(mean_projection(Vec3d(3, 3, 3)), 2 * std::numbers::pi * 9, 1e-12);
  EXPECT_NEAR(mean_projection(Vec3d(2, 0, 3)), std::numbers::pi * 6, 1e-12);
  // A spheroid, a = b = 1, c = 2: half the surface 2 pi (1 + c^2 / sqrt(c^2 - 1) asin(e) / c).
  const double e = std::sqrt(3.0) / 2;
  EXPECT_NEAR(mean_projection(Vec3d(1, 2, 1)), std::numbers::pi * (1 + 2 / e * std::asin(e)),
              1e-10);
  // The order of the axes and the unit do not matter.
  EXPECT_NEAR(mean_projection(Vec3d(1, 2, 3)), mean_projection(Vec3d(3, 1, 2)), 1e-12);
  EXPECT_NEAR(mean_projection(Vec3d(1e-20, 2e-20, 3e-20)) * 1e40, mean_projection(Vec3d(1, 2, 3)),
              1e-12);
  // A thin ellipsoid is nearly a disc, a needle nearly a cylinder.
  EXPECT_NEAR(mean_projection(Vec3d(1, 1, 1e-10)), std::numbers::pi, 1e-9);
  EXPECT_NEAR(mean_projection(Vec3d(1e8, 1, 1)) / (std::numbers::pi * std::numbers::pi / 2 * 1e8),
              1, 1e-6);
  EXPECT_EQ(mean_projection(Vec3d(0, 0, 0)), 0);
  EXPECT_EQ(mean_projection(Vec3d(1, 0, 0)), 0);
}

TEST(Dilogarithm, KnownValuesAndTheReverse) {
  const double pi2 = std::numbers::pi * std::numbers::pi;
  EXPECT_NEAR(dilogarithm(0.5), pi2 / 12 - std::numbers::ln2 * std::numbers::ln2 / 2, 1e-15);
  EXPECT_EQ(dilogarithm(0), 0);
  for (const double x : {0.0, 1e-6, 0.1, 0.5, 0.51, 0.9, 0.98}) {
    EXPECT_NEAR(opacity_of_dilogarithm(dilogarithm(x), 0.99), x, 1e-10);
  }
  EXPECT_EQ(opacity_of_dilogarithm(1.6, 0.99), 0.99);
  EXPECT_EQ(opacity_of_dilogarithm(100, 0.5), 0.5);
}

}  // namespace
}  // namespace surfel::test
