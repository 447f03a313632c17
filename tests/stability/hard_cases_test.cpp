#include <set>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/sample/hard_cases.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/framing.h>

namespace surfel::test {
namespace {

TEST(HardCases, AllAreMadeSoundAndSeen) {
  std::set<std::string> names;
  for (const HardCase& info : hard_cases()) {
    SCOPED_TRACE(info.name);
    EXPECT_TRUE(names.insert(info.name).second);
    EXPECT_FALSE(info.what.empty());
    if (info.has_value()) {
      EXPECT_GE(info.value, info.least);
      EXPECT_LE(info.value, info.most);
    }
    if (info.name == "flicker") continue;  // Made by generate_surfels(), and large.
    const HardScene scene = make_hard_case(info.name);
    EXPECT_FALSE(scene.cloud.empty());
    scene.cloud.check_columns(info.name);
    EXPECT_TRUE(scene.view.problems().empty());
    EXPECT_NO_THROW(make_camera(scene.view, SceneExtent{}));
    EXPECT_EQ(scene.mesh.has_value(), scene.image.has_value());
  }
}

TEST(HardCases, NumbersAreTakenAndChecked) {
  EXPECT_EQ(make_hard_case("few-points:3").cloud.size(), 3U);
  EXPECT_EQ(make_hard_case("few-points:0").cloud.size(), 0U);
  EXPECT_EQ(make_hard_case("offset:1e8").cloud.origin.x(), 1e8);
  for (const char* bad : {"grazing:", "grazing:x", "grazing:91", "grazing:nan", "grazing:1x",
                          "few-points:-1", "isolated:3", "unknown", ""}) {
    EXPECT_THROW(make_hard_case(bad), Error) << bad;
  }
}

TEST(HardCases, SeedsDiffer) {
  EXPECT_NE(make_hard_case("grazing", 1).cloud.position[0],
            make_hard_case("grazing", 2).cloud.position[0]);
  EXPECT_EQ(make_hard_case("grazing", 1).cloud.position[0],
            make_hard_case("grazing", 1).cloud.position[0]);
}

TEST(HardCases, ViewsAreOptionsOfTheRenderer) {
  CameraOptions view;
  view.eye = Vec3d(0, 0.5, 2);
  view.target = Vec3d(0, 0, 0);
  EXPECT_EQ(view_options(view), "--eye 0,0.5,2 --target 0,0,0 --up 0,1,0 --fov 40 --size 512x512");
}

}  // namespace
}  // namespace surfel::test
