// surfel-chart, and that the tools take the settings of its sweeps.

#include <set>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <surfel/base/process.h>
#include <surfel/chart/sweeps.h>

#include "support/run_tool.h"
#include "support/test_data.h"

namespace surfel::test {
namespace {

class SurfelChart : public testing::Test {
 protected:
  void SetUp() override {
    SURFEL_REQUIRE_PROGRAM("gnuplot");  // Draws the reports.
  }
  /// A small textured square, and surfels of it, in a folder whose name needs quotes.
  SurfelChart() {
    write_text(mesh_,
               "v 0 0 0\nv 1 0 0\nv 1 1 0.2\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
               "f 1/1 2/2 3/3\nf 1/1 3/3 4/4\n");
    run({tool("surfel-from-mesh"), mesh_, "--count", "200", "-o", surfels_, "--quiet"});
  }
  RunResult chart(const Words& options) const {
    Words command{tool("surfel-chart"), "--quick", "--size",    "16x16",
                  "--repeats",          "1",       "--samples", "1"};
    if (std::count(options.begin(), options.end(), "--frames") == 0) {
      command.insert(command.end(), {"--frames", "0"});
    }
    command.insert(command.end(), options.begin(), options.end());
    return run(command);
  }
  nlohmann::json report() const { return nlohmann::json::parse(read_text(out_ + "/report.json")); }

