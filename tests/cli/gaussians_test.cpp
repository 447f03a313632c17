// surfel-render on files of trained Gaussians.

#include <cmath>
#include <filesystem>
#include <string>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <surfel/io/gaussian_io.h>
#include <surfel/io/image_io.h>
#include <surfel/scene/gaussian_cloud.h>

#include "support/run_tool.h"

namespace surfel::test {
namespace {

/// A red Gaussian above a blue one, as trained files have it: y points down.
GaussianCloud two_gaussians() {
  GaussianCloud cloud;
  cloud.position = {Vec3f(0, -1, 0), Vec3f(0, 1, 0)};
  cloud.scale.assign(2, Vec3f::Constant(0.4F));
  cloud.rotation.assign(2, {1, 0, 0, 0});
  cloud.amplitude.assign(2, 0.95F);
  cloud.harmonics = {1.7F, -1.7F, -1.7F, -1.7F, -1.7F, 1.7F};
  return cloud;
}

class Gaussians : public testing::Test {
 protected:
  void SetUp() override { write_gaussians(two_gaussians(), splats_); }
  RunResult render(Words words, const std::string& picture = "p.png") const {
    words.insert(words.begin(), {tool("surfel-render"), splats_});
    words.insert(words.end(), {"-o", folder_ / picture, "--size", "64"});
    return run(words);
  }
  /// Red less blue in the upper and in the lower half of a picture.
  std::array<float, 2> halves(const std::string& picture = "p.png") const {
    const Image image = read_image(folder_ / picture, true);
    std::array<float, 2> sum{};
    for (int y = 0; y < image.height; ++y) {
      for (int x = 0; x < image.width; ++x) {
        sum[y < image.height / 2 ? 0 : 1] += image.pixel(x, y)[0] - image.pixel(x, y)[2];
      }
    }
    return sum;
  }
  TemporaryFolder folder_;
  std::string splats_ = folder_ / "two.ply";
};

TEST_F(Gaussians, AreUprightWhateverTheProfile) {
  for (const char* profile : {"auto", "inria", "gsplat", "mip", "2dgs", "exact", "surfel"}) {
    const RunResult result = render({"--profile", profile});
    ASSERT_EQ(result.exit_code, 0) << result.errors;
    EXPECT_TRUE(contains(result.errors, "up -y")) << result.errors;
    EXPECT_GT(halves()[0], 10) << profile;
    EXPECT_LT(halves()[1], -10) << profile;
  }
  ASSERT_EQ(render({"--up", "y"}).exit_code, 0);
  EXPECT_LT(halves()[0], -10);
}

TEST_F(Gaussians, AreUprightBeforeAnEyeThatIsGiven) {
  const RunResult result = render({"--eye=0,0,-5", "--target=0,0,0"});
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  EXPECT_TRUE(contains(result.errors, "--up sets another")) << result.errors;
  EXPECT_GT(halves()[0], 10);
}

TEST_F(Gaussians, PicturesOfFloatsHaveDepths) {
  ASSERT_EQ(render({"--quiet"}, "p.exr").exit_code, 0);
  const std::string bytes = read_text(folder_ / "p.exr");
  EXPECT_TRUE(contains(bytes, "Z.mean"));
  EXPECT_TRUE(contains(bytes, "worldToCamera"));
}

TEST_F(Gaussians, PicturesSayByWhichProfileTheyWereMade) {
  for (const char* picture : {"p.png", "p.exr"}) {
    ASSERT_EQ(render({"--profile", "gsplat"}, picture).exit_code, 0);
    const std::string bytes = read_text(folder_ / picture);
    EXPECT_TRUE(contains(bytes, "Profile")) << picture;
    EXPECT_TRUE(contains(bytes, "gsplat")) << picture;
  }
}

TEST_F(Gaussians, ParallelRaysAndMapsAreDrawn) {
  const RunResult parallel = render({"--ortho", "4"});
  ASSERT_EQ(parallel.exit_code, 0) << parallel.errors;
  EXPECT_GT(halves()[0], 10);
  const RunResult map =
      run({tool("surfel-render"), splats_, "--map", "0.1", "-o", folder_ / "m.png"});
  EXPECT_EQ(map.exit_code, 0) << map.errors;
  EXPECT_TRUE(std::filesystem::exists(folder_ / "m.pgw"));
}

TEST_F(Gaussians, SeveralFilesAreJoined) {
  GaussianCloud upper = two_gaussians();
  GaussianCloud lower = two_gaussians();
  for (GaussianCloud* cloud : {&upper, &lower}) {
    const std::size_t drop = cloud == &upper ? 1 : 0;
    for (auto* column : {&cloud->position, &cloud->scale}) {
      column->erase(column->begin() + static_cast<std::ptrdiff_t>(drop));
    }
    cloud->rotation.pop_back();
    cloud->amplitude.pop_back();
    const auto from = cloud->harmonics.begin() + static_cast<std::ptrdiff_t>(3 * drop);
    cloud->harmonics.erase(from, from + 3);
  }
  write_gaussians(upper, folder_ / "a.ply");
  write_gaussians(lower, folder_ / "b.ply");
  ASSERT_EQ(render({}).exit_code, 0);
  const RunResult drawn = run({tool("surfel-render"), folder_ / "a.ply", folder_ / "b.ply", "-o",
                               folder_ / "ab.png", "--size", "64"});
  ASSERT_EQ(drawn.exit_code, 0) << drawn.errors;
  EXPECT_EQ(read_image(folder_ / "ab.png", true).data, read_image(folder_ / "p.png", true).data);
  const RunResult joined =
      run({tool("surfel-convert"), folder_ / "a.ply", folder_ / "b.ply", "-o", folder_ / "ab.ply"});
  ASSERT_EQ(joined.exit_code, 0) << joined.errors;
  EXPECT_EQ(read_gaussians(folder_ / "ab.ply").size(), 2u);
  upper.rule = AmplitudeRule::kDensity;
  write_gaussians(upper, folder_ / "a.ply");
  const RunResult mixed =
      run({tool("surfel-render"), folder_ / "a.ply", folder_ / "b.ply", "-o", folder_ / "c.png"});
  EXPECT_EQ(mixed.exit_code, 1) << mixed.errors;
  EXPECT_TRUE(contains(mixed.errors, "b.ply: has opacities")) << mixed.errors;
  write_text(folder_ / "points.xyz", "0 0 0\n1 0 0\n0 1 0\n");
  const RunResult points =
      run({tool("surfel-render"), splats_, folder_ / "points.xyz", "-o", folder_ / "c.png"});
  EXPECT_EQ(points.exit_code, 2) << points.errors;
  EXPECT_TRUE(contains(points.errors, "points.xyz")) << points.errors;
  EXPECT_FALSE(std::filesystem::exists(folder_ / "c.png"));
}

TEST_F(Gaussians, TurntablesAndPanoramasAreDrawn) {
  ASSERT_EQ(render({"--turntable", "3"}, "t_%d.png").exit_code, 0);
  EXPECT_TRUE(std::filesystem::exists(folder_ / "t_2.png"));
  const RunResult panorama =
      run({tool("surfel-render"), splats_, "-o", folder_ / "all.png", "--projection",
           "equirectangular", "--eye", "0,0,-3", "--size", "128x64"});
  EXPECT_EQ(panorama.exit_code, 0) << panorama.errors;
}

TEST_F(Gaussians, OptionsWithoutEffectAreRefused) {
  for (const Words& words :
       {Words{"--shading", "phong"}, Words{"--layers", "3"}, Words{"--color-by", "x"},
        Words{"--reference"}, Words{"--lowpass", "1"}, Words{"--profile", "mip", "--lowpass", "1"},
        Words{"--profile", "3dgs"}, Words{"--every", "2"}, Words{"--samples", "2"},
        Words{"--profile", "surfel", "--samples", "2"}}) {
    const RunResult result = render(words);
    EXPECT_EQ(result.exit_code, 2) << words.front() << ": " << result.errors;
    EXPECT_TRUE(contains(result.errors, words[words.size() > 3 ? 2 : 0])) << result.errors;
  }
  EXPECT_FALSE(std::filesystem::exists(folder_ / "p.png"));
  EXPECT_EQ(render({"--profile", "exact", "--lowpass", "1"}).exit_code, 0);
  for (const char* samples : {"0", "5"}) {
    const RunResult result = render({"--profile", "exact", "--samples", samples});
    EXPECT_EQ(result.exit_code, 2);
    EXPECT_TRUE(contains(result.errors, "--samples is")) << result.errors;
  }
}

TEST_F(Gaussians, SamplesAreFilteredAfterTheyAreBlended) {
  ASSERT_EQ(render({"--profile", "exact", "--samples", "1"}, "one.exr").exit_code, 0);
  ASSERT_EQ(render({"--profile", "exact"}, "default.exr").exit_code, 0);
  ASSERT_EQ(render({"--profile", "exact", "--samples", "2"}, "two.exr").exit_code, 0);
  const Image one = read_image(folder_ / "one.exr", false);
  EXPECT_EQ(read_image(folder_ / "default.exr", false).data, one.data);
  EXPECT_NE(read_image(folder_ / "two.exr", false).data, one.data);
}

TEST_F(Gaussians, ProfilesAreOfGaussiansAlone) {
  write_text(folder_ / "points.xyz", "0 0 0\n1 0 0\n0 1 0\n");
  const RunResult result = run(
      {tool("surfel-render"), folder_ / "points.xyz", "--profile", "mip", "-o", folder_ / "p.png"});
  EXPECT_EQ(result.exit_code, 2);
  EXPECT_TRUE(contains(result.errors, "--profile")) << result.errors;
}

TEST_F(Gaussians, BrokenFilesAreNamedAndLeaveNothing) {
  const std::string bytes = read_text(splats_);
  write_text(splats_, bytes.substr(0, bytes.size() - 9));
  const RunResult result = render({});
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_TRUE(contains(result.errors, "two.ply")) << result.errors;
  EXPECT_EQ(entries(folder_ / ""), Words{"two.ply"});
}

/// A sphere of splats with and without levels of detail, made once.
struct SplatSphere {
  TemporaryFolder folder;
  std::string plain = folder / "plain.ply";
  std::string levels = folder / "levels.ply";

