// surfel-render on files that are no surfels: one command, and the commands that do the same.

#include <filesystem>

#include <gtest/gtest.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/image_io.h>

#include "support/run_tool.h"

namespace surfel::test {
namespace {

/// A bent sheet as a mesh, and points of another.
class FirstPicture : public testing::Test {
 protected:
  void SetUp() override {
    run({tool("surfel-generate"), "head", "--mesh", mesh_, "--resolution", "16", "--image",
         folder_ / "head.png", "--size", "64", "--quiet"});
    std::string points;
    for (int i = 0; i < 400; ++i) {
      const int x = i % 20;
      const int y = i / 20;
      points +=
          std::to_string(x) + ' ' + std::to_string(y) + ' ' + std::to_string(x * x * 0.01) + '\n';
    }
    write_text(points_, points);
  }
  RunResult render(std::vector<std::string> words) const {
    words.insert(words.begin(), tool("surfel-render"));
    return run(words);
  }
  TemporaryFolder folder_;
  std::string mesh_ = folder_ / "head.obj";
  std::string points_ = folder_ / "points.xyz";
};

TEST_F(FirstPicture, CommandsThatAreToldMakeTheSamePicture) {
  const std::string bin = std::filesystem::path(tool("surfel-render")).parent_path();
  for (const std::vector<std::string>& files :
       {std::vector{mesh_}, std::vector{points_}, std::vector{mesh_, points_}}) {
    const std::string one = folder_ / "one.png";
    const std::string same = folder_ / "same.png";
    std::vector<std::string> words = files;
    words.insert(words.end(), {"--size", "64", "-o", one, "--print-commands"});
    const RunResult told = render(words);
    ASSERT_EQ(told.exit_code, 0) << told.errors;
    std::string script = told.output;
    const std::size_t output = script.rfind(one);
    ASSERT_NE(output, std::string::npos) << script;
    script.replace(output, one.size(), same);
    const RunResult result = run(
        {"/bin/sh", "-c", "set -e\nPATH=" + bin + ":$PATH\ncd " + (folder_ / ".") + "\n" + script});
    ASSERT_EQ(result.exit_code, 0) << script << result.errors;
    EXPECT_EQ(read_text(one), read_text(same)) << script;
  }
}

TEST_F(FirstPicture, OptionsOfTexturesAreThoseOfTheMeshAndOfTheCommandsToldForIt) {
  const std::string bare = folder_ / "bare.obj";
  std::string text = read_text(mesh_);
  text.replace(text.find("mtllib"), 6, "#");
  write_text(bare, text);
  const std::string bin = std::filesystem::path(tool("surfel-render")).parent_path();
  const std::string plain = folder_ / "plain.png";
  ASSERT_EQ(render({bare, "--size", "64", "-o", plain}).exit_code, 0);
  for (const std::vector<std::string>& options :
       {Words{"--image", folder_ / "head.png", "--wrap", "mirror"},
        {"--bump", folder_ / "head.png", "--bump-scale=-0.05"},
        {"--normal-map", folder_ / "head.png", "--normal-y", "down"}}) {
    const std::string one = folder_ / "one.png";
    const std::string same = folder_ / "same.png";
    std::vector<std::string> words{bare, "--size", "64", "-o", one, "--print-commands"};
    words.insert(words.end(), options.begin(), options.end());
    const RunResult told = render(words);
    ASSERT_EQ(told.exit_code, 0) << told.errors;
    EXPECT_NE(read_text(one), read_text(plain)) << told.output;
    std::string script = told.output;
    script.replace(script.rfind(one), one.size(), same);
    const RunResult result = run(
        {"/bin/sh", "-c", "set -e\nPATH=" + bin + ":$PATH\ncd " + (folder_ / ".") + "\n" + script});
    ASSERT_EQ(result.exit_code, 0) << script << result.errors;
    EXPECT_EQ(read_text(one), read_text(same)) << script;
  }
}

TEST_F(FirstPicture, TellsOfAnImageThatIsMissingAndTakesAnother) {
  std::filesystem::remove(folder_ / "head.png");
  const std::string picture = folder_ / "p.png";
  const RunResult result = render({mesh_, "--size", "32", "-o", picture});
  EXPECT_EQ(result.exit_code, 0) << result.errors;
  EXPECT_TRUE(
      contains(result.errors, "names the image " + (folder_ / "head.png") + ", which is not there"))
      << result.errors;
  EXPECT_TRUE(contains(result.errors, "--image gives another")) << result.errors;
  const RunResult other = render({mesh_, "--size", "32", "--image", "checker", "-o", picture});
  EXPECT_EQ(other.exit_code, 0) << other.errors;
  EXPECT_FALSE(contains(other.errors, "head.png")) << other.errors;
}

TEST_F(FirstPicture, GltfIsTexturedUprightAndMadeBySameCommands) {
  SURFEL_REQUIRE_TEST_DATA();
  const std::string duck = test::data_folder() / "formats/gltf/Duck.glb";
  const std::string bin = std::filesystem::path(tool("surfel-render")).parent_path();
  const std::string one = folder_ / "one.png";
  const std::string same = folder_ / "same.png";
  const RunResult told = render({duck, "--size", "64", "-o", one, "--print-commands"});
  ASSERT_EQ(told.exit_code, 0) << told.errors;
  EXPECT_TRUE(contains(told.errors, "and textured")) << told.errors;
  EXPECT_TRUE(contains(told.errors, "up y")) << told.errors;
  // The duck is yellow where it is seen.
  const Image image = read_image(one);
  Vec3f mean(0, 0, 0);
  for (int y = 0; y < 64; ++y) {
    for (int x = 0; x < 64; ++x)
      mean += image.pixel(x, y)[3] * Eigen::Map<const Vec3f>(image.pixel(x, y));
  }
  EXPECT_GT(mean.x(), 4 * mean.z());
  EXPECT_GT(mean.y(), 3 * mean.z());
  std::string script = told.output;
  script.replace(script.rfind(one), one.size(), same);
  const RunResult result = run(
      {"/bin/sh", "-c", "set -e\nPATH=" + bin + ":$PATH\ncd " + (folder_ / ".") + "\n" + script});
  ASSERT_EQ(result.exit_code, 0) << script << result.errors;
  EXPECT_EQ(read_text(one), read_text(same)) << script;
}

TEST_F(FirstPicture, OptionsOfTexturesNeedAMeshThatTheyServe) {
  const std::string picture = folder_ / "p.png";
  EXPECT_EQ(render({points_, "--image", "checker", "-o", picture}).exit_code, 2);
  for (const Words& unheeded : {Words{"--bump-scale", "2"}, Words{"--normal-y", "down"}}) {
    Words words{mesh_, "--size", "8", "-o", picture};
    words.insert(words.end(), unheeded.begin(), unheeded.end());
    const RunResult result = render(words);
    EXPECT_EQ(result.exit_code, 2);
    EXPECT_TRUE(contains(result.errors, unheeded[0] + " has no effect")) << result.errors;
  }
  const std::string surfels = folder_ / "s.ply";
  ASSERT_EQ(render({points_, "--size", "8", "--keep", surfels, "-o", picture}).exit_code, 0);
  EXPECT_EQ(render({surfels, "--wrap", "clamp", "-o", picture}).exit_code, 2);
  const std::string image = folder_ / "head.png";
  const std::string before = read_text(image);
  EXPECT_EQ(render({mesh_, "-o", image}).exit_code, 2) << "over the mesh's own image";
  EXPECT_EQ(read_text(image), before);
}

TEST_F(FirstPicture, SaysWhatItDoesAndWritesAndNothingIfQuiet) {
  const std::string picture = folder_ / "p.png";
  const RunResult said = render({mesh_, "--size", "32", "--from", "0,0,1", "-o", picture});
  EXPECT_EQ(said.exit_code, 0);
  EXPECT_EQ(std::count(said.errors.begin(), said.errors.end(), '\n'), 2) << said.errors;
  EXPECT_TRUE(contains(said.errors, "surfel-render: " + picture + ": 32x32 pixels, "))
      << said.errors;
  EXPECT_TRUE(contains(said.errors, "surfel-from-mesh")) << said.errors;
  const RunResult quiet = render({mesh_, "--size", "32", "--quiet", "-o", picture});
  EXPECT_EQ(quiet.exit_code, 0);
  EXPECT_EQ(quiet.errors, "");
}

/// Colours of scans are shown as they are, colours of meshes are lit, and either can be changed.
TEST_F(FirstPicture, RecordedColoursAreNotLit) {
  const auto scan_of = [&](const std::string& name, int colors) {
    std::string points =
        "ply\nformat ascii 1.0\nelement vertex 400\nproperty float x\n"
        "property float y\nproperty float z\nproperty uchar red\n"
        "property uchar green\nproperty uchar blue\nend_header\n";
    for (int i = 0; i < 400; ++i) {
      points += std::to_string(i % 20) + ' ' + std::to_string(i / 20) + " 0 200 100 " +
                std::to_string(i % colors) + "\n";
    }
    write_text(folder_ / name, points);
    return folder_ / name;
  };
  const std::string scan = scan_of("scan.ply", 50);
  const std::string image = folder_ / "p.png";
  const auto picture = [&](const std::string& file, std::vector<std::string> options) {
    options.insert(options.begin(), {file, "--size", "32", "--from", "1,1,1", "-o", image});
    const RunResult result = render(options);
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    return std::pair(read_text(image), result.errors);
  };
  const auto [shown, said] = picture(scan, {});
  EXPECT_NE(said.find("--shading phong lights them"), std::string::npos) << said;
  EXPECT_EQ(shown, picture(scan, {"--shading", "none"}).first);
  EXPECT_NE(shown, picture(scan, {"--shading", "phong"}).first);
  // One colour for all is no record of light.
  EXPECT_EQ(picture(scan_of("plain.ply", 1), {}).second.find("recorded"), std::string::npos);
  const std::string surfels = folder_ / "head.ply";
  EXPECT_NE(picture(mesh_, {"--keep", surfels}).second.find("a mesh"), std::string::npos);
  EXPECT_EQ(picture(surfels, {}).second.find("recorded"), std::string::npos);
  EXPECT_EQ(picture(surfels, {}).first, picture(surfels, {"--shading", "phong"}).first);
  EXPECT_NE(picture(surfels, {}).first, picture(surfels, {"--shading", "none"}).first);
}

/// Surfels without colours have relief, others have it on demand.
TEST_F(FirstPicture, ReliefIsForSurfelsWithoutColours) {
  const std::string image = folder_ / "p.png";
  const auto picture = [&](const std::string& file, const std::string& relief) {
    const RunResult result =
        render({file, "--size", "64", "--relief", relief, "-o", image, "--quiet"});
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    return read_text(image);
  };
  EXPECT_EQ(picture(points_, "auto"), picture(points_, "occlusion"));
  EXPECT_NE(picture(points_, "auto"), picture(points_, "none"));
  const std::string sphere = folder_ / "sphere.ply";  // Has colours.
  run({tool("surfel-generate"), "head", "--count", "4000", "-o", sphere, "--quiet"});
  EXPECT_EQ(picture(sphere, "auto"), picture(sphere, "none"));
  EXPECT_NE(picture(sphere, "auto"), picture(sphere, "eye-dome"));
  EXPECT_EQ(render({points_, "--reference", "--relief", "occlusion", "-o", image}).exit_code, 2);
  EXPECT_EQ(
      render({sphere, "--method", "transparent", "--relief", "occlusion", "-o", image}).exit_code,
      2);
}

TEST_F(FirstPicture, APictureAmongTheFilesIsTheOutput) {
  const std::string picture = folder_ / "p.png";
  EXPECT_EQ(render({points_, picture, "--size", "32"}).exit_code, 0);
  EXPECT_TRUE(std::filesystem::exists(picture));
  EXPECT_EQ(render({points_}).exit_code, 2) << "no output";
}

TEST_F(FirstPicture, KeepsTheSurfels) {
  const std::string kept = folder_ / "kept.ply";
  const RunResult result =
      render({points_, "--size", "32", "-o", folder_ / "p.png", "--keep", kept});
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  EXPECT_EQ(read_cloud(kept).size(), 400U);
  EXPECT_EQ(render({points_, "-o", folder_ / "p.png", "--keep", points_}).exit_code, 2)
      << "input as output";
  EXPECT_EQ(render({"-", points_, "-o", folder_ / "p.png"}).exit_code, 2);
  EXPECT_EQ(render({points_, "-o", "-", "--print-commands"}).exit_code, 2);
}

}  // namespace
}  // namespace surfel::test
