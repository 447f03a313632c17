// surfel-lod, and the other tools on what it writes.

#include <algorithm>
#include <filesystem>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <surfel/io/cloud_io.h>
#include <surfel/io/image_io.h>
#include <surfel/scene/image.h>
#include <surfel/truth/image_error.h>

#include "support/run_tool.h"

namespace surfel::test {
namespace {

/// A sphere with and without levels of detail, made once.
struct Sphere {
  TemporaryFolder folder;
  std::string plain = folder / "plain.ply";
  std::string levels = folder / "levels.ply";

  Sphere() {
    run({tool("surfel-generate"), "sphere", "--count", "8000", "-o", plain, "--quiet"});
    run({tool("surfel-lod"), plain, "-o", levels, "--quiet"});
  }
  static const Sphere& get() {
    static const Sphere sphere;
    return sphere;
  }
};

class SurfelLod : public testing::Test {
 protected:
  RunResult render(const std::string& file, const Words& options) const {
    Words command{tool("surfel-render"),
                  file,
                  "-o",
                  picture_,
                  "--size",
                  "24x24",
                  "--from",
                  "0,0.36,1",
                  "--stats",
                  folder_ / "stats.json",
                  "--quiet"};
    command.insert(command.end(), options.begin(), options.end());
    return run(command);
  }
  nlohmann::json frames(const Words& options) const {
    const RunResult result = render(Sphere::get().levels, options);
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    return nlohmann::json::parse(read_text(folder_ / "stats.json"))["frames"];
  }
  std::size_t splats(const Words& options) const {
    return frames(options).back()["splats"].get<std::size_t>();
  }

  TemporaryFolder folder_;
  std::string picture_ = folder_ / "picture.exr";
};

TEST_F(SurfelLod, WritesTheLevelsThatItReports) {
  const RunResult result = run({tool("surfel-lod"), Sphere::get().plain, "-o", folder_ / "out.ply",
                                "--reduction", "2", "--stats", folder_ / "stats.json"});
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  EXPECT_TRUE(contains(result.errors, "in 6 levels of 8000 down to")) << result.errors;
  const auto report = nlohmann::json::parse(read_text(folder_ / "stats.json"));
  const SurfelCloud cloud = read_cloud(folder_ / "out.ply", {.levels = true});
  std::vector<std::size_t> levels(6, 0);
  for (const std::uint8_t level : cloud.level) ++levels.at(level);
  EXPECT_EQ(report["levels"], nlohmann::json(levels));
  EXPECT_EQ(report["clusters"], cloud.tree.size());
  EXPECT_TRUE(contains(cloud.provenance.back(), "surfel-lod"));
  // Every option has an effect.
  const auto bytes = [&](const Words& options) {
    Words command{tool("surfel-lod"), Sphere::get().plain, "-o", folder_ / "x.ply", "--quiet"};
    command.insert(command.end(), options.begin(), options.end());
    EXPECT_EQ(run(command).exit_code, 0);
    return read_cloud(folder_ / "x.ply", {.levels = true}).position;
  };
  const auto plain = bytes({});
  EXPECT_NE(bytes({"--normal-angle", "1"}), plain);
  EXPECT_NE(bytes({"--sheet-weight", "30"}), plain);
}

TEST_F(SurfelLod, TakesTheMemoryThatItMayAndMakesTheSameOfIt) {
  // Generated surfels are in space-filling order; larger ones first are in none.
  const std::string sorted = folder_ / "sorted.ply";
  const std::string unsorted = folder_ / "unsorted.ply";
  run({tool("surfel-generate"), "terrain", "--count", "150000", "-o", sorted, "--quiet"});
  SurfelCloud cloud = read_cloud(sorted);
  std::reverse(cloud.position.begin(), cloud.position.end());
  write_cloud(cloud, unsorted);
  const auto levels = [&](const std::string& input, const std::string& memory) {
    return run({tool("surfel-lod"), input, "-o", folder_ / "out.ply", "--memory", memory, "--stats",
                folder_ / "stats.json"});
  };
  for (const std::string& input : {sorted, unsorted}) {
    ASSERT_EQ(levels(input, "auto").exit_code, 0);
    const std::string bytes = read_text(folder_ / "out.ply");
    const auto report = nlohmann::json::parse(read_text(folder_ / "stats.json"));
    EXPECT_GT(report["blocks"], 2);
    // An ordered file stays where it is.
    EXPECT_EQ(report.contains("load_ms"), input == unsorted);
    ASSERT_EQ(levels(input, "100M").exit_code, 0);
    EXPECT_TRUE(read_text(folder_ / "out.ply") == bytes);
  }
  std::filesystem::remove(folder_ / "out.ply");
  const RunResult result = levels(unsorted, "10M");
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_TRUE(contains(result.errors, "surfel-convert --sort curve")) << result.errors;
  EXPECT_TRUE(contains(levels(sorted, "1M").errors, "and --memory is 1 MB"));
  EXPECT_EQ(levels(sorted, "much").exit_code, 2);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "out.ply"));
}

