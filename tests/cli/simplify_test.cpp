// surfel-simplify, and pictures of what it writes.

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <surfel/io/cloud_io.h>
#include <surfel/io/gaussian_io.h>
#include <surfel/io/image_io.h>
#include <surfel/scene/image.h>
#include <surfel/truth/image_error.h>

#include "support/run_tool.h"

namespace surfel::test {
namespace {

class SurfelSimplify : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    run({tool("surfel-generate"), "head", "--count", "20000", "-o", input(), "--quiet"});
  }
  static std::string input() {
    static const TemporaryFolder folder;
    return folder / "head.ply";
  }
  RunResult simplify(const std::string& file, const Words& options) const {
    Words command{tool("surfel-simplify"), file, "-o", output_, "--stats", stats_};
    command.insert(command.end(), options.begin(), options.end());
    return run(command);
  }
  nlohmann::json report() const { return nlohmann::json::parse(read_text(stats_)); }
  Image picture(const std::string& file) const {
    const RunResult result =
        run({tool("surfel-render"), file, "-o", folder_ / "p.exr", "--size", "128x128", "--eye",
             "0.5,0.2,3.5", "--target", "0,0,0", "--quiet"});
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    return read_image(folder_ / "p.exr", true);
  }

  TemporaryFolder folder_;
  std::string output_ = folder_ / "out.ply";
  std::string stats_ = folder_ / "stats.json";
};

TEST_F(SurfelSimplify, MeetsTheErrorAndSaysSo) {
  const RunResult result = simplify(input(), {"--max-error", "0.05"});
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  EXPECT_TRUE(contains(result.errors, "of 20000 surfels, error 0.0")) << result.errors;
  const nlohmann::json told = report();
  EXPECT_LE(told["error"].get<double>(), 0.05);
  EXPECT_TRUE(told["reached"].get<bool>());
  const SurfelCloud cloud = read_cloud(output_);
  EXPECT_EQ(told["result"], cloud.size());
  EXPECT_LT(cloud.size(), 10000U);
  EXPECT_TRUE(contains(cloud.provenance.back(), "surfel-simplify"));
  EXPECT_TRUE(contains(cloud.provenance.back(), "--max-error 0.05"));
  const ImageError error = image_error(picture(output_), picture(input()));
  EXPECT_GT(error.psnr, 28);
  EXPECT_EQ(error.holes, 0);
}

TEST_F(SurfelSimplify, EveryOptionHasAnEffect) {
  const auto positions = [&](const Words& options) {
    Words all{"--count", "3000", "--quiet"};
    all.insert(all.end(), options.begin(), options.end());
    const RunResult result = simplify(input(), all);
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    const SurfelCloud cloud = read_cloud(output_);
    EXPECT_EQ(cloud.size(), 3000U);
    return cloud.position;
  };
  const auto plain = positions({});
  EXPECT_EQ(positions({"--threads", "1"}), plain);
  for (const Words& options :
       {Words{"--light", "0"}, Words{"--unit-deviation", "0.001"}, Words{"--normal-angle", "10"},
        Words{"--sheet-weight", "10"}, Words{"--seed", "2"}}) {
    EXPECT_NE(positions(options), plain) << options[0];
  }
  positions({"--cutoff", "2"});
  EXPECT_EQ(read_cloud(output_).basis_cutoff, 2.0);
}

TEST_F(SurfelSimplify, TellsWhatItLeavesOut) {
  const std::string grouped = folder_ / "grouped.ply";
  run({tool("surfel-group"), input(), "-o", grouped, "--quiet"});
  const RunResult result = simplify(grouped, {"--count", "5000"});
  EXPECT_EQ(result.exit_code, 0) << result.errors;
  EXPECT_TRUE(contains(result.errors, "group")) << result.errors;
  EXPECT_TRUE(read_cloud(output_).group.empty());
  const RunResult more = simplify(input(), {"--count", "30000"});
  EXPECT_EQ(more.exit_code, 0);
  EXPECT_TRUE(contains(more.errors, "no more than 20000 surfels")) << more.errors;
  EXPECT_FALSE(report()["reached"].get<bool>());
}

