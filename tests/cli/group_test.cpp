// surfel-group: what it writes, prints and refuses.

#include <cmath>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <surfel/io/cloud_io.h>

#include "support/run_tool.h"

namespace surfel::test {
namespace {

class SurfelGroup : public testing::Test {
 protected:
  void SetUp() override {
    ASSERT_EQ(run({tool("surfel-generate"), "sphere", "--count", "3000", "-o", sphere_, "--quiet"})
                  .exit_code,
              0);
  }
  RunResult group(const Words& options, const std::string& output = {}) const {
    Words command = {tool("surfel-group"), sphere_};
    command.insert(command.end(), options.begin(), options.end());
    if (!output.empty()) command.insert(command.end(), {"-o", output});
    return run(command);
  }
  nlohmann::json stats(Words options) const {
    options.insert(options.end(), {"--stats", folder_ / "stats.json", "--quiet"});
    const RunResult result = group(options, folder_ / "grouped.ply");
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    return nlohmann::json::parse(read_text(folder_ / "stats.json"));
  }

  TemporaryFolder folder_;
  std::string sphere_ = folder_ / "sphere.ply";
};

TEST_F(SurfelGroup, WritesTheGroupsThatItReports) {
  const auto report = stats({});
  const SurfelCloud cloud = read_cloud(folder_ / "grouped.ply");
  ASSERT_EQ(cloud.group.size(), 3000U);
  std::vector<std::size_t> sizes(report["groups"].get<std::size_t>(), 0);
  for (const std::uint16_t g : cloud.group) ++sizes.at(g);
  EXPECT_EQ(report["group_sizes"], nlohmann::json(sizes));
  EXPECT_EQ(report["splats"], 3000);
  EXPECT_EQ(report["unusable"], 0);
  EXPECT_LE(report["groups"].get<int>(), report["max_degree"].get<int>() + 1);
  EXPECT_DOUBLE_EQ(report["mean_degree"].get<double>(), report["edges"].get<double>() / 1500);
  EXPECT_GT(report["graph_bytes"].get<double>(), 8 * report["edges"].get<double>());
  for (const char* stage : {"sort", "hierarchy", "search", "color"}) {
    EXPECT_GE(report["stages"][stage].get<double>(), 0) << stage;
  }
  EXPECT_TRUE(contains(cloud.provenance.back(), "surfel-group"));
}

TEST_F(SurfelGroup, EveryOptionChangesTheGroups) {
  const auto plain = stats({});
  EXPECT_LT(stats({"--overlap", "0.5"})["groups"], plain["groups"]);
  EXPECT_LT(stats({"--cutoff", "0.5"})["edges"], plain["edges"]);
  EXPECT_LT(stats({"--relax-coplanar", "--coplanar-angle", "10"})["edges"], plain["edges"]);
  EXPECT_LT(stats({"--order", "dsatur"})["groups"], plain["groups"]);
  EXPECT_NE(stats({"--order", "smallest-last"})["group_sizes"], plain["group_sizes"]);
  const auto fixed = stats({"--groups", "4"});
  EXPECT_EQ(fixed["groups"], 4);
  EXPECT_EQ(fixed["group_sizes"].size(), 4U);
  EXPECT_GT(fixed["least_overlap"]["overlap_area"].get<double>(), 0);
  EXPECT_LT(fixed["least_overlap"]["overlap_area"], fixed["least_overlap"]["disc_area"]);
}

TEST_F(SurfelGroup, RelaxesOppositeSheets) {
  // Two planes, the lower one turned round, closer than the splats' radii.
  SurfelCloud cloud;
  for (int i = 0; i < 2; ++i) {
    cloud.position.push_back(Vec3f(0, 0, 0.1F * static_cast<float>(i)));
    cloud.normal.push_back(Vec3f(0, 0, i == 0 ? -1.0F : 1.0F));
    cloud.variance.push_back(1);
  }
  write_cloud(cloud, sphere_);
  EXPECT_EQ(stats({})["groups"], 2);
  EXPECT_EQ(stats({"--relax-opposite"})["groups"], 1);
}

TEST_F(SurfelGroup, CoversTheSurfaceAndReportsIt) {
  const auto none = stats({"--groups", "4", "--cover", "none"})["coverage"];
  EXPECT_TRUE(read_cloud(folder_ / "grouped.ply").group_radius.empty());
  EXPECT_EQ(none["groups"].size(), 4U);
  EXPECT_EQ(none["growth_max"], 1);
  for (const char* method : {"enlarge", "enlarge-each"}) {
    const auto enlarged = stats({"--groups", "4", "--cover", method})["coverage"];
    EXPECT_EQ(read_cloud(folder_ / "grouped.ply").group_radius.size(), 3000U);
    EXPECT_GT(enlarged["covered_area"], none["covered_area"]) << method;
    EXPECT_GT(enlarged["growth_max"].get<double>(), 1) << method;
    EXPECT_EQ(enlarged["points_added"], 0);
  }
  const auto duplicated = stats({"--groups", "4", "--cover", "duplicate"})["coverage"];
  const SurfelCloud cloud = read_cloud(folder_ / "grouped.ply");
  EXPECT_GT(cloud.size(), 3000U);
  EXPECT_EQ(duplicated["points_added"].get<std::size_t>(), cloud.size() - 3000);
  EXPECT_EQ(cloud.source.size(), cloud.size());
  EXPECT_GT(duplicated["covered_area"], none["covered_area"]);

  const auto less = stats({"--groups", "4", "--cover", "duplicate", "--least-gain", "0.5"});
  EXPECT_LT(less["coverage"]["points_added"], duplicated["points_added"]);
  const auto half = stats({"--cover", "enlarge", "--cover-target", "0.95", "--fixed-point", "9"});
  EXPECT_NEAR(half["coverage"]["groups"][0]["covered_area"].get<double>(),
              0.95 * half["coverage"]["area"].get<double>(), 0.01);
  EXPECT_TRUE(half["coverage"]["groups"][0].contains("fixed_point"));
  EXPECT_FALSE(stats({}).contains("coverage"));
}

TEST_F(SurfelGroup, PrintsARowOfTheTable) {
  const RunResult result = group({"--print-table", "--quiet"});
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  EXPECT_TRUE(result.output.starts_with(
      "| surfels | points | c = 1.0 | c = 0.8 | c = 0.6 | c = 0.4 |\n|---|---|---|---|---|---|\n"
      "| sphere | 3000 | "))
      << result.output;
  const auto report = stats({"--overlap", "0.6"});
  EXPECT_TRUE(contains(result.output, "| " + std::to_string(report["groups"].get<int>()) + " / " +
                                          std::to_string(report["max_degree"].get<int>()) + " / "))
      << result.output;
}

TEST_F(SurfelGroup, RefusesWhatMakesNoSense) {
  EXPECT_EQ(group({}).exit_code, 2);
  EXPECT_EQ(group({"--print-table"}, "-").exit_code, 2);
  EXPECT_EQ(group({"--print-table", "--groups", "4"}).exit_code, 2);
  EXPECT_EQ(group({"--print-table", "--cover", "enlarge"}).exit_code, 2);
  EXPECT_EQ(group({"--print-table", "--overlap", "0.5"}).exit_code, 2);
  const std::string output = folder_ / "none.ply";
  for (const Words& options : {Words{"--groups", "-1"},
                               {"--groups", "65536"},
                               {"--overlap", "-0.1"},
                               {"--cutoff", "0"},
                               {"--order", "none"},
                               {"--coplanar-angle", "5"},
                               {"--max-memory", "-1"},
                               {"--relax-coplanar", "--coplanar-color", "-1"},
                               {"--cover", "most"},
                               {"--least-gain", "0.5"},
                               {"--cover", "enlarge-each", "--cover-target", "0.5"},
                               {"--cover", "enlarge", "--most-growth", "3"},
                               {"--cover", "enlarge-each", "--most-growth", "0.5"},
                               {"--cover", "duplicate", "--fixed-point", "9"},
                               {"--cover", "enlarge", "--cover-target", "2"},
                               {"--cover", "duplicate", "--least-gain", "0"}}) {
    EXPECT_EQ(group(options, output).exit_code, 2) << options[0] << ' ' << options.back();
  }
  const RunResult memory = group({"--max-memory", "1e-6"}, output);
  EXPECT_EQ(memory.exit_code, 1);
  EXPECT_TRUE(contains(memory.errors, "sphere.ply: more than 62 pairs")) << memory.errors;
  EXPECT_FALSE(std::filesystem::exists(output));
}

TEST_F(SurfelGroup, HardInputsHaveADefinedResult) {
  SurfelCloud cloud;
  const auto add = [&](float x, float radius) {
    cloud.position.push_back({x, 0, 0});
    cloud.normal.push_back({0, 0, 1});
    cloud.variance.push_back(radius * radius / 2);
  };
  const std::string input = folder_ / "hard.ply";
  const std::string output = folder_ / "hard-groups.ply";
  const auto run_on = [&](const Words& options) {
    write_cloud(cloud, input);
    Words command{tool("surfel-group"), input, "-o", output, "--quiet"};
    command.insert(command.end(), options.begin(), options.end());
    return run(command);
  };
  const Words cover{"--groups", "4", "--cover", "enlarge-each"};

  add(0, 1);
  ASSERT_EQ(run_on({}).exit_code, 0);
  EXPECT_EQ(read_cloud(output).group[0], 0);
  ASSERT_EQ(run_on(cover).exit_code, 0);
  // Its border cannot be covered: it stays as it is, but for the 2 % of the reach in 16 directions.
  EXPECT_NEAR(read_cloud(output).group_radius[0], 1, 0.021);

  for (int i = 1; i < 200; ++i) add(0, 1);
  ASSERT_EQ(run_on({}).exit_code, 0);
  EXPECT_EQ(read_cloud(output).group[199], 199);
  ASSERT_EQ(run_on(cover).exit_code, 0);

  cloud = {};
  for (int i = 0; i < 100; ++i) {  // 1e-6 to 1e3.
    add(0.01F * static_cast<float>(i), std::pow(10.0F, -6 + 0.0909F * static_cast<float>(i)));
  }
  ASSERT_EQ(run_on({}).exit_code, 0);
  ASSERT_EQ(run_on(cover).exit_code, 0);
  for (const float radius : read_cloud(output).group_radius) EXPECT_TRUE(std::isfinite(radius));

  // More groups than the column can number.
  cloud = {};
  for (int i = 0; i < 65537; ++i) add(0, 1);
  const RunResult many = run_on({"--max-memory", "0.1"});
  EXPECT_EQ(many.exit_code, 1);
  EXPECT_TRUE(contains(many.errors, "splats that lie in one place")) << many.errors;
}

TEST_F(SurfelGroup, SplatsWithoutSizeAreSaid) {
  write_text(folder_ / "points.xyz", "0 0 0\n1 0 0\n0 1 0\n");
  const RunResult points =
      run({tool("surfel-group"), folder_ / "points.xyz", "-o", folder_ / "out.ply"});
  EXPECT_EQ(points.exit_code, 1);
  EXPECT_TRUE(contains(points.errors, "no variance")) << points.errors;

  SurfelCloud cloud = read_cloud(sphere_);
  cloud.variance[5] = -1;
  write_cloud(cloud, sphere_);
  const RunResult result = group({}, folder_ / "out.ply");
  EXPECT_EQ(result.exit_code, 0) << result.errors;
  EXPECT_TRUE(contains(result.errors, "1 of 3000 splats")) << result.errors;
}

}  // namespace
}  // namespace surfel::test
