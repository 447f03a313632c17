#include <cmath>
#include <limits>

#include <gtest/gtest.h>
#include <surfel/pcl/conversion.h>

namespace surfel {
namespace {

SurfelCloud surfels() {
  SurfelCloud cloud;
  cloud.origin = Vec3d(100, -200, 50);
  for (int i = 0; i < 256; ++i) {
    cloud.position.push_back(Vec3f(static_cast<float>(i), 0.5F, -1));
    cloud.normal.push_back(Vec3f(0, 0.6F, -0.8F));
    const auto byte = static_cast<std::uint8_t>(i);
    cloud.color.push_back(Vec3f(srgb8_to_linear(byte), srgb8_to_linear(255 - byte), 0));
    cloud.variance.push_back(static_cast<float>(i) * 0.25F);
    cloud.alpha.push_back(static_cast<float>(i) / 255);
  }
  cloud.viewpoint = Viewpoint{Vec3d(101, -199, 52), Eigen::Vector4d(0.5, 0.5, -0.5, 0.5)};
  return cloud;
}

TEST(Pcl, RoundTripKeepsWhatThePointTypeHolds) {
  const SurfelCloud cloud = surfels();
  const auto points = toPCL<pcl::PointXYZRGBNormal>(cloud);
  EXPECT_EQ(points.width, 256U);
  EXPECT_EQ(points.height, 1U);
  EXPECT_TRUE(points.is_dense);
  EXPECT_EQ(points[7].x, 107);
  EXPECT_EQ(points[7].r, 7);
  EXPECT_EQ(points[7].g, 248);
  const SurfelCloud back = fromPCL(points, true);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    EXPECT_EQ(back.world(i), cloud.world(i));
    EXPECT_EQ(back.normal[i], cloud.normal[i]);
    EXPECT_EQ(back.color[i], cloud.color[i]);
    EXPECT_EQ(back.alpha[i], cloud.alpha[i]);
  }
  EXPECT_TRUE(back.variance.empty());
  ASSERT_TRUE(back.viewpoint);
  EXPECT_TRUE(back.viewpoint->position.isApprox(cloud.viewpoint->position, 1e-6));
  EXPECT_TRUE(back.viewpoint->orientation.isApprox(cloud.viewpoint->orientation, 1e-6));
}

TEST(Pcl, RadiusIsOneStandardDeviation) {
  SurfelCloud cloud = surfels();
  EXPECT_EQ(toPCL<pcl::PointSurfel>(cloud)[4].radius, 1);
  const SurfelCloud back = fromPCL(toPCL<pcl::PointSurfel>(cloud));
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    EXPECT_NEAR(back.variance[i], cloud.variance[i], 1e-5F);
  }
  cloud.tangent.assign(cloud.size(), Vec3f(1, 0, 0));
  cloud.variance_u.assign(cloud.size(), 9);
  cloud.variance_v.assign(cloud.size(), 4);
  EXPECT_EQ(toPCL<pcl::PointSurfel>(cloud)[4].radius, 3);
}

TEST(Pcl, ConfidenceAndCurvatureAreKept) {
  pcl::PointCloud<pcl::PointSurfel> points;
  for (int i = 0; i < 3; ++i) {
    pcl::PointSurfel p;
    p.confidence = 0.25F * static_cast<float>(i);
    p.curvature = 0.125F * static_cast<float>(i);
    points.push_back(p);
  }
  points[1].curvature = std::numeric_limits<float>::quiet_NaN();
  const SurfelCloud cloud = fromPCL(points);
  cloud.check_columns("surfels");
  const auto back = toPCL<pcl::PointSurfel>(cloud);
  EXPECT_EQ(back[2].confidence, 0.5F);
  EXPECT_EQ(back[2].curvature, 0.25F);
  EXPECT_TRUE(std::isnan(back[1].curvature));
  EXPECT_EQ(toPCL<pcl::PointNormal>(cloud)[2].curvature, 0.25F);
  EXPECT_EQ(toPCL<pcl::PointNormal>(surfels())[2].curvature, 0);
  EXPECT_TRUE(fromPCL(pcl::PointCloud<pcl::PointXYZ>()).extra.empty());
}

TEST(Pcl, PackedColors) {
  pcl::PointCloud<pcl::PointXYZRGB> points;
  points.emplace_back(1.0F, 2.0F, 3.0F, 255, 128, 0);
  EXPECT_EQ(points[0].rgba, 0xffff8000U);
  const SurfelCloud cloud = fromPCL(points);
  EXPECT_EQ(cloud.color.at(0), Vec3f(1, srgb8_to_linear(128), 0));
  EXPECT_EQ(toPCL<pcl::PointXYZRGB>(cloud)[0].rgba, 0xffff8000U);
}

TEST(Pcl, PlainPointsAndWhatIsNotFinite) {
  SurfelCloud cloud = surfels();
  cloud.position[3].y() = std::numeric_limits<float>::quiet_NaN();
  const auto points = toPCL<pcl::PointXYZ>(cloud, true);
  EXPECT_FALSE(points.is_dense);
  EXPECT_EQ(points[7].x, 7);                // The origin is left out ...
  EXPECT_EQ(points.sensor_origin_.z(), 2);  // ... of the viewpoint, too.
  const SurfelCloud back = fromPCL(points);
  EXPECT_TRUE(std::isnan(back.position[3].y()));
  EXPECT_TRUE(back.normal.empty());
  EXPECT_TRUE(back.color.empty());
  EXPECT_TRUE(fromPCL(pcl::PointCloud<pcl::PointXYZ>()).empty());
}

}  // namespace
}  // namespace surfel
