// SS01 section 4 takes the inverse of J^-1; design: why the library does not.

#include <gtest/gtest.h>

#include "render/inverse_jacobian.h"

namespace surfel::test {
namespace {

template <class T>
JacobianErrors direct(double angle) {
  return jacobian_errors<T>(angle,
                            [](const auto& P, const auto& n) { return Sigma_direct<T>(P, n); });
}
template <class T>
JacobianErrors by_inverse(double angle) {
  return jacobian_errors<T>(angle,
                            [](const auto& P, const auto& n) { return Sigma_by_inverse<T>(P, n); });
}

TEST(Jacobian, DirectIsExactAtEveryAngle) {
  for (const double angle : {0.0, 30.0, 60.0, 80.0, 89.0, 89.9, 89.99, 89.999, 89.99999, 90.0}) {
    EXPECT_EQ(direct<float>(angle).failed, 0U) << angle;
    EXPECT_LT(direct<float>(angle).largest, 2e-6) << angle;
    EXPECT_EQ(direct<double>(angle).failed, 0U) << angle;
    EXPECT_LT(direct<double>(angle).largest, 4e-15) << angle;
  }
}

TEST(Jacobian, BothAgreeFarFromGrazing) {
  for (const double angle : {0.0, 30.0, 60.0}) {
    EXPECT_EQ(by_inverse<double>(angle).failed, 0U) << angle;
    EXPECT_LT(by_inverse<double>(angle).largest, 1e-13) << angle;
  }
}

TEST(Jacobian, TheInverseFailsAtGrazingAngles) {
  EXPECT_GT(by_inverse<float>(89.0).largest, 10 * direct<float>(89.0).largest);
  EXPECT_GT(by_inverse<float>(89.99).largest, 300 * direct<float>(89.99).largest);
  EXPECT_GT(by_inverse<float>(89.99999).failed, 0U);
  EXPECT_GT(by_inverse<float>(90.0).failed, by_inverse<float>(90.0).tried / 2);
  EXPECT_GT(by_inverse<double>(90.0).failed, 0U);
}

}  // namespace
}  // namespace surfel::test
