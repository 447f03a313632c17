#include <cmath>
#include <limits>

#include <gtest/gtest.h>
#include <surfel/surface/sheet.h>
#include <surfel/surface/tangent_frame.h>

namespace surfel {
namespace {

TEST(Sheet, RightAnglesAreOneSheetAndSteepOffsetsAreNot) {
  EXPECT_TRUE(same_side(0.0F));
  EXPECT_FALSE(same_side(-1e-6F));
  EXPECT_TRUE(along_sheet(1.0, 1.0));
  EXPECT_FALSE(along_sheet(1.01, 1.0));
}

TEST(SheetRules, DefaultsAreValidAndBadValuesRefused) {
  EXPECT_TRUE(SheetRules{}.problems().empty());
  for (const SheetRules& bad :
       {SheetRules{.normal_angle = 0}, SheetRules{.normal_angle = 91},
        SheetRules{.sheet_weight = 0.5}, SheetRules{.sheet_weight = 1001},
        SheetRules{.sheet_weight = std::numeric_limits<double>::quiet_NaN()}}) {
    EXPECT_EQ(bad.problems().size(), 1U);
  }
  EXPECT_FLOAT_EQ(SheetRules{.normal_angle = 60}.least_cosine(), 0.5F);
}

TEST(TangentFrame, IsOrthonormalAndRightHanded) {
  const Vec3d n = Vec3d(0.3, -0.8, 0.2).normalized();
  const TangentFrame frame = tangent_frame(n);
  EXPECT_LT((frame.a.cross(frame.b) - n).norm(), 1e-15);
  EXPECT_NEAR(frame.a.norm(), 1, 1e-15);
  const Vec3d offset(1, 2, 3);
  EXPECT_LT((frame.lifted(frame.flat(offset)) + frame.height(offset) * n - offset).norm(), 1e-14);
}

TEST(PrincipalAxes, OfARotatedDiagonalMatrixAreItsAxes) {
  for (const double angle : {0.0, 0.4, 1.5, -0.7}) {
    const double c = std::cos(angle);
    const double s = std::sin(angle);
    const PrincipalAxes axes =
        principal_axes(5 * c * c + 2 * s * s, 3 * c * s, 5 * s * s + 2 * c * c);
    EXPECT_NEAR(axes.larger, 5, 1e-14);
    EXPECT_NEAR(axes.smaller, 2, 1e-14);
    EXPECT_NEAR(std::abs(axes.along.dot(Vec2d(c, s))), 1, 1e-14);
  }
  EXPECT_EQ(principal_axes(1, 1, 1).smaller, 0);
}

}  // namespace
}  // namespace surfel