TEST_F(SurfelSimplify, RefusesBadOptionsAndBadClouds) {
  for (const Words& options :
       {Words{}, Words{"--max-error", "0.1", "--count", "5"}, Words{"--max-error", "0"},
        Words{"--max-error", "nan"}, Words{"--count", "0"}, Words{"--count", "-5"},
        Words{"--count", "5", "--light", "-1"}, Words{"--count", "5", "--normal-angle", "91"},
        Words{"--count", "5", "--sheet-weight", "0"}, Words{"--count", "5", "--cutoff", "0"},
        Words{"--count", "5", "--unit-deviation", "-1"}}) {
    const RunResult result = simplify(input(), options);
    EXPECT_EQ(result.exit_code, 2) << result.errors;
  }
  const std::string bad = folder_ / "bad.ply";
  const std::string header = "ply\nformat ascii 1.0\nelement vertex ";
  const auto refused = [&](const std::string& text, const std::string& why) {
    write_text(bad, text);
    const RunResult result = simplify(bad, {"--max-error", "0.1"});
    EXPECT_EQ(result.exit_code, 1);
    EXPECT_TRUE(contains(result.errors, why)) << result.errors;
  };
  const std::string xyz = "\nproperty float x\nproperty float y\nproperty float z\n";
  refused(header + "1" + xyz + "end_header\n1 2 3\n", "surfel-estimate");
  refused(header + "0" + xyz + "property float nx\nproperty float ny\nproperty float nz\n" +
              "property float variance\nend_header\n",
          "holds no");
  EXPECT_EQ(simplify(folder_ / "none.ply", {"--count", "5"}).exit_code, 1);
  EXPECT_FALSE(std::filesystem::exists(output_)) << "nothing is left behind";
}

TEST_F(SurfelSimplify, TakesAFactorInsteadOfACount) {
  ASSERT_EQ(simplify(input(), {"--factor", "8", "--quiet"}).exit_code, 0);
  EXPECT_EQ(read_cloud(output_).size(), 2500U);
  EXPECT_EQ(simplify(input(), {"--factor", "8", "--count", "9"}).exit_code, 2);
  EXPECT_EQ(simplify(input(), {"--factor", "8", "--max-error", "9"}).exit_code, 2);
  std::filesystem::remove(output_);
  for (const char* factor : {"0.5", "nan", "inf", "-3"}) {
    const RunResult result = simplify(input(), {"--factor", factor});
    EXPECT_EQ(result.exit_code, 2);
    EXPECT_TRUE(contains(result.errors, "--factor")) << result.errors;
  }
  EXPECT_FALSE(std::filesystem::exists(output_));
}

TEST_F(SurfelSimplify, Gaussians) {
  const std::string splats = folder_ / "head.splat";
  ASSERT_EQ(run({tool("surfel-convert"), input(), "-o", splats, "--quiet"}).exit_code, 0);
  const RunResult result = simplify(splats, {"--factor", "10"});
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  EXPECT_TRUE(contains(result.errors, "2000 of 20000 Gaussians")) << result.errors;
  EXPECT_EQ(report()["gaussians"], 2000U);
  EXPECT_EQ(report()["before"], 20000U);
  EXPECT_EQ(read_gaussians(output_).size(), 2000U);
  const ImageError error = image_error(picture(output_), picture(splats));
  EXPECT_GT(error.psnr, 26);
  EXPECT_EQ(error.holes, 0);
  for (const std::string& name : {folder_ / "few.splat", folder_ / "few.usda"}) {
    ASSERT_EQ(
        run({tool("surfel-simplify"), splats, "--count", "99", "-o", name, "--quiet"}).exit_code,
        0);
    EXPECT_TRUE(std::filesystem::exists(name));
  }
}

TEST_F(SurfelSimplify, RefusesOptionsThatSayNothingOfGaussians) {
  const std::string splats = folder_ / "head.splat";
  ASSERT_EQ(run({tool("surfel-convert"), input(), "-o", splats, "--quiet"}).exit_code, 0);
  for (const Words& options :
       {Words{}, Words{"--max-error", "0.1"}, Words{"--count", "9", "--light", "1"},
        Words{"--count", "9", "--normal-angle", "9"}, Words{"--count", "9", "--seed", "2"}}) {
    EXPECT_EQ(simplify(splats, options).exit_code, 2);
  }
  EXPECT_FALSE(std::filesystem::exists(output_)) << "nothing is left behind";
  EXPECT_EQ(
      run({tool("surfel-simplify"), splats, "--count", "9", "-o", folder_ / "a.las"}).exit_code, 2);
  EXPECT_EQ(
      run({tool("surfel-simplify"), input(), "--count", "9", "-o", folder_ / "a.splat"}).exit_code,
      2);
}

TEST_F(SurfelSimplify, Pipes) {
  const std::string command = tool("surfel-generate") + " plane --count 3000 -o - --quiet | " +
                              tool("surfel-simplify") + " - --max-error 0.1 -o - --quiet | " +
                              tool("surfel-info") + " - --json > " + (folder_ / "info.json");
  EXPECT_EQ(run({"/bin/sh", "-c", command}).exit_code, 0);
  EXPECT_TRUE(contains(read_text(folder_ / "info.json"), "surfel-simplify"));
}

}  // namespace
}  // namespace surfel::test
