#include <Eigen/Geometry>
#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <surfel/io/image_io.h>
#include <surfel/scene/framing.h>

#include "support/run_tool.h"
#include "support/test_data.h"

namespace surfel::test {
namespace {

RunResult render(const TemporaryFolder& folder, const Words& words) {
  Words command{tool("surfel-render"), folder / "ball.ply"};
  command.insert(command.end(), words.begin(), words.end());
  return run(command);
}

void make_ball(const TemporaryFolder& folder) {
  const RunResult made = run({tool("surfel-generate"), "sphere", "--count", "2000", "--texture",
                              "checker", "-o", folder / "ball.ply"});
  ASSERT_EQ(made.exit_code, 0) << made.errors;
}

CameraOptions known_options() {
  CameraOptions options;
  options.eye = Vec3d(1.2, 0.9, 2.1);
  options.target = Vec3d(0.1, 0.2, -0.3);
  options.up = Vec3d(0, 1, 0);
  options.fov = 35;
  options.width = 96;
  options.height = 64;
  return options;
}

constexpr const char* kToml =
    "[[camera]]\nname = \"set/one.jpg\"\neye = [1.2, 0.9, 2.1]\ntarget = [0.1, 0.2, -0.3]\n"
    "up = [0, 1, 0]\nfov = 35\nsize = [96, 64]\n";

/// The known view in COLMAP's text, `count` times.
void write_colmap(const TemporaryFolder& folder, int count) {
  const Camera camera = make_camera(known_options(), {});
  const Eigen::Quaterniond q(camera.camera_from_world);
  const Vec3d t = -(camera.camera_from_world * camera.eye);
  std::filesystem::create_directory(folder / "colmap");
  write_text(folder / "colmap/cameras.txt",
             fmt::format("1 SIMPLE_PINHOLE 96 64 {} 48 32\n", camera.focal_x));
  std::string images;
  for (int i = 0; i < count; ++i) {
    images += fmt::format("{} {} {} {} {} {} {} {} 1 set/{}.jpg\n\n", i + 1, q.w(), q.x(), q.y(),
                          q.z(), t.x(), t.y(), t.z(), i);
  }
  write_text(folder / "colmap/images.txt", images);
}

void write_transforms(const TemporaryFolder& folder) {
  const Camera camera = make_camera(known_options(), {});
  std::string rows;
  for (int row = 0; row < 3; ++row) {
    const Vec3d axes = camera.camera_from_world.col(row);
    rows += fmt::format("[{}, {}, {}, {}], ", axes.x(), -axes.y(), -axes.z(), camera.eye[row]);
  }
  write_text(folder / "transforms.json",
             fmt::format(R"({{"w": 96, "h": 64, "fl_x": {}, "frames": [{{"file_path": "one.jpg",
                             "transform_matrix": [{}[0, 0, 0, 1]]}}]}})",
                         camera.focal_x, rows));
}

TEST(Views, AKnownViewGivesTheSamePictureInEachConvention) {
  const TemporaryFolder folder;
  make_ball(folder);
  write_text(folder / "views.toml", kToml);
  write_colmap(folder, 1);
  write_transforms(folder);
  std::vector<Image> pictures;
  for (const char* views : {"views.toml", "colmap", "transforms.json"}) {
    const RunResult result =
        render(folder, {"--views", folder / views, "--up", "y", "-o", folder / "out.exr"});
    ASSERT_EQ(result.exit_code, 0) << views << result.errors;
    pictures.push_back(read_image(folder / "out.exr", true));
  }
  for (std::size_t k = 1; k < pictures.size(); ++k) {
    ASSERT_EQ(pictures[k].data.size(), pictures[0].data.size());
    double difference = 0;
    for (std::size_t i = 0; i < pictures[0].data.size(); ++i) {
      const double a = pictures[0].data[i];
      const double b = pictures[k].data[i];
      if (a != b) difference = std::max(difference, std::abs(a - b));
    }
    EXPECT_LT(difference, 1e-4) << k;  // Of codes that are 4e-3 apart.
  }
}

TEST(Views, PicturesAreNamedSelectedAndSkipped) {
  const TemporaryFolder folder;
  make_ball(folder);
  write_colmap(folder, 4);
  std::filesystem::create_directory(folder / "out");
  const auto make = [&](const Words& words) {
    Words all{"--views", folder / "colmap", "-o", folder / "out/{name}.png"};
    all.insert(all.end(), words.begin(), words.end());
    return render(folder, all);
  };
  RunResult result = make({"--frames", "1-2"});
  EXPECT_EQ(result.exit_code, 0) << result.errors;
  EXPECT_EQ(entries(folder / "out"), (Words{"set_1.png", "set_2.png"}));
  write_text(folder / "out/set_1.png", "kept");
  result = make({"--skip-existing"});
  EXPECT_EQ(result.exit_code, 0) << result.errors;
  EXPECT_TRUE(contains(result.errors, "2 of 4 pictures are there already")) << result.errors;
  EXPECT_EQ(entries(folder / "out").size(), 4U);
  EXPECT_EQ(read_text(folder / "out/set_1.png"), "kept");
  // With nothing to be made the surfels are not even read.
  std::filesystem::remove(folder / "ball.ply");
  EXPECT_EQ(make({"--skip-existing"}).exit_code, 0);

  result = make({"--frames", "2-7"});
  EXPECT_EQ(result.exit_code, 2);
  EXPECT_TRUE(contains(result.errors, "the last picture is 3")) << result.errors;
  EXPECT_EQ(make({"--frames", "2-1"}).exit_code, 2);
  result = make({"--fov", "30"});
  EXPECT_EQ(result.exit_code, 2);
  EXPECT_TRUE(contains(result.errors, "--fov has no effect")) << result.errors;
  EXPECT_EQ(make({"--up", "auto"}).exit_code, 2);
  EXPECT_EQ(make({"--original-world"}).exit_code, 1);
}

TEST(Views, SizeScalesKnownViews) {
  const TemporaryFolder folder;
  make_ball(folder);
  write_colmap(folder, 1);
  const RunResult half =
      render(folder, {"--views", folder / "colmap", "--size", "48x32", "-o", folder / "half.png"});
  ASSERT_EQ(half.exit_code, 0) << half.errors;
  const Image image = read_image(folder / "half.png");
  EXPECT_EQ(image.width, 48);
  const RunResult wrong =
      render(folder, {"--views", folder / "colmap", "--size", "48", "-o", folder / "wrong.png"});
  EXPECT_EQ(wrong.exit_code, 2);
  EXPECT_TRUE(contains(wrong.errors, "such as 48x32")) << wrong.errors;
}

}  // namespace
}  // namespace surfel::test
