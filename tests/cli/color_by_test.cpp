// surfel-render --color-by: exact colours, the same by every way that draws, and what is refused.

#include <cmath>
#include <cstring>
#include <filesystem>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <surfel/base/color.h>
#include <surfel/base/morton.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/image_io.h>
#include <surfel/sample/generate.h>
#include <surfel/scene/color_map.h>

#include "support/run_tool.h"

namespace surfel::test {
namespace {

/// Surfels of a plane, 20 by 20, whose column `heat` is 2.5 but for the rows y >= 10, where it is
/// 7.5; `kind` is 2, and 6 in the rows y >= 10; `broken` is no number.
SurfelCloud plane() {
  SurfelCloud cloud;
  std::vector<float> heat;
  std::vector<std::uint8_t> kind;
  for (int i = 0; i < 400; ++i) {
    cloud.position.emplace_back(static_cast<float>(i % 20), static_cast<float>(i / 20), 0.0F);
    cloud.normal.emplace_back(0.0F, 0.0F, 1.0F);
    cloud.variance.push_back(0.5F);
    cloud.area.push_back(1);
    heat.push_back(i < 200 ? 2.5F : 7.5F);
    kind.push_back(i < 200 ? 2 : 6);
  }
  const auto add = [&](const char* name, ScalarType type, const void* values, std::size_t bytes) {
    ExtraProperty& column = cloud.extra.emplace_back(ExtraProperty{name, type, {}});
    column.data.resize(bytes);
    std::memcpy(column.data.data(), values, bytes);
  };
  add("heat", ScalarType::kFloat32, heat.data(), heat.size() * sizeof(float));
  add("classification", ScalarType::kUint8, kind.data(), kind.size());
  const std::vector<float> broken(400, std::nanf(""));
  add("broken", ScalarType::kFloat32, broken.data(), broken.size() * sizeof(float));
  const std::vector<float> same(400, -3.0F);
  add("same", ScalarType::kFloat32, same.data(), same.size() * sizeof(float));
  return cloud;
}

class ColorBy : public testing::Test {
 protected:
  void SetUp() override { write_cloud(plane(), surfels_); }
  RunResult render(Words words, const std::string& picture = "p.exr") const {
    words.insert(words.begin(), {tool("surfel-render"), surfels_});
    words.insert(words.end(), {"-o", folder_ / picture});
    return run(words);
  }
  /// The colour of one of two places of the plane, far from where they meet.
  Vec3f color(bool upper, const std::string& picture = "p.exr") const {
    const Image image = read_image(folder_ / picture, true);
    const float* p = image.pixel(image.width / 2, image.height * (upper ? 3 : 5) / 8);
    return {p[0], p[1], p[2]};
  }
  static void expect_near(const Vec3f& a, const Vec3f& b, float tolerance) {
    EXPECT_LT((a - b).cwiseAbs().maxCoeff(), tolerance)
        << a.transpose() << " is not " << b.transpose();
  }
  TemporaryFolder folder_;
  std::string surfels_ = folder_ / "plane.ply";
  // From above, so that the plane fills the picture.
  Words exactly_{"--from",      "0,0,1",   "--up",       "y",         "--zoom",
                 "1.5",         "--size",  "64",         "--shading", "none",
                 "--color-map", "viridis", "--color-by", "heat",      "--color-range=0,10"};
};

TEST_F(ColorBy, UnlitSurfelsShowTheMapsColour) {
  ASSERT_EQ(render(exactly_).exit_code, 0);
  expect_near(color(false), map_color(ColorMap::kViridis, 0.25), 2e-5F);
  expect_near(color(true), map_color(ColorMap::kViridis, 0.75), 2e-5F);
  ASSERT_EQ(render(exactly_, "p.png").exit_code, 0);
  const Vec3f own = map_color(ColorMap::kViridis, 0.25);
  const Vec3f shown = color(false, "p.png");
  for (int k = 0; k < 3; ++k) EXPECT_EQ(linear_to_srgb8(shown[k]), linear_to_srgb8(own[k]));
}

TEST_F(ColorBy, EveryWayThatDrawsShowsTheSameColours) {
  const RunResult grouped =
      run({tool("surfel-group"), surfels_, "-o", folder_ / "grouped.ply", "--quiet"});
  ASSERT_EQ(grouped.exit_code, 0) << grouped.errors;
  surfels_ = folder_ / "grouped.ply";
  const RunResult levels =
      run({tool("surfel-lod"), folder_ / "plane.ply", "-o", folder_ / "lod.ply", "--quiet"});
  ASSERT_EQ(levels.exit_code, 0) << levels.errors;
  for (const Words& way :
       {Words{"--reference"}, Words{"--filter", "ewa-source"}, Words{"--filter", "circular"},
        Words{"--method", "two-pass"}, Words{"--method", "deferred"},
        Words{"--method", "depth-peel"}, Words{"--method", "transparent"},
        Words{"--method", "transparent-high"}, Words{"--lod", "on"}}) {
    Words words = exactly_;
    words.insert(words.end(), way.begin(), way.end());
    surfels_ = folder_ / (way[0] == "--lod" ? "lod.ply" : "grouped.ply");
    const RunResult result = render(words);
    ASSERT_EQ(result.exit_code, 0) << result.errors;
    expect_near(color(false), map_color(ColorMap::kViridis, 0.25), 2e-3F);
    expect_near(color(true), map_color(ColorMap::kViridis, 0.75), 2e-3F);
  }
}

TEST_F(ColorBy, ClassesAndNormalsHaveTheirColours) {
  Words words{"--from", "0,0,1", "--up",      "y",    "--zoom",    "1.5",
              "--size", "64",    "--shading", "none", "--color-by"};
  words.emplace_back("classification");
  ASSERT_EQ(render(words).exit_code, 0);
  expect_near(color(false), las_class_color(2), 1e-5F);
  expect_near(color(true), las_class_color(6), 1e-5F);
  words.back() = "normal";
  ASSERT_EQ(render(words).exit_code, 0);
  expect_near(color(false), {srgb_to_linear(0.5F), srgb_to_linear(0.5F), 1}, 1e-5F);
}

TEST_F(ColorBy, ARangeIsFoundAndSaid) {
  const RunResult heat = render({"--color-by", "heat", "--size", "32"});
  ASSERT_EQ(heat.exit_code, 0) << heat.errors;
  EXPECT_TRUE(contains(heat.errors, "coloured by heat, 2.50 to 7.50")) << heat.errors;
  const RunResult same = render({"--color-by", "same", "--size", "32"});
  ASSERT_EQ(same.exit_code, 0) << same.errors;
  EXPECT_TRUE(contains(same.errors, "coloured by same, -3.00 everywhere")) << same.errors;
  Words below = exactly_;
  below.back() = "--color-range=-10,-5";
  const RunResult clamped = render(below);
  ASSERT_EQ(clamped.exit_code, 0) << clamped.errors;
  expect_near(color(false), map_color(ColorMap::kViridis, 1), 1e-5F);
}

TEST_F(ColorBy, ElevationOfAMapIsHeightNotNorth) {
  const RunResult map = render({"--color-by", "elevation", "--map", "1"});
  ASSERT_EQ(map.exit_code, 0) << map.errors;
  EXPECT_TRUE(contains(map.errors, "coloured by elevation, 0 everywhere")) << map.errors;
}

TEST_F(ColorBy, WhatCannotBeShownIsRefused) {
  const auto refused = [&](const Words& words, int code, const std::string& part) {
    const RunResult result = render(words, "none.png");
    EXPECT_EQ(result.exit_code, code) << words[1];
    EXPECT_TRUE(contains(result.errors, part)) << result.errors;
    EXPECT_FALSE(std::filesystem::exists(folder_ / "none.png"));
  };
  refused({"--color-by", "heta"}, 1, "did you mean heat?");
  refused({"--color-by", "confidence"}, 1, surfels_ + ": ");
  refused({"--color-by", "broken"}, 1, "none of the 400 surfels has a finite number as broken");
  refused({"--color-by", "heat", "--color-range", "3,3"}, 2, "the first must be the smaller one");
  refused({"--color-by", "heat", "--color-range", "3,nan"}, 2, "--color-range");
  refused({"--color-by", "normal", "--color-range", "0,1"}, 2, "has no effect");
  refused({"--color-by", "none", "--legend", "on"}, 2, "has no effect");
  refused({"--color-by", "radius", "--lod", "on"}, 2, "--lod on has no effect");
  refused({"--color-by", "heat", "--legend", "on", "--size", "255"}, 2, "256x256");
}

TEST_F(ColorBy, TheLegendComesWhereThereIsRoom) {
  const auto picture = [&](const std::string& size, const std::string& legend) {
    const RunResult result = render(
        {"--color-by", "heat", "--size", size, "--legend", legend, "--from", "0,0,1"}, "p.png");
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    return read_text(folder_ / "p.png");
  };
  EXPECT_NE(picture("256", "auto"), picture("256", "off"));
  EXPECT_EQ(picture("256", "auto"), picture("256", "on"));
  EXPECT_EQ(picture("255", "auto"), picture("255", "off"));
}

TEST_F(ColorBy, AnExplainedPixelHasTheLegendsValue) {
  const auto explained = [&](Words words) {
    words.insert(words.end(), {"--size", "64", "--from", "0,0,1", "--explain-pixel", "32,24",
                               "--stats", folder_ / "stats.json"});
    const RunResult result = render(words);
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    EXPECT_TRUE(contains(result.output, "by the legend: ")) << result.output;
    return nlohmann::json::parse(read_text(folder_ / "stats.json"))["frames"][0]["pixels"][0];
  };
  const nlohmann::json heat = explained({"--color-by", "heat", "--color-range", "0,10"});
  EXPECT_EQ(heat["legend"]["title"], "heat");
  EXPECT_NEAR(heat["legend"]["value"].get<double>(), 7.5, 0.01);
  EXPECT_NEAR(heat["splats"][0]["value"].get<double>(), 7.5, 0.01);
  const nlohmann::json kind = explained({"--color-by", "classification"});
  EXPECT_NEAR(kind["legend"]["value"]["6 building"].get<double>(), 1, 1e-3);
  EXPECT_EQ(kind["splats"][0]["value"], "6 building");
  Words plain{"--color-by", "none", "--size", "64", "--explain-pixel", "32,24"};
  EXPECT_FALSE(contains(render(plain).output, "by the legend"));
}

TEST_F(ColorBy, AColumnThatOneFileLacksIsRefused) {
  SurfelCloud other = plane();
  other.extra.erase(other.extra.begin());
  const std::string second = folder_ / "second.ply";
  write_cloud(other, second);
  const RunResult both = render({second, "--color-by", "heat", "--size", "32"});
  EXPECT_EQ(both.exit_code, 1);
  EXPECT_TRUE(contains(both.errors, second + ": there is no heat")) << both.errors;
  EXPECT_EQ(render({second, "--color-by", "same", "--size", "32"}).exit_code, 0);
}

TEST_F(ColorBy, StreamedSurfelsHaveTheSameColoursAsThoseInMemory) {
  // In the order in which memory has them, so that not even rounding differs.
  const SurfelCloud made = generate_surfels(procedural_scene("terrain", 1), {.count = 250000});
  SurfelCloud cloud = made.gathered(morton_order(made.position));
  ExtraProperty& heat = cloud.extra.emplace_back(ExtraProperty{"heat", ScalarType::kUint8, {}});
  for (std::size_t i = 0; i < cloud.size(); ++i) heat.data.push_back(std::byte(i % 251));
  surfels_ = folder_ / "terrain.ply";
  write_cloud(cloud, surfels_);
  const auto picture = [&](const std::string& by, const std::string& memory) {
    const RunResult result =
        render({"--color-by", by, "--size", "128", "--memory", memory, "--relief", "none"},
               memory + ".png");
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    EXPECT_EQ(contains(result.errors, "piece by piece"), memory == "12M") << result.errors;
    return read_image(folder_ / (memory + ".png"), true);
  };
  // Small batches may merge layers in another order, which changes a few pixels.
  for (const char* by : {"elevation", "normal", "heat"}) {
    const Image streamed = picture(by, "12M");
    const Image resident = picture(by, "1G");
    double sum = 0;
    for (std::size_t i = 0; i < streamed.data.size(); ++i) {
      sum += std::abs(streamed.data[i] - resident.data[i]);
    }
    EXPECT_LT(sum / static_cast<double>(streamed.data.size()), 1e-3) << by;
  }
}

TEST_F(ColorBy, ColourlessTerrainIsShownByElevationUnlessToldNotTo) {
  std::string points;
  for (int i = 0; i < 60 * 60; ++i) {
    const int x = i % 60;
    const int y = i / 60;
    points += std::to_string(512000 + x) + ' ' + std::to_string(5400000 + y) + ' ' +
              std::to_string(300 + 5 * std::sin(0.2 * x) + 0.1 * y) + '\n';
  }
  surfels_ = folder_ / "hills.xyz";
  write_text(surfels_, points);
  const RunResult terrain = render({"--size", "64"}, "auto.png");
  ASSERT_EQ(terrain.exit_code, 0) << terrain.errors;
  EXPECT_TRUE(contains(terrain.errors, "coloured by elevation, 295.")) << terrain.errors;
  EXPECT_TRUE(contains(terrain.errors, "--color-by none")) << terrain.errors;
  ASSERT_EQ(render({"--size", "64", "--color-by", "elevation"}, "named.png").exit_code, 0);
  EXPECT_EQ(read_text(folder_ / "auto.png"), read_text(folder_ / "named.png"));
  const RunResult grey = render({"--size", "64", "--color-by", "none"}, "grey.png");
  EXPECT_FALSE(contains(grey.errors, "coloured")) << grey.errors;
  EXPECT_NE(read_text(folder_ / "auto.png"), read_text(folder_ / "grey.png"));
}

TEST_F(ColorBy, RawPointsKeepTheirColumnsThroughEstimation) {
  // Intensity is the x coordinate; a point without a place, which is dropped, stands first.
  std::string points = "x y z intensity classification\nnan 0 0 77 1\n";
  for (int i = 0; i < 900; ++i) {
    points += std::to_string(i % 30) + ' ' + std::to_string(i / 30) + " 0 " +
              std::to_string(i % 30) + ' ' + std::to_string(i % 3) + '\n';
  }
  surfels_ = folder_ / "points.xyz";
  write_text(surfels_, points);
  const RunResult result =
      render({"--size", "32", "--keep", folder_ / "kept.ply", "--color-by", "intensity"});
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  const SurfelCloud kept = read_cloud(folder_ / "kept.ply");
  ASSERT_EQ(kept.size(), 900u);
  int found = 0;
  for (const ExtraProperty& column : kept.extra) {
    if (column.name != "intensity" && column.name != "classification") continue;
    ++found;
    std::vector<double> values(kept.size());
    load_scalars(column.type, column.data.data(), kept.size(), values.data());
    for (std::size_t i = 0; i < kept.size(); ++i) {
      const Vec3d p = kept.world(i);
      EXPECT_EQ(values[i], column.name == "intensity" ? p.x() : std::fmod(p.x(), 3.0));
    }
  }
  EXPECT_EQ(found, 2);
}

TEST_F(ColorBy, ColoursThatAreAllBlackAreNone) {
  SurfelCloud cloud = plane();
  for (ExtraProperty& column : cloud.extra) column.name += "_of_mine";
  write_cloud(cloud, folder_ / "none.ply");
  cloud.color.assign(cloud.size(), Vec3f(0, 0, 0));
  write_cloud(cloud, folder_ / "black.ply");
  cloud.color.back() = Vec3f(0, 0, 0.5F);
  write_cloud(cloud, folder_ / "blue.ply");
  const auto shown = [&](const std::string& name, const Words& more) {
    Words words{tool("surfel-render"), folder_ / name, "--shading", "none", "--from", "0,0,1", "-o",
                folder_ / "p.exr"};
    words.insert(words.end(), more.begin(), more.end());
    const RunResult made = run(words);
    EXPECT_EQ(made.exit_code, 0) << made.errors;
    return made.errors;
  };
  shown("none.ply", {});
  const Vec3f grey = color(true);
  EXPECT_GT(grey.minCoeff(), 0.2F);
  EXPECT_TRUE(contains(shown("black.ply", {}), "black.ply: all colours are black"));
  EXPECT_EQ(color(true), grey);
  EXPECT_FALSE(contains(shown("black.ply", {"--color-by", "none"}), "black,"));
  EXPECT_EQ(color(true), Vec3f(0, 0, 0));
  EXPECT_FALSE(contains(shown("blue.ply", {}), "black"));
  EXPECT_EQ(color(true), Vec3f(0, 0, 0));
  const RunResult page =
      run({tool("surfel-view"), folder_ / "black.ply", "-o", folder_ / "page.html"});
  EXPECT_TRUE(contains(page.errors, "colours, all black, are not shown")) << page.errors;
}

TEST_F(ColorBy, APictureWithoutItsReportIsNotLeft) {
  const std::string command = tool("surfel-render") + " " + surfels_ +
                              " --size 32 --explain-pixel 9,9 -o " + (folder_ / "e.png");
  EXPECT_EQ(run({"/bin/sh", "-c", command + " > /dev/full"}).exit_code, 1);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "e.png"));
  EXPECT_EQ(run({"/bin/sh", "-c", command}).exit_code, 0);
  EXPECT_TRUE(std::filesystem::exists(folder_ / "e.png"));
}

