#include <cmath>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/scene/transform.h>

namespace surfel {
namespace {

SurfelCloud surfel() {
  SurfelCloud cloud;
  cloud.position = {Vec3f(1, 2, 3)};
  cloud.normal = {Vec3f(1, 0, 0)};
  cloud.shading_normal = {Vec3f(0.5F, 0, 0)};
  cloud.tangent = {Vec3f(0, 1, 0)};
  cloud.variance_u = {4};
  cloud.variance_v = {9};
  cloud.variance = {1};
  cloud.area = {2};
  cloud.clip1 = {Vec3f(0, 1, 0)};
  cloud.clip1_distance = {0.5F};
  cloud.clip2 = {Vec3f(0, 0, -1)};
  cloud.clip2_distance = {-0.25F};
  cloud.dpdu = {Vec3f(0, 0, 1)};
  cloud.dpdv = {Vec3f(0, 2, 0)};
  cloud.group_radius = {5};
  cloud.uv = {Vec2f(0.5F, 0.25F)};
  cloud.viewpoint = Viewpoint{Vec3d(1, 0, 0), Eigen::Vector4d(1, 0, 0, 0)};
  cloud.up = Vec3d(1, 0, 0);
  return cloud;
}

TEST(TransformCloud, ScalesTurnsAndMoves) {
  SurfelCloud cloud = surfel();
  // A quarter turn about z: x to y, y to -x.
  const Similarity similarity{.scale = 2,
                              .rotation = Quaternion(Eigen::AngleAxisd(M_PI / 2, Vec3d::UnitZ())),
                              .translation = Vec3d(10, 0, -1)};
  transform_cloud(cloud, similarity);
  EXPECT_LT((cloud.world(0) - Vec3d(6, 2, 5)).norm(), 1e-6);
  EXPECT_LT((cloud.normal[0] - Vec3f(0, 1, 0)).norm(), 1e-6F);
  EXPECT_LT((cloud.shading_normal[0] - Vec3f(0, 0.5F, 0)).norm(), 1e-6F);
  EXPECT_LT((cloud.tangent[0] - Vec3f(-1, 0, 0)).norm(), 1e-6F);
  EXPECT_LT((cloud.dpdu[0] - Vec3f(0, 0, 2)).norm(), 1e-6F);
  EXPECT_LT((cloud.dpdv[0] - Vec3f(-4, 0, 0)).norm(), 1e-6F);
  EXPECT_EQ(cloud.variance[0], 4);
  EXPECT_EQ(cloud.variance_u[0], 16);
  EXPECT_EQ(cloud.variance_v[0], 36);
  EXPECT_EQ(cloud.area[0], 8);
  EXPECT_LT((cloud.clip1[0] - Vec3f(-1, 0, 0)).norm(), 1e-6F);
  EXPECT_EQ(cloud.clip1_distance[0], 1);
  EXPECT_LT((cloud.clip2[0] - Vec3f(0, 0, -1)).norm(), 1e-6F);
  EXPECT_EQ(cloud.clip2_distance[0], -0.5F);
  EXPECT_EQ(cloud.group_radius[0], 10);
  EXPECT_EQ(cloud.uv[0], Vec2f(0.5F, 0.25F));
  EXPECT_LT((cloud.viewpoint->position - Vec3d(10, 2, -1)).norm(), 1e-12);
  EXPECT_LT((cloud.viewpoint->orientation - Vec4d(std::sqrt(0.5), 0, 0, std::sqrt(0.5))).norm(),
            1e-12);
  EXPECT_LT((*cloud.up - Vec3d(0, 1, 0)).norm(), 1e-12);
}

TEST(TransformCloud, FarAwayNothingIsLost) {
  SurfelCloud cloud;
  for (int i = 0; i < 100; ++i)
    cloud.position.push_back(Vec3f(0.001F * static_cast<float>(i), 0, 1));
  SurfelCloud moved = cloud;
  transform_cloud(moved, {.translation = Vec3d(5e6, -3e6, 0.1)});
  for (std::size_t i = 0; i < 100; ++i) {
    EXPECT_LT((moved.world(i) - cloud.world(i) - Vec3d(5e6, -3e6, 0.1)).norm(), 1e-7);
  }
  transform_cloud(moved, {.translation = Vec3d(-5e6, 3e6, -0.1)});
  EXPECT_LT(moved.origin.norm(), 2);
  for (std::size_t i = 0; i < 100; ++i) {
    EXPECT_LT((moved.world(i) - cloud.world(i)).norm(), 2e-7);
  }
}

TEST(TransformCloud, TheIdentityChangesNothing) {
  SurfelCloud cloud = surfel();
  cloud.origin = Vec3d(0.1, 0.2, 0.3);  // No origin that a reader would choose.
  transform_cloud(cloud, {});
  EXPECT_EQ(cloud.origin, Vec3d(0.1, 0.2, 0.3));
  EXPECT_EQ(cloud.position[0], Vec3f(1, 2, 3));
}

TEST(Similarity, RefusesWhatIsNone) {
  EXPECT_TRUE(Similarity{}.problems().empty());
  for (const double scale : {0.0, -1.0, 1e10, std::nan("")}) {
    EXPECT_FALSE(Similarity{.scale = scale}.problems().empty()) << scale;
  }
  EXPECT_FALSE((Similarity{.rotation = Quaternion(0, 0, 0, 0)}.problems().empty()));
  EXPECT_FALSE((Similarity{.translation = Vec3d(0, 0, INFINITY)}.problems().empty()));
  SurfelCloud cloud = surfel();
  EXPECT_THROW(transform_cloud(cloud, {.scale = 0}), Error);
}

}  // namespace
}  // namespace surfel