TEST_F(SurfelLod, RefusesWhatItCannotWrite) {
  const RunResult result =
      run({tool("surfel-lod"), Sphere::get().plain, "-o", folder_ / "out.pcd"});
  EXPECT_EQ(result.exit_code, 2);
  EXPECT_TRUE(contains(result.errors, "use .ply")) << result.errors;
  const RunResult folder =
      run({tool("surfel-lod"), Sphere::get().plain, "-o", folder_ / "levels/"});
  EXPECT_EQ(folder.exit_code, 2);
  EXPECT_TRUE(contains(folder.errors, "name of a folder")) << folder.errors;
  EXPECT_EQ(
      run({tool("surfel-lod"), Sphere::get().plain, "-o", folder_ / "out.ply", "--reduction", "1"})
          .exit_code,
      2);
}

TEST_F(SurfelLod, RenderUsesTheLevelsUnlessToldNotTo) {
  const std::size_t off = splats({"--lod", "off"});
  const Image finest = read_image(picture_, true);
  const std::size_t automatic = splats({});
  const Image coarse = read_image(picture_, true);
  EXPECT_EQ(off, 8000U);
  EXPECT_LT(automatic, off / 2);
  EXPECT_GT(image_error(coarse, finest).psnr, 35);
  EXPECT_EQ(splats({"--lod", "on"}), automatic);
  EXPECT_EQ(splats({"--lod-error", "0"}), off);
  EXPECT_LT(splats({"--lod-error", "4"}), automatic);
  // Without a filter, splats between pixel centres are not seen.
  const std::size_t unfiltered = splats({"--filter", "none"});
  EXPECT_EQ(splats({"--filter", "none", "--lod", "off"}), unfiltered);
  EXPECT_LT(splats({"--filter", "none", "--lod", "on"}), unfiltered);
  EXPECT_LT(splats({"--lowpass", "3"}), automatic);
  // The reference takes the finest level, as do the others that do not know levels.
  for (const Words& options :
       {Words{"--reference", "--samples", "1"}, Words{"--filter", "ewa-source"},
        Words{"--method", "depth-peel"}, Words{"--method", "two-pass"}}) {
    EXPECT_EQ(render(Sphere::get().levels, options).exit_code, 0);
    EXPECT_GT(image_error(read_image(picture_, true), finest).psnr, 25) << options.back();
  }
}

TEST_F(SurfelLod, RenderRefusesLevelsWhereThereAreNone) {
  EXPECT_EQ(render(Sphere::get().plain, {}).exit_code, 0);
  for (const Words& options :
       {Words{"--lod", "on"}, Words{"--lod-error", "1"}, Words{"--progressive", "2"}}) {
    const RunResult result = render(Sphere::get().plain, options);
    EXPECT_EQ(result.exit_code, 1);
    EXPECT_TRUE(contains(result.errors, "surfel-lod")) << result.errors;
  }
  for (const Words& options :
       {Words{"--lod", "on", "--reference"}, Words{"--lod", "on", "--filter", "ewa-source"},
        Words{"--lod", "on", "--method", "deferred"}, Words{"--lod", "off", "--lod-error", "1"},
        Words{"--lod", "off", "--progressive", "2"}, Words{"--reference", "--lod-error", "1"},
        Words{"--lod-error", "-1"}, Words{"--progressive", "0"}}) {
    const RunResult result = render(Sphere::get().levels, options);
    EXPECT_EQ(result.exit_code, 2) << options.back() << result.errors;
  }
}

TEST_F(SurfelLod, ProgressiveEndsWithThePlainPicture) {
  frames({});
  const std::string plain = read_text(picture_);
  const auto steps = frames({"--progressive", "4"});
  EXPECT_EQ(read_text(picture_), plain);
  ASSERT_EQ(steps.size(), 4U);
  for (std::size_t i = 1; i < steps.size(); ++i) {
    EXPECT_LE(steps[i - 1]["splats"], steps[i]["splats"]);
  }
  EXPECT_LT(steps.front()["splats"], steps.back()["splats"]);
  // A file that was there before is kept, the own ones of earlier steps are not in the way.
  EXPECT_EQ(render(Sphere::get().levels, {"--progressive", "2", "--no-clobber"}).exit_code, 1);
  std::filesystem::remove(picture_);
  std::filesystem::remove(folder_ / "stats.json");
  EXPECT_EQ(render(Sphere::get().levels, {"--progressive", "2", "--no-clobber"}).exit_code, 0);
}

TEST_F(SurfelLod, OtherToolsTakeTheFinestLevelAndSaySo) {
  const std::string out = folder_ / "out.ply";
  const std::string& levels = Sphere::get().levels;
  for (const Words& command :
       {Words{tool("surfel-group"), levels, "-o", out},
        Words{tool("surfel-texture"), levels, "--image", "checker", "-o", out},
        Words{tool("surfel-estimate"), levels, "-o", out},
        Words{tool("surfel-lod"), levels, "-o", out}}) {
    const RunResult result = run(command);
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    EXPECT_TRUE(contains(result.errors, "the finest alone is used, 8000 of")) << result.errors;
    EXPECT_EQ(read_cloud(out).size(), 8000U) << command.front();
  }
  const RunResult info = run({tool("surfel-info"), levels, "--json"});
  const auto described = nlohmann::json::parse(info.output);
  EXPECT_EQ(described["count"], 8000);
  EXPECT_GT(described["coarser_levels"], 2000);
}

}  // namespace
}  // namespace surfel::test
