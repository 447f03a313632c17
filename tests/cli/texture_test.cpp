// surfel-texture as a user runs it.

#include <cmath>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <surfel/io/cloud_io.h>
#include <surfel/io/image_io.h>
#include <surfel/scene/image.h>

#include "support/run_tool.h"
#include "texture/relief_support.h"
#include "texture/texture_support.h"

namespace surfel::test {
namespace {

class SurfelTexture : public testing::Test {
 protected:
  void SetUp() override {
    SurfelCloud cloud;
    cloud.position = {Vec3f(0.25F, 0.25F, 0), Vec3f(0.75F, 0.75F, 0)};
    cloud.uv = {Vec2f(0.25F, 0.25F), Vec2f(0.75F, 0.75F)};
    cloud.normal.assign(2, Vec3f(0, 0, 1));
    cloud.dpdu.assign(2, Vec3f(1, 0, 0));
    cloud.dpdv.assign(2, Vec3f(0, 1, 0));
    cloud.variance.assign(2, 1e-4F);
    cloud.basis_cutoff = 1;
    write_cloud(cloud, surfels_);
    // Rows 0 to 15, v > 1/2, are white; the others red.
    write_image(make_image(32, 32,
                           [](int, int y) {
                             return y < 16 ? Eigen::Vector4f(1, 1, 1, 1)
                                           : Eigen::Vector4f(1, 0, 0, 1);
                           }),
                image_);
    write_text(mesh_,
               "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
               "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n");
    write_text(folder_ / "m.mtl", "newmtl m\nmap_Kd image.png\n");
  }
  RunResult texture(const std::vector<std::string>& arguments) const {
    std::vector<std::string> command{tool("surfel-texture")};
    command.insert(command.end(), arguments.begin(), arguments.end());
    return run(command);
  }
  void expect_red_and_white() const {
    const SurfelCloud cloud = read_cloud(output_);
    ASSERT_EQ(cloud.coefficient.size(), 2U);
    EXPECT_TRUE(cloud.coefficient[0].isApprox(Vec3f(1, 0, 0), 1e-4F)) << cloud.coefficient[0];
    EXPECT_TRUE(cloud.coefficient[1].isApprox(Vec3f(1, 1, 1), 1e-4F)) << cloud.coefficient[1];
    // For viewers that do not know coefficients.
    EXPECT_EQ(cloud.color_encoding, ColorEncoding::kUint8Srgb);
    ASSERT_EQ(cloud.color.size(), 2U);
    EXPECT_EQ(cloud.color[0], Vec3f(1, 0, 0));
    EXPECT_EQ(cloud.color[1], Vec3f(1, 1, 1));
  }

