#include <cmath>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/scene/map_place.h>

namespace surfel::test {
namespace {

Bounds town() {
  Bounds box;
  box.add(Vec3d(431000.3, 5600000.1, 12));
  box.add(Vec3d(431100.9, 5600050.2, 80));
  return box;
}

TEST(MapPlace, PixelsLieAtMultiplesOfTheirSideAndHoldTheBox) {
  const Camera camera = map_camera(town(), 0.5);
  EXPECT_TRUE(camera.problems().empty());
  const MapPlace place = map_place(camera);
  EXPECT_EQ(place.pixel, 0.5);
  EXPECT_EQ(place.left, 431000);
  EXPECT_EQ(place.top, 5600050.5);
  EXPECT_EQ(camera.width, 202);
  EXPECT_EQ(camera.height, 101);
  // The middle of the first pixel, as the camera sees it.
  const Vec3d seen = camera.camera_from_world * (Vec3d(431000.25, 5600050.25, 40) - camera.eye);
  EXPECT_NEAR(camera.focal_x * seen.x() + camera.center_x, 0.5, 1e-6);
  EXPECT_NEAR(camera.focal_y * seen.y() + camera.center_y, 0.5, 1e-6);
  EXPECT_GT(seen.z(), 0);
}

TEST(MapPlace, BoxesOfWholePixelsGetNoMore) {
  Bounds box;
  box.add(Vec3d(0, 0, 0));
  box.add(Vec3d(0.3, 0.1, 0));
  EXPECT_EQ(map_camera(box, 0.1).width, 3);
  EXPECT_EQ(map_camera(box, 0.1).height, 1);
  EXPECT_EQ(map_camera({}, 1).width, 1);
  EXPECT_THROW(map_camera(town(), 1e-4), Error);
}

TEST(MapPlace, WorldFilesNameTheMiddleOfTheFirstPixel) {
  EXPECT_EQ(world_file(map_place(map_camera(town(), 0.5))),
            "0.5\n0\n0\n-0.5\n431000.25\n5600050.25\n");
  EXPECT_EQ(world_file_name("a/b.png"), "a/b.pgw");
  EXPECT_EQ(world_file_name("b.tiff"), "b.tfw");
  EXPECT_EQ(world_file_name("b.exr"), "b.exrw");
}

}  // namespace
}  // namespace surfel::test