  SplatSphere() {
    const std::string surfels = folder / "surfels.ply";
    run({tool("surfel-generate"), "sphere", "--count", "6000", "-o", surfels, "--quiet"});
    run({tool("surfel-convert"), surfels, "--gaussians", "-o", plain, "--quiet"});
    run({tool("surfel-lod"), plain, "-o", levels, "--quiet"});
  }
  static const SplatSphere& get() {
    static const SplatSphere sphere;
    return sphere;
  }
};

class LevelsOfGaussians : public testing::Test {
 protected:
  RunResult render(const std::string& file, Words words) const {
    words.insert(words.begin(), {tool("surfel-render"), file});
    words.insert(words.end(), {"-o", folder_ / "p.png", "--size", "48", "--stats", stats_});
    return run(words);
  }
  /// The picture's bytes.
  std::string picture(const std::string& file, const Words& words) const {
    const RunResult result = render(file, words);
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    return read_text(folder_ / "p.png");
  }
  double drawn() const {
    return nlohmann::json::parse(read_text(stats_))["frames"][0]["splats"].get<double>();
  }

  TemporaryFolder folder_;
  std::string stats_ = folder_ / "stats.json";
  const SplatSphere& sphere_ = SplatSphere::get();
};

TEST_F(LevelsOfGaussians, AreStreamedToTheSamePicture) {
  for (const char* profile : {"inria", "exact"}) {
    for (const char* eye : {"--eye=0,0,3", "--eye=0,0.2,1.2"}) {
      const Words view{"--profile", profile, eye, "--target=0,0,0"};
      Words streamed = view;
      streamed.insert(streamed.end(), {"--lod", "on", "--lod-error", "0", "--memory", "3M"});
      Words whole = view;
      whole.insert(whole.end(), {"--lod", "off"});
      EXPECT_EQ(picture(sphere_.levels, streamed), picture(sphere_.levels, whole)) << eye;
    }
  }
}

TEST_F(LevelsOfGaussians, PicturesFromAfarDrawFewer) {
  picture(sphere_.levels, {"--eye=0,0,40", "--target=0,0,0"});
  EXPECT_LT(drawn(), 600);
  picture(sphere_.levels, {"--eye=0,0,40", "--target=0,0,0", "--lod", "off"});
  EXPECT_EQ(drawn(), 6000);
  // A scene is framed alike.
  picture(sphere_.levels, {"--lod-error", "0"});
  const std::string view = nlohmann::json::parse(read_text(stats_))["view"];
  picture(sphere_.levels, {"--lod", "off"});
  EXPECT_EQ(nlohmann::json::parse(read_text(stats_))["view"], view);
}

TEST_F(LevelsOfGaussians, WhatDoesNotFitIntoMemorySaysWhatHelps) {
  const RunResult whole = render(sphere_.plain, {"--memory", "500K"});
  EXPECT_EQ(whole.exit_code, 1);
  EXPECT_TRUE(contains(whole.errors, "plain.ply: to draw 6000 Gaussians takes 0.894 MB"))
      << whole.errors;
  EXPECT_TRUE(contains(whole.errors, "surfel-lod")) << whole.errors;
  const RunResult levels = render(sphere_.levels, {"--memory", "500K", "--lod-error", "0"});
  EXPECT_EQ(levels.exit_code, 1);
  EXPECT_TRUE(contains(levels.errors, "--lod-error")) << levels.errors;
  EXPECT_FALSE(std::filesystem::exists(folder_ / "p.png"));
  EXPECT_EQ(
      render(sphere_.levels, {"--memory", "500K", "--eye=0,0,40", "--target=0,0,0"}).exit_code, 0);
}

TEST_F(LevelsOfGaussians, OtherToolsUseTheFinestLevel) {
  const std::string out = folder_ / "out.ply";
  const RunResult result = run({tool("surfel-convert"), sphere_.levels, "-o", out});
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  EXPECT_TRUE(contains(result.errors, "the finest alone is used, 6000 of")) << result.errors;
  EXPECT_EQ(read_gaussians(out).size(), 6000U);
  const RunResult info = run({tool("surfel-info"), sphere_.levels, "--json"});
  EXPECT_EQ(nlohmann::json::parse(info.output)["levels"][0], 6000U);
  EXPECT_EQ(nlohmann::json::parse(info.output)["levels"][1], 2000U);
  const RunResult missing = render(sphere_.plain, {"--lod", "on"});
  EXPECT_EQ(missing.exit_code, 1);
  EXPECT_TRUE(contains(missing.errors, "plain.ply: has no levels of detail; run surfel-lod on it"))
      << missing.errors;
  EXPECT_EQ(run({tool("surfel-lod"), sphere_.plain, "--normal-angle", "9", "-o", out}).exit_code,
            2);
  EXPECT_EQ(run({tool("surfel-lod"), sphere_.plain, "-o", folder_ / "a.splat"}).exit_code, 2);
}

}  // namespace
}  // namespace surfel::test
