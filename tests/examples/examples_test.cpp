// The example programs run and do what docs/library.md says; the page shows their text.

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/image_io.h>

#include "support/run_tool.h"

namespace surfel {
namespace {

using test::RunResult;
using test::TemporaryFolder;

const std::string kSamples = std::string(SURFEL_SOURCE_DIR) + "/samples/";

RunResult run_example(std::vector<std::string> command) {
  command[0].insert(0, SURFEL_EXAMPLE_DIR "/example_");
  const RunResult result = test::run(command);
  EXPECT_EQ(result.exit_code, 0) << command[0] << ": " << result.errors;
  return result;
}

TEST(Examples, WriteThenLoad) {
  const TemporaryFolder folder;
  run_example({"write", folder / "sphere.ply"});
  const std::string text = run_example({"load", folder / "sphere.ply"}).output;
  EXPECT_NE(text.find("20000 points"), std::string::npos) << text;
  EXPECT_NE(text.find("normals: yes, sizes: yes, colours: yes"), std::string::npos) << text;
}

TEST(Examples, RenderShowsASphereWithoutHoles) {
  const TemporaryFolder folder;
  run_example({"write", folder / "sphere.ply"});
  run_example({"render", folder / "sphere.ply", folder / "sphere.png"});
  const Image image = read_image(folder / "sphere.png");
  // The sphere fills 95 % of the picture's height.
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const double r = std::hypot(x + 0.5 - image.width / 2.0, y + 0.5 - image.height / 2.0);
      const float alpha = image.pixel(x, y)[3];
      if (r < 0.44 * image.height) {
        ASSERT_EQ(alpha, 1) << x << ", " << y;
      }
      if (r > 0.5 * image.height) {
        ASSERT_EQ(alpha, 0) << x << ", " << y;
      }
    }
  }
}

TEST(Examples, EstimateFindsTheNormalsOfASphere) {
  const TemporaryFolder folder;
  run_example({"write", folder / "sphere.ply"});
  SurfelCloud points;
  points.position = read_cloud(folder / "sphere.ply").position;
  write_cloud(points, folder / "points.ply");
  run_example({"estimate", folder / "points.ply", folder / "surfels.ply"});
  const SurfelCloud surfels = read_cloud(folder / "surfels.ply");
  ASSERT_EQ(surfels.size(), points.size());
  for (std::size_t i = 0; i < surfels.size(); ++i) {
    ASSERT_GT(surfels.normal[i].dot(surfels.position[i].normalized()), std::cos(0.05)) << i;
  }
}

TEST(Examples, TextureColoursSurfelsFromTheImage) {
  const TemporaryFolder folder;
  run_example(
      {"texture", kSamples + "head.obj", kSamples + "head.png", "5000", folder / "head.ply"});
  const SurfelCloud head = read_cloud(folder / "head.ply");
  EXPECT_EQ(head.size(), 5000U);
  ASSERT_EQ(head.coefficient.size(), head.size());
  // The image is not of one colour, and nothing but filtering happened to it.
  float least = 1;
  float most = 0;
  for (const Vec3f& c : head.coefficient) {
    least = std::min(least, c.y());
    most = std::max(most, c.y());
  }
  EXPECT_GE(least, 0);
  EXPECT_LE(most, 1);
  EXPECT_GT(most - least, 0.2);
}

TEST(Examples, PclCloudsComeBackAsSurfels) {
  const TemporaryFolder folder;
  run_example({"write", folder / "sphere.ply"});
  write_cloud(read_cloud(folder / "sphere.ply"), folder / "sphere.pcd");
  run_example({"pcl", folder / "sphere.pcd", folder / "surfels.pcd"});
  const SurfelCloud surfels = read_cloud(folder / "surfels.pcd");
  ASSERT_EQ(surfels.size(), 20000U);
  ASSERT_EQ(surfels.normal.size(), surfels.size());
  EXPECT_GT(surfels.variance.front(), 0);
}

TEST(Examples, OpenMeshIsSampledAfterSubdivision) {
  const TemporaryFolder folder;
  test::write_text(folder / "octahedron.off",
                   "OFF\n6 8 0\n1 0 0\n-1 0 0\n0 1 0\n0 -1 0\n0 0 1\n0 0 -1\n"
                   "3 0 2 4\n3 2 1 4\n3 1 3 4\n3 3 0 4\n3 2 0 5\n3 1 2 5\n3 3 1 5\n3 0 3 5\n");
  const std::string text =
      run_example({"openmesh", folder / "octahedron.off", "3000", folder / "out.ply"}).output;
  EXPECT_NE(text.find("3000 surfels on 128 faces"), std::string::npos) << text;
  EXPECT_EQ(read_cloud(folder / "out.ply").size(), 3000U);
}

TEST(Examples, PageShowsTheProgramsAsTheyAre) {
  const std::string source(SURFEL_SOURCE_DIR);
  const std::string page = test::read_text(source + "/docs/library.md");
  for (const char* name : {"load", "estimate", "texture", "render", "write", "pcl", "openmesh"}) {
    const std::string text = test::read_text(source + "/examples/" + name + ".cpp");
    ASSERT_FALSE(text.empty()) << name;
    EXPECT_NE(page.find("```cpp\n" + text + "```\n"), std::string::npos) << name;
    EXPECT_LE(std::count(text.begin(), text.end(), '\n'), 40) << name;
  }
}

}  // namespace
}  // namespace surfel
