#include <gtest/gtest.h>
#include <surfel/scene/coordinate_system.h>
#include <surfel/scene/join.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/scene/transform.h>

namespace surfel {
namespace {

SurfelCloud cloud_in(int epsg) {
  SurfelCloud cloud;
  cloud.position.assign(1, Vec3f(1, 2, 3));
  cloud.comments = {"made in spring"};
  set_coordinate_system(cloud, coordinate_system_of_code(epsg));
  return cloud;
}

TEST(CoordinateSystem, CommentsNameOne) {
  for (const int epsg : {25832, 4326}) {
    const SurfelCloud cloud = cloud_in(epsg);
    const auto system = coordinate_system(cloud.comments);
    ASSERT_TRUE(system.has_value());
    EXPECT_EQ(system->epsg, epsg);
    EXPECT_EQ(system->geographic, epsg == 4326);
  }
  EXPECT_FALSE(coordinate_system({"surfel_crs EPSG:25832", "surfel_crs EPSG:25833"}).has_value());
  EXPECT_FALSE(coordinate_system({"surfel_crs EPSG:12"}).has_value());
  EXPECT_FALSE(coordinate_system({"surfel_crs EPSG:"}).has_value());
  EXPECT_FALSE(coordinate_system_of_code(1023).problems().empty());
  EXPECT_TRUE(coordinate_system_of_code(1024).problems().empty());
}

TEST(CoordinateSystem, MovedCloudsAreInNone) {
  SurfelCloud cloud = cloud_in(25832);
  transform_cloud(cloud, {.translation = Vec3d(1, 0, 0)});
  EXPECT_EQ(cloud.comments, std::vector<std::string>{"made in spring"});
}

TEST(CoordinateSystem, CloudsInDifferentOnesAreJoinedWithoutIt) {
  const std::vector<std::string> names{"a.las", "b.las"};
  SurfelCloud bare = cloud_in(25832);
  bare.comments.clear();
  EXPECT_EQ(coordinate_system(join_clouds({cloud_in(25832), bare}, {}, names).comments),
            coordinate_system_of_code(25832));
  SurfelCloud first = cloud_in(25832);
  first.las.emplace().records = {
      {.user = "LASF_Projection", .id = 2112, .description = "", .bytes = ""}};
  JoinReport report;
  const SurfelCloud joined = join_clouds({first, cloud_in(25833)}, {}, names, &report);
  EXPECT_FALSE(coordinate_system(joined.comments).has_value());
  EXPECT_TRUE(joined.las->records.empty());
  EXPECT_EQ(report.dropped, std::vector<std::string>{"coordinate system"});
}

}  // namespace
}  // namespace surfel
