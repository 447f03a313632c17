#include <algorithm>
#include <cstddef>
#include <fstream>
#include <string>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/image_io.h>
#include <surfel/report/previews.h>
#include <surfel/sample/generate.h>

#include "support/test_data.h"

namespace surfel::test {
namespace {

/// Share of a picture's pixels that are opaque.
double covered(const Image& image) {
  std::size_t opaque = 0;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) opaque += image.pixel(x, y)[3] > 0.9F ? 1 : 0;
  }
  return static_cast<double>(opaque) / (image.width * image.height);
}

TEST(Previews, ShowFourSidesOfSurfelsAndPoints) {
  const TemporaryFolder folder;
  SurfelCloud cloud = generate_surfels(procedural_scene("sphere", 1), {.count = 3000});
  write_cloud(cloud, folder / "surfels.ply");
  cloud.variance.clear();
  cloud.area.clear();
  write_cloud(cloud, folder / "points.ply");
  for (const char* file : {"surfels.ply", "points.ply"}) {
    const auto previews = preview_pictures(folder / file, {.size = 48, .most_points = 1500});
    ASSERT_EQ(previews.size(), 4U) << file;
    for (const Preview& preview : previews) {
      EXPECT_EQ(preview.image.width, 48);
      EXPECT_GT(covered(preview.image), 0.3) << file << ", " << preview.caption;
      EXPECT_FALSE(preview.caption.empty());
    }
  }
  EXPECT_NE(preview_pictures(folder / "points.ply", {.size = 48, .most_points = 1500})
                .front()
                .caption.find("one in 2 points"),
            std::string::npos);
}

TEST(Previews, OfAPictureIsThePicture) {
  const TemporaryFolder folder;
  Image image = rgba_image(5, 4);
  for (float& value : image.data) value = 1;
  write_image(image, folder / "white.png");
  const auto previews = preview_pictures(folder / "white.png");
  ASSERT_EQ(previews.size(), 1U);
  EXPECT_EQ(previews.front().image.width, 5);
}

TEST(Previews, ShowVolumes) {
  const TemporaryFolder folder;
  std::string file =
      "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 16 16 16\nspacings: 1 1 1\n"
      "encoding: raw\n\n";
  for (int z = 0; z < 16; ++z) {
    for (int y = 0; y < 16; ++y) {
      for (int x = 0; x < 16; ++x) {
        const double r2 = (x - 7.5) * (x - 7.5) + (y - 7.5) * (y - 7.5) + (z - 7.5) * (z - 7.5);
        file += r2 < 36 ? '\xc8' : '\0';
      }
    }
  }
  std::ofstream(folder / "ball.nrrd", std::ios::binary) << file;
  for (const std::size_t most : {std::size_t{4096}, std::size_t{1000}}) {
    const auto previews = preview_pictures(folder / "ball.nrrd", {.size = 48, .most_voxels = most});
    ASSERT_EQ(previews.size(), 4U);
    for (const Preview& preview : previews) {
      float most_alpha = 0;
      for (int i = 0; i < 48; ++i) most_alpha = std::max(most_alpha, preview.image.pixel(24, i)[3]);
      EXPECT_GT(most_alpha, 0.3F) << preview.caption;
      EXPECT_LT(preview.image.pixel(0, 0)[3], 0.01F) << preview.caption;
    }
    const std::string& caption = previews.front().caption;
    EXPECT_NE(caption.find("by the transfer function mr"), std::string::npos) << caption;
    EXPECT_EQ(caption.find("means of 2 x 2 x 2 voxels") != std::string::npos, most < 4096);
  }
}

TEST(Previews, OfNothingUsableAreRefused) {
  const TemporaryFolder folder;
  SurfelCloud cloud;
  cloud.position.emplace_back(0.0F, 0.0F, 0.0F);
  cloud.variance.push_back(-1);
  write_cloud(cloud, folder / "none.ply");
  EXPECT_THROW(preview_pictures(folder / "none.ply"), Error);
}

}  // namespace
}  // namespace surfel::test