TEST_F(ColorBy, TheFileThatIsWrittenIsTold) {
  const RunResult made = render({"--size", "16"}, "{name}.png");
  EXPECT_TRUE(std::filesystem::exists(folder_ / "view.png"));
  EXPECT_TRUE(contains(made.errors, "view.png: 16x16 pixels")) << made.errors;
  EXPECT_FALSE(contains(made.errors, "{name}"));
}

TEST_F(ColorBy, NamesDoNotReachTheTerminalAsTheyAre) {
  const std::string name = folder_ / "a\033[31m\xc2\x9b.ply";
  std::filesystem::copy_file(surfels_, name);
  const RunResult info = run({tool("surfel-info"), name});
  const RunResult view = run({tool("surfel-view"), name, "--color-by", "no\x1b", "-o", "p.html"});
  EXPECT_EQ(view.exit_code, 1);
  for (const std::string& text : {info.output, info.errors, view.errors}) {
    EXPECT_FALSE(contains(text, "\033") || contains(text, "\xc2\x9b")) << text;
  }
  EXPECT_TRUE(contains(info.output, "a\\u001b[31m\\u009b.ply")) << info.output;
  EXPECT_TRUE(contains(view.errors, "named no\\u001b;")) << view.errors;
}

}  // namespace
}  // namespace surfel::test
