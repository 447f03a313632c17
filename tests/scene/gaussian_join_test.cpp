#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/scene/gaussian_join.h>

namespace surfel::test {
namespace {

const std::vector<std::string> kNames{"a.ply", "b.ply"};

GaussianCloud one(const Vec3d& origin, int degree, float value) {
  GaussianCloud cloud;
  cloud.origin = origin;
  cloud.degree = degree;
  cloud.position = {Vec3f(value, 0, 0)};
  cloud.scale = {Vec3f::Constant(value)};
  cloud.rotation = {{1, 0, 0, 0}};
  cloud.amplitude = {value};
  cloud.harmonics.assign(cloud.harmonics_stride(), value);
  return cloud;
}

TEST(GaussianJoin, HasTheHighestDegreeAndOneOrigin) {
  GaussianCloud a = one({1000000, 0, 0}, 0, 1);
  GaussianCloud b = one({1000010, 0, 0}, 1, 2);
  a.unusable_skipped = 3;
  b.unusable_skipped = 4;
  a.up = b.up = Vec3d(0, -1, 0);
  a.trained_with = TrainedWith::kMip;
  const GaussianCloud joined = join_gaussians({a, b}, kNames);
  ASSERT_EQ(joined.size(), 2u);
  EXPECT_EQ(joined.origin.x() + double{joined.position[0].x()}, 1000001);
  EXPECT_EQ(joined.origin.x() + double{joined.position[1].x()}, 1000012);
  EXPECT_EQ(joined.degree, 1);
  const Array<float> harmonics{1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0,
                               2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2};
  EXPECT_EQ(joined.harmonics, harmonics);
  EXPECT_EQ(joined.amplitude, (Array<float>{1, 2}));
  EXPECT_EQ(joined.scale[1], Vec3f::Constant(2));
  EXPECT_EQ(joined.unusable_skipped, 7u);
  EXPECT_EQ(joined.up, Vec3d(0, -1, 0));
  EXPECT_EQ(joined.trained_with, TrainedWith::kUnknown);
}

TEST(GaussianJoin, ASingleCloudStaysAsItIs) {
  const GaussianCloud joined = join_gaussians({one({5, 6, 7}, 0, 1)}, {kNames.data(), 1});
  EXPECT_EQ(joined.origin, Vec3d(5, 6, 7));
  EXPECT_EQ(joined.position[0], Vec3f(1, 0, 0));
}

TEST(GaussianJoin, RulesMustAgree) {
  GaussianCloud density = one({0, 0, 0}, 0, 1);
  density.rule = AmplitudeRule::kDensity;
  try {
    join_gaussians({one({0, 0, 0}, 0, 1), density}, kNames);
    FAIL();
  } catch (const Error& e) {
    const std::string what = e.what();
    EXPECT_NE(what.find("b.ply"), std::string::npos) << what;
    EXPECT_NE(what.find("densities"), std::string::npos) << what;
  }
  EXPECT_THROW(join_gaussians({}, {}), Error);
}

}  // namespace
}  // namespace surfel::test
