#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/scene/keep_columns.h>

#include "support/message_of.h"

namespace surfel::test {
namespace {

SurfelCloud cloud_with_columns() {
  SurfelCloud cloud;
  cloud.position = {Vec3f(1, 2, 3), Vec3f(4, 5, 6)};
  cloud.normal = {Vec3f(0, 0, 1), Vec3f(0, 1, 0)};
  cloud.color = {Vec3f(1, 0, 0), Vec3f(0, 1, 0)};
  cloud.variance = {1, 2};
  cloud.area = {3, 4};
  cloud.extra.push_back({"Intensity", ScalarType::kUint8, Array<std::byte>(2)});
  cloud.extra.push_back({"gps_time", ScalarType::kFloat64, Array<std::byte>(16)});
  return cloud;
}

TEST(KeepColumns, ComponentsStayTogether) {
  SurfelCloud cloud = cloud_with_columns();
  keep_columns(cloud, {"ny", "intensity"}, "f.ply");
  EXPECT_EQ(cloud.position.size(), 2U);
  EXPECT_EQ(cloud.normal.size(), 2U);
  EXPECT_TRUE(cloud.color.empty());
  EXPECT_TRUE(cloud.variance.empty());
  EXPECT_TRUE(cloud.area.empty());
  ASSERT_EQ(cloud.extra.size(), 1U);
  EXPECT_EQ(cloud.extra[0].name, "Intensity");
  cloud.check_columns("f.ply");

  cloud = cloud_with_columns();
  keep_columns(cloud, {"radius", "COLOR"}, "f.ply");
  EXPECT_EQ(cloud.variance.size(), 2U);
  EXPECT_EQ(cloud.area.size(), 2U);
  EXPECT_EQ(cloud.color.size(), 2U);
  EXPECT_TRUE(cloud.normal.empty());
  EXPECT_TRUE(cloud.extra.empty());
}

TEST(KeepColumns, UnknownNamesAreRefusedWithTheKnown) {
  SurfelCloud cloud = cloud_with_columns();
  const std::string message = message_of([&] { keep_columns(cloud, {"alpha"}, "f.ply"); });
  EXPECT_NE(message.find("f.ply"), std::string::npos) << message;
  EXPECT_NE(message.find("'alpha'"), std::string::npos) << message;
  EXPECT_NE(message.find("gps_time"), std::string::npos) << message;
  EXPECT_EQ(cloud.normal.size(), 2U) << "nothing is dropped";
}

}  // namespace
}  // namespace surfel::test
