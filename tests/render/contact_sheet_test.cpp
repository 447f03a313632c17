#include <limits>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/render/contact_sheet.h>
#include <surfel/scene/color_map.h>
#include <surfel/store/render_cloud.h>

namespace surfel::test {
namespace {

constexpr int kSide = 60;

/// A covered square with an open pixel in it, whose depth goes from 2 at the left to 4.
Image square() {
  Image image{kSide, kSide, {"R", "G", "B", "A", "Z", "N.X", "N.Y", "N.Z", "weight"}, {}};
  image.data.assign(9 * kSide * kSide, 0.0F);
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      float* pixel = image.pixel(x, y);
      pixel[4] = std::numeric_limits<float>::infinity();
      const bool inside = x >= 10 && x < 50 && y >= 10 && y < 50;
      if (!inside || (x == 30 && y == 40)) continue;
      pixel[0] = 0.5F;
      pixel[3] = 1;
      pixel[4] = x < 30 ? 2 : 4;
      pixel[7] = 1;
      pixel[8] = y < 30 ? 1 : 3;
    }
  }
  return image;
}

Vec3f at(const Image& sheet, int panel, int x, int y) {
  const float* p = sheet.pixel(panel % 3 * kSide + x, panel / 3 * kSide + y);
  return {p[0], p[1], p[2]};
}

TEST(ContactSheet, PanelsShowTheirChannels) {
  std::vector<float> density(kSide * kSide, 1.0F);
  density[20 * kSide + 20] = 0;
  const Vec3f white(1, 1, 1);
  const Image sheet = contact_sheet(square(), density, white);
  ASSERT_EQ(sheet.width, 3 * kSide);
  ASSERT_EQ(sheet.height, 2 * kSide);
  const auto expect_color = [&](int panel, int x, int y, const Vec3f& color) {
    EXPECT_LT((at(sheet, panel, x, y) - color).norm(), 2e-3) << panel << " " << x << " " << y;
  };
  for (int panel = 0; panel < 6; ++panel) expect_color(panel, 5, 55, white);
  expect_color(0, 20, 20, {0.5F, 0, 0});
  EXPECT_NEAR(at(sheet, 1, 20, 20).z(), 1, 1e-3);  // The normal is z,
  EXPECT_NEAR(at(sheet, 1, 20, 20).x(), 0.214, 1e-3);
  expect_color(2, 20, 20, map_color(ColorMap::kViridis, 0));
  expect_color(2, 40, 40, map_color(ColorMap::kViridis, 1));
  expect_color(3, 20, 20, map_color(ColorMap::kViridis, 0));
  expect_color(3, 40, 40, map_color(ColorMap::kViridis, 1));
  expect_color(4, 30, 40, {0.8F, 0, 0});  // The pixel that others surround,
  expect_color(4, 20, 20, Vec3f::Constant(0.2F));
  expect_color(5, 20, 20, map_color(ColorMap::kViridis, 1 / 3.0));
  expect_color(5, 40, 45, map_color(ColorMap::kViridis, 1));
}

TEST(ContactSheet, PicturesWithoutTheChannelsAreRefused) {
  Image image = rgba_image(4, 4);
  EXPECT_THROW(contact_sheet(image, std::vector<float>(16), {1, 1, 1}), Error);
}

TEST(ContactSheet, SurfelsAreCountedWhereTheyAreSeen) {
  SurfelCloud cloud;
  cloud.position = {{0, 0, 5}, {0.01F, 0, 6}, {1, 0, 5}, {0, 0, -5}, {50, 0, 5}};
  cloud.normal.assign(5, Vec3f(0, 0, -1));
  cloud.variance.assign(5, 1e-4F);
  RenderCloud render(cloud);
  Camera camera;
  camera.width = camera.height = 10;
  camera.focal_x = camera.focal_y = 10;
  camera.center_x = camera.center_y = 5.5;
  const std::vector<float> count = surfels_per_pixel(render, camera);
  float sum = 0;
  for (const float value : count) sum += value;
  EXPECT_EQ(sum, 3);  // One lies behind the eye, one beside the picture.
  EXPECT_EQ(count[5 * 10 + 5], 2);
  EXPECT_EQ(count[5 * 10 + 7], 1);
}

}  // namespace
}  // namespace surfel::test