  TemporaryFolder folder_;
  std::string surfels_ = folder_ / "surfels.ply";
  std::string image_ = folder_ / "image.png";
  std::string mesh_ = folder_ / "m.obj";
  std::string output_ = folder_ / "out.ply";
};

TEST_F(SurfelTexture, WritesCoefficientsAndKeepsTheRest) {
  const RunResult result = texture({surfels_, "--image", image_, "--fit", "ewa", "-o", output_,
                                    "--stats", folder_ / "stats.json"});
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  expect_red_and_white();
  const SurfelCloud cloud = read_cloud(output_);
  EXPECT_EQ(cloud.uv[1], Vec2f(0.75F, 0.75F));
  EXPECT_FALSE(cloud.basis_cutoff);
  ASSERT_EQ(cloud.provenance.size(), 1U);
  EXPECT_TRUE(contains(cloud.provenance[0], "surfel-texture"));
  EXPECT_TRUE(contains(cloud.provenance[0], "--fit ewa"));
  const auto stats = nlohmann::json::parse(read_text(folder_ / "stats.json"));
  EXPECT_EQ(stats["surfels"], 2);
  EXPECT_EQ(stats["without_uv"], 0);
  EXPECT_EQ(stats["coefficient_max"][0], 1);
}

TEST_F(SurfelTexture, TakesTheImagesOfTheMeshsMaterials) {
  const RunResult result = texture({surfels_, "--mesh", mesh_, "-o", output_});
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  expect_red_and_white();
}

TEST_F(SurfelTexture, BendsNormalsAlone) {
  const Vec3d tilt(0.6, 0, 0.8);
  const std::string map = folder_ / "n.ppm";
  write_relief(map, 4, 4, false, [&](int, int) { return normal_code(tilt); });
  const std::string stats = folder_ / "stats.json";
  const RunResult result =
      texture({surfels_, "--normal-map", map, "-o", output_, "--stats", stats});
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  EXPECT_TRUE(contains(result.errors, "normals from " + map + " for 2 of 2 surfels"));
  const SurfelCloud cloud = read_cloud(output_);
  EXPECT_TRUE(cloud.coefficient.empty());
  EXPECT_EQ(cloud.normal[0], Vec3f(0, 0, 1));
  ASSERT_EQ(cloud.shading_normal.size(), 2U);
  EXPECT_LT((cloud.shading_normal[0] - tilt.cast<float>()).norm(), 1e-4F);
  const auto report = nlohmann::json::parse(read_text(stats));
  EXPECT_EQ(report["normals"]["mapped"], 2);
  EXPECT_NEAR(report["normals"]["mean_tilt"].get<double>(), 36.87, 0.01);

  ASSERT_EQ(texture({surfels_, "--bump", "noise:4", "--bump-scale", "0.1", "--image", image_, "-o",
                     output_})
                .exit_code,
            0);
  expect_red_and_white();
  EXPECT_EQ(read_cloud(output_).shading_normal.size(), 2U);
}

TEST_F(SurfelTexture, TakesTheReliefOfTheMeshsMaterials) {
  write_relief(folder_ / "n.ppm", 4, 4, false, [&](int, int) {
    return normal_code({0, 0.6, 0.8});
  });
  write_text(folder_ / "m.mtl", "newmtl m\nmap_Kd image.png\nnorm n.ppm\n");
  const RunResult result = texture({surfels_, "--mesh", mesh_, "-o", output_});
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  EXPECT_TRUE(contains(result.errors, "normals from the materials of " + mesh_)) << result.errors;
  expect_red_and_white();
  const SurfelCloud up = read_cloud(output_);
  ASSERT_EQ(up.shading_normal.size(), 2U);
  EXPECT_LT((up.shading_normal[0] - Vec3f(0, 0.6F, 0.8F)).norm(), 1e-4F);
  ASSERT_EQ(texture({surfels_, "--mesh", mesh_, "--normal-y", "down", "-o", output_}).exit_code, 0);
  EXPECT_LT((read_cloud(output_).shading_normal[0] - Vec3f(0, -0.6F, 0.8F)).norm(), 1e-4F);
  ASSERT_EQ(texture({surfels_, "--mesh", mesh_, "--no-normal-maps", "-o", output_}).exit_code, 0);
  EXPECT_TRUE(read_cloud(output_).shading_normal.empty());
  expect_red_and_white();

  write_text(folder_ / "m.mtl", "newmtl m\nmap_Kd image.png\nbump gone.png\n");
  const RunResult missing = texture({surfels_, "--mesh", mesh_, "-o", folder_ / "none.ply"});
  EXPECT_EQ(missing.exit_code, 1);
  EXPECT_TRUE(contains(missing.errors, folder_ / "gone.png")) << missing.errors;
}

TEST_F(SurfelTexture, RefusesReliefOptionsWithoutEffect) {
  const std::string map = folder_ / "n.ppm";
  write_relief(map, 4, 4, false, [&](int, int) { return normal_code({0, 0, 1}); });
  for (std::vector<std::string> arguments : std::vector<std::vector<std::string>>{
           {"--normal-map", map, "--bump", image_},
           {"--normal-map", map, "--bump-scale", "2"},
           {"--normal-map", map, "--no-normal-maps"},
           {"--normal-map", map, "--normal-y", "left"},
           {"--normal-map", map, "--fit", "render"},
           {"--bump", image_, "--normal-y", "down"},
           {"--bump", image_, "--bump-scale", "nan"},
           {"--bump", image_, "--from", "colors", "--fit", "gram"},
           {"--image", image_, "--bump-scale", "2"},
           {"--image", image_, "--normal-y", "down"},
           {"--image", image_, "--no-normal-maps"},
           {"--mesh", mesh_, "--bump-scale", "2"}}) {
    arguments.insert(arguments.begin(), {surfels_, "-o", output_});
    const RunResult result = texture(arguments);
    EXPECT_EQ(result.exit_code, 2) << arguments[3] << " " << result.errors;
    EXPECT_FALSE(result.errors.empty());
    EXPECT_FALSE(std::filesystem::exists(output_));
  }
}

TEST_F(SurfelTexture, RefusesWrongUsage) {
  const std::vector<std::vector<std::string>> wrong{{"--image", image_, "--fit", "best"},
                                                    {"--image", image_, "--lambda", "much"},
                                                    {"--image", image_, "--bounds", "1,0"},
                                                    {"--from", "colors"},
                                                    {"--from", "colors", "--image", image_},
                                                    {"--image", image_, "--solver", "ceres"},
                                                    {"--image", image_, "--robust", "auto"},
                                                    {"--image", image_, "--refine-variance"},
                                                    {"--image", image_, "--wrap", "around"},
                                                    {"--image", image_, "--max-aspect", "x"},
                                                    {"--image", image_, "--reconstruction", "0"},
                                                    {"--image", "checker:none"},
                                                    {}};
  std::vector<std::vector<std::string>> all = wrong;
  for (const std::vector<std::string>& more :
       std::vector<std::vector<std::string>>{{"--robust", "0"},
                                             {"--robust", "much"},
                                             {"--robust", "auto", "--bounds", "0,1"},
                                             {"--robust", "auto", "--refine-variance"},
                                             {"--bounds", "0,1", "--refine-variance"},
                                             {"--bounds", "0,1", "--solver", "ceres"},
                                             {"--solver", "magic"},
                                             {"--fit", "gram", "--robust", "auto"},
                                             {"--from", "colors", "--refine-variance"}}) {
    all.push_back({"--fit", "render"});
    if (more[0] == "--fit") all.back().clear();
    if (more[0] != "--from") all.back().insert(all.back().end(), {"--image", image_});
    all.back().insert(all.back().end(), more.begin(), more.end());
  }
  for (std::vector<std::string> arguments : all) {
    arguments.insert(arguments.begin(), {surfels_, "-o", output_});
    const RunResult result = texture(arguments);
    EXPECT_EQ(result.exit_code, 2) << result.errors;
    EXPECT_FALSE(result.errors.empty());
    EXPECT_FALSE(std::filesystem::exists(output_));
  }
}

TEST_F(SurfelTexture, FitsForARenderersCutoff) {
  const std::string stats = folder_ / "stats.json";
  const RunResult result = texture({surfels_, "-o", output_, "--image", image_, "--fit", "render",
                                    "--cutoff", "2", "--bounds", "0,1", "--stats", stats});
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  const SurfelCloud cloud = read_cloud(output_);
  EXPECT_EQ(cloud.basis_cutoff, 2);
  for (const Vec3f& w : cloud.coefficient) {
    ASSERT_GE(w.minCoeff(), 0);
    ASSERT_LE(w.maxCoeff(), 1);
  }
  const nlohmann::json report = nlohmann::json::parse(read_text(stats));
  EXPECT_EQ(report["system"]["functions"], cloud.size());
  EXPECT_NEAR(report["system"]["condition"].get<double>(), 1, 1e-6);
  EXPECT_TRUE(report["system"]["converged"].get<bool>());
  const RunResult again = texture({output_, "-o", folder_ / "ceres.ply", "--image", image_, "--fit",
                                   "gram", "--solver", "ceres"});
  EXPECT_EQ(again.exit_code, 0) << again.errors;
}

TEST_F(SurfelTexture, ReportsRobustFitsAndRefinedVariances) {
  const std::string stats = folder_ / "stats.json";
  const auto system = [&](const std::vector<std::string>& more) {
    std::vector<std::string> arguments{surfels_, "-o",     output_,   "--image", image_,
                                       "--fit",  "render", "--stats", stats};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const RunResult result = texture(arguments);
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    return nlohmann::json::parse(read_text(stats))["system"];
  };
  for (const char* solver : {"cg", "ceres"}) {
    const nlohmann::json robust = system({"--robust", "0.25", "--solver", solver})["robust"];
    EXPECT_EQ(robust["scale"], 0.25);
    EXPECT_EQ(robust["down_weighted"], 0);
  }
  const nlohmann::json refined = system({"--refine-variance"})["variance"];
  EXPECT_LE(refined["objective"], refined["objective_start"]);
  EXPECT_LE(refined["sigma_min"], refined["sigma_max"]);
  EXPECT_FALSE(system({"--solver", "ceres"}).contains("robust"));
}

TEST_F(SurfelTexture, OptionsOfTheRenderFitAreRefusedWithoutIt) {
  for (const char* fit : {"ewa", "gram"}) {
    for (const auto& [option, value] : {std::pair{"--cutoff", "2"}, {"--points", "4"}}) {
      const RunResult result =
          texture({surfels_, "-o", output_, "--image", image_, "--fit", fit, option, value});
      EXPECT_EQ(result.exit_code, 2) << fit << option;
      EXPECT_NE(result.errors.find(std::string(option) + " has no effect"), std::string::npos)
          << result.errors;
      EXPECT_FALSE(std::filesystem::exists(output_));
    }
  }
}

TEST_F(SurfelTexture, RightSidesOfTheGramFit) {
  const auto fit = [&](const std::vector<std::string>& more) {
    std::vector<std::string> arguments{surfels_, "-o", output_};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return texture(arguments);
  };
  const std::vector<std::vector<std::string>> refused{
      {"--image", image_, "--right-side", "published"},
      {"--image", image_, "--fit", "render", "--right-side", "normalised"},
      {"--image", image_, "--fit", "gram", "--right-side", "none"},
      {"--from", "colors", "--fit", "gram", "--right-side", "published"}};
  SurfelCloud cloud = read_cloud(surfels_);
  cloud.color = {Vec3f(1, 0, 0), Vec3f(1, 1, 1)};
  write_cloud(cloud, surfels_);
  for (const std::vector<std::string>& arguments : refused) {
    const RunResult result = fit(arguments);
    EXPECT_EQ(result.exit_code, 2) << result.errors;
    EXPECT_TRUE(contains(result.errors, "--right-side")) << result.errors;
    EXPECT_FALSE(std::filesystem::exists(output_));
  }
  EXPECT_EQ(fit({"--from", "colors", "--fit", "gram", "--right-side", "normalised"}).exit_code, 0);
}

TEST_F(SurfelTexture, SaysThatThePublishedRightSideNeedsAreas) {
  const auto told = [&](const std::vector<std::string>& more) {
    std::vector<std::string> arguments{surfels_, "-o", output_, "--image", image_};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const RunResult result = texture(arguments);
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    return contains(result.errors, "have no area");
  };
  EXPECT_TRUE(told({"--fit", "gram"}));
  EXPECT_FALSE(told({"--fit", "gram", "--right-side", "normalised"}));
  EXPECT_FALSE(told({"--fit", "ewa"}));
  EXPECT_FALSE(told({"--fit", "render"}));
  SurfelCloud cloud = read_cloud(surfels_);
  cloud.area.assign(2, 1e-4F);
  write_cloud(cloud, surfels_);
  EXPECT_FALSE(told({"--fit", "gram"}));
}

TEST_F(SurfelTexture, TakesSolidTexturesWithoutUv) {
  SurfelCloud bare;
  bare.position = {Vec3f(0, 0, 0), Vec3f(0.9F, 0, 0), Vec3f(2, 2, 2)};
  bare.normal.assign(3, Vec3f(0, 0, 1));
  bare.variance.assign(3, 1e-4F);
  write_cloud(bare, surfels_);
  const std::string stats = folder_ / "stats.json";
  const auto colors = [&](const std::vector<std::string>& more) {
    std::vector<std::string> arguments{surfels_, "-o", output_, "--stats", stats};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const RunResult result = texture(arguments);
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    return read_cloud(output_).coefficient;
  };
  const Array<Vec3f> checker = colors({"--solid", "checker", "--feature-size", "1", "--center",
                                       "0,0,0", "--dark", "0.5,0,0", "--light", "0,1,0"});
  ASSERT_EQ(checker.size(), 3U);
  EXPECT_TRUE(checker[0].isApprox(Vec3f(0, 1, 0), 1e-5F)) << checker[0];
  EXPECT_TRUE(checker[1].isApprox(Vec3f(0.5F, 0, 0), 1e-5F)) << checker[1];
  EXPECT_EQ(nlohmann::json::parse(read_text(stats))["feature_size"], 1);
  for (const std::string name : {"noise", "marble", "wood"}) {
    const Array<Vec3f> some = colors({"--solid", name + ":5", "--seed", "3", "--octaves", "4"});
    EXPECT_EQ(some,
              colors({"--solid", name + ":5", "--seed", "3", "--octaves", "4", "--threads", "3"}));
    EXPECT_NE(some, colors({"--solid", name + ":5", "--seed", "4", "--octaves", "4"}));
    EXPECT_NEAR(nlohmann::json::parse(read_text(stats))["feature_size"], std::sqrt(12.0) / 5, 1e-6);
  }
  colors({"--solid", "wood", "--fit", "render", "--cutoff", "2"});
  EXPECT_EQ(read_cloud(output_).basis_cutoff, 2);
}

TEST_F(SurfelTexture, RefusesWrongUsageOfSolidTextures) {
  const std::vector<std::pair<std::vector<std::string>, std::string>> cases{
      {{"--solid", "oak"}, "checker, noise, marble, wood"},
      {{"--solid", "wood:"}, "--solid"},
      {{"--solid", "wood:x"}, "--solid"},
      {{"--solid", "wood:3", "--feature-size", "1"}, "--feature-size"},
      {{"--solid", "wood", "--feature-size", "0"}, "--feature-size"},
      {{"--solid", "wood", "--octaves", "17"}, "--octaves"},
      {{"--solid", "wood", "--dark", "0,-1,0"}, "--dark"},
      {{"--solid", "wood", "--dark", "0,1"}, "--dark"},
      {{"--solid", "wood", "--center", "0,nan,0"}, "--center"},
      {{"--solid", "checker", "--octaves", "3"}, "--octaves"},
      {{"--solid", "checker", "--seed", "3"}, "--seed"},
      {{"--solid", "wood", "--image", image_}, "--image"},
      {{"--solid", "wood", "--mesh", mesh_}, "--mesh"},
      {{"--solid", "wood", "--wrap", "clamp"}, "--wrap"},
      {{"--solid", "wood", "--exact"}, "--exact"},
      {{"--solid", "wood", "--from", "colors", "--fit", "gram"}, "--from"},
      {{"--solid", "wood", "--cutoff", "2"}, "--cutoff"},
      {{"--image", image_, "--feature-size", "1"}, "--feature-size"},
      {{"--image", image_, "--seed", "1"}, "--seed"}};
  for (auto [arguments, named] : cases) {
    arguments.insert(arguments.end(), {surfels_, "-o", output_});
    const RunResult result = texture(arguments);
    EXPECT_EQ(result.exit_code, 2) << named;
    EXPECT_TRUE(contains(result.errors, named)) << result.errors;
    EXPECT_FALSE(std::filesystem::exists(output_));
  }
}

TEST_F(SurfelTexture, FailsWithoutATraceWhereInputIsMissingOrDamaged) {
  const std::string damaged = folder_ / "damaged.png";
  write_text(damaged, "\x89PNG\r\n\x1a\n and then nothing");
  SurfelCloud points;
  points.position = {Vec3f(0, 0, 0)};
  write_cloud(points, folder_ / "points.ply");
  const std::vector<std::pair<std::vector<std::string>, std::string>> cases{
      {{surfels_, "--image", damaged}, damaged},
      {{surfels_, "--image", folder_ / "none.png"}, folder_ / "none.png"},
      {{folder_ / "none.ply", "--image", image_}, folder_ / "none.ply"},
      {{surfels_, "--mesh", folder_ / "none.obj"}, folder_ / "none.obj"},
      {{folder_ / "points.ply", "--image", image_}, "surfel-from-mesh"}};
  for (auto [arguments, named] : cases) {
    arguments.insert(arguments.end(), {"-o", output_});
    const RunResult result = texture(arguments);
    EXPECT_EQ(result.exit_code, 1) << named;
    EXPECT_TRUE(contains(result.errors, named)) << result.errors;
    EXPECT_FALSE(std::filesystem::exists(output_));
  }
}

TEST_F(SurfelTexture, NeedsLittleMemoryForALargeImage) {
#ifdef __SANITIZE_THREAD__
  GTEST_SKIP() << "the sanitizer's own memory is several times what is measured";
#endif
  // 256 MB as floats.
  const std::string large = folder_ / "large.png";
  {
    Image image;
    image.width = image.height = 4096;
    image.channels = {"R", "G", "B", "A"};
    image.data.assign(std::size_t{4096} * 4096 * 4, 1.0F);
    write_image(image, large);
  }
  const auto peak = [&](const std::string& image) {
    const std::string stats = folder_ / "stats.json";
    const RunResult result = texture({surfels_, "--image", image, "-o", output_, "--stats", stats});
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    return nlohmann::json::parse(read_text(stats))["peak_memory_bytes"].get<double>();
  };
#ifdef __SANITIZE_ADDRESS__
  const double most = 128e6;  // What is freed is kept for a while.
#else
  const double most = 64e6;
#endif
  const double base = peak(image_);
  EXPECT_LT(peak(large) - base, most);
}

TEST_F(SurfelTexture, RefusesImagesThatAreCutOrTooLarge) {
  const std::string cut = folder_ / "cut.png";
  write_image(noise_image(200, 200, 1), image_);
  const std::string bytes = read_text(image_);
  write_text(cut, bytes.substr(0, bytes.size() / 2));
  // 10^6 x 10^6 pixels of four channels, without any.
  const std::string huge = folder_ / "huge.tif";
  std::string tiff("II*\0\x08\0\0\0", 8);
  const auto number = [&](unsigned value, int size) {
    for (int i = 0; i < size; ++i) tiff += static_cast<char>(value >> 8 * i & 0xff);
  };
  const std::vector<std::pair<unsigned, unsigned>> tags{
      {256, 1000000}, {257, 1000000}, {258, 8},       {259, 1},   {262, 1},
      {273, 8},       {277, 1},       {278, 1000000}, {279, 1000}};
  number(static_cast<unsigned>(tags.size()), 2);
  for (const auto& [tag, value] : tags) {
    number(tag, 2);
    number(4, 2);
    number(1, 4);
    number(value, 4);
  }
  number(0, 4);
  write_text(huge, tiff);
  for (const std::string& image : {cut, huge}) {
    const RunResult result = texture({surfels_, "--image", image, "-o", output_});
    EXPECT_EQ(result.exit_code, 1) << image;
    EXPECT_TRUE(contains(result.errors, image)) << result.errors;
    EXPECT_FALSE(std::filesystem::exists(output_));
  }
}

}  // namespace
}  // namespace surfel::test