  TemporaryFolder folder_;
  std::string mesh_ = folder_ / "a & <b>.obj";
  std::string surfels_ = folder_ / "it's.ply";
  std::string out_ = folder_ / "out";
};

TEST_F(SurfelChart, WritesAReportWhoseCommandsRepeatItsPoints) {
  const RunResult result = chart({surfels_, "--sweep", "cutoff", "--frames", "2", "-o", out_});
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  EXPECT_EQ(entries(out_), (Words{"report.csv", "report.html", "report.json"}));
  const auto points = report()["sweeps"][0]["points"];
  ASSERT_GE(points.size(), 3U);
  EXPECT_TRUE(points[0]["default"]);
  for (const auto& point : points) {
    EXPECT_FALSE(point.contains("refused")) << point.dump();
    EXPECT_GT(point["time_ms"]["median"], 0);
    EXPECT_GT(point["psnr"], 10);
    EXPECT_GE(point["flicker"], 0);
    EXPECT_GT(point["memory_bytes"], 1e5);
  }
  // The last command, run by a shell elsewhere, draws a picture.
  const std::string command = points[1]["commands"].back();
  const std::string bin = std::filesystem::path(tool("x")).parent_path();
  ASSERT_EQ(run({"sh", "-c", "cd " + (folder_ / "") + " && " + bin + "/" + command}).exit_code, 0)
      << command;
  const auto names = entries(folder_ / "");
  EXPECT_TRUE(std::any_of(names.begin(), names.end(),
                          [](const std::string& name) { return name.starts_with("picture-"); }));
}

TEST(ChartSettings, AreOptionsOfTheTools) {
  std::set<Words> commands;
  for (const bool transparent : {false, true}) {
    const SweepContext context{.mesh = true,
                               .texture = true,
                               .outside_truth = true,
                               .transparent = transparent,
                               .surfels = 5000,
                               .cutoff = 1,
                               .cores = 4};
    std::vector<Sweep> sweeps = all_sweeps(context);
    sweeps.emplace_back().points = recommendation_candidates(context);
    for (const Sweep& sweep : sweeps) {
      for (const SweepPoint& point : sweep.points) {
        ToolChain chain;
        chain.apply(sweep.base);
        chain.apply(point.changes);
        for (std::size_t i = 0; i < kStageCount; ++i) {
          const auto stage = static_cast<Stage>(i);
          for (const ToolOption& option : chain.options(stage)) {
            Words command{tool(tool_name(stage))};
            for (const std::string& word : words_of({option})) command.push_back(word);
            command.emplace_back("--print-config");
            commands.insert(command);
          }
        }
      }
    }
  }
  EXPECT_GT(commands.size(), 50U);
  for (const Words& command : commands) {
    EXPECT_EQ(run(command).exit_code, 0) << command[0] << " " << command[1];
  }
}

TEST_F(SurfelChart, SettingsGoTogether) {
  const RunResult result =
      chart({mesh_, "--image", "checker", "--count", "60", "--sweep", "fit,method", "-o", out_});
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  const auto sweeps = report()["sweeps"];
  EXPECT_EQ(sweeps.size(), 2U);
  for (const auto& sweep : sweeps) {
    for (const auto& point : sweep["points"]) {
      EXPECT_FALSE(point.contains("refused")) << point.dump();
    }
  }
}

TEST_F(SurfelChart, TakesUpAnInterruptedRun) {
  // The journal of a run that failed at its end, as its report could not be written.
  std::filesystem::create_directories(out_ + "/report.html");
  const Words options{surfels_, "--sweep", "layers", "-o", out_};
  EXPECT_EQ(chart(options).exit_code, 1);
  EXPECT_EQ(entries(out_), (Words{"report.html", "work"}));
  const std::string journal = out_ + "/work/journal.jsonl";
  std::string text = read_text(journal);
  ASSERT_TRUE(contains(text, "--layers 1"));
  // A time that no run has, to be seen again; and the last line cut.
  const std::string mark = "\\\"ms\\\":";
  const std::size_t at = text.find(mark, text.find("--layers 1")) + mark.size();
  text.replace(at, text.find_first_not_of("0123456789.e+-", at) - at, "98765");
  text.resize(text.size() - 4);
  write_text(journal, text);
  std::filesystem::remove(out_ + "/report.html");
  const RunResult again = chart(options);
  ASSERT_EQ(again.exit_code, 0) << again.errors;
  EXPECT_TRUE(contains(read_text(out_ + "/report.csv"), "98765"));
  EXPECT_EQ(entries(out_), (Words{"report.csv", "report.html", "report.json"}));
}

TEST_F(SurfelChart, RefusesWhatMakesNoSense) {
  const auto refused = [&](const Words& options, const std::string& message) {
    const RunResult result = chart(options);
    EXPECT_EQ(result.exit_code, 2) << result.errors;
    EXPECT_TRUE(contains(result.errors, message)) << result.errors;
    EXPECT_FALSE(std::filesystem::exists(out_));
  };
  refused({surfels_}, "-o");
  refused({surfels_, "-o", out_, "--sweep", "colour"}, "cutoff, layers");
  refused({surfels_, "-o", out_, "--sweep", "spacing"}, "needs a mesh");
  refused({surfels_, "-o", out_, "--sweep", "lod"}, "2000 surfels");
  refused({surfels_, "-o", out_, "--truth", "mesh"}, "--mesh");
  refused({surfels_, "-o", out_, "--truth", "nothing.png"}, "nothing.png");
  refused({surfels_, "-o", out_, "--with", "surfel-paint --blue"}, "surfel-paint");
  refused({surfels_, "-o", out_, "--with", "surfel-render --blue"}, "--blue");
  refused({surfels_, "-o", out_, "--max-time", "3"}, "--recommend");
  refused({surfels_, "--recommend"}, "--max-error");
  refused({surfels_, "--recommend", "--max-time", "0"}, "max-time");
}

TEST_F(SurfelChart, LimitsThePixelsOfImagesThatItAndItsToolsRead) {
  const std::string image = folder_ / "image.png";
  run({tool("surfel-generate"), "checker", "--size", "16x16", "-o", image, "--quiet"});
  const auto expect_refused = [&](Words options, const std::string& limit) {
    options.insert(options.end(), {"--sweep", "cutoff", "--max-pixels", limit, "-o", out_});
    const RunResult result = chart(options);
    EXPECT_EQ(result.exit_code, 1) << result.errors;
    EXPECT_TRUE(contains(result.errors, "16 x 16 pixels are more than the " + limit)) << limit;
    EXPECT_TRUE(contains(result.errors, "--max-pixels")) << result.errors;
  };
  expect_refused({surfels_, "--truth", image}, "10");
  expect_refused({mesh_, "--image", image}, "11");
}

TEST_F(SurfelChart, FailsWithoutGnuplotBeforeItRuns) {
  const RunResult result =
      run({"env", "PATH=/no/such/folder", tool("surfel-chart"), surfels_, "-o", out_});
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_TRUE(contains(result.errors, "gnuplot-nox")) << result.errors;
  EXPECT_FALSE(std::filesystem::exists(out_));
}

TEST_F(SurfelChart, RecommendsWhatMeetsTheGoal) {
  const std::string stats = folder_ / "stats.json";
  const RunResult result = chart({surfels_, "--recommend", "--max-error", "12", "--stats", stats});
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  EXPECT_TRUE(result.output.starts_with("surfel-render ")) << result.output;
  const auto found = nlohmann::json::parse(read_text(stats))["recommend"];
  EXPECT_GE(found["psnr"], 12);
  EXPECT_EQ(found["commands"].back().get<std::string>() + "\n", result.output);
  const RunResult impossible = chart({surfels_, "--recommend", "--max-error", "200"});
  EXPECT_EQ(impossible.exit_code, 1);
  EXPECT_TRUE(contains(impossible.errors, "no setting")) << impossible.errors;
}

}  // namespace
}  // namespace surfel::test
