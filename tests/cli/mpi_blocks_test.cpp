// Surfels and levels of detail whose blocks several processes share, by mpirun.

#include <filesystem>
#include <string>

#include <gtest/gtest.h>

#include "support/mpi_test_base.h"
#include "support/run_tool.h"

namespace surfel::test {
namespace {

namespace fs = std::filesystem;

class MpiBlocks : public MpiTest {
 protected:
  void SetUp() override {
    MpiTest::SetUp();
    if (IsSkipped() || HasFatalFailure()) return;
    const RunResult made =
        run({tool("surfel-generate"), "terrain", "--count", "60000", "--no-uv", "-o", points_});
    ASSERT_EQ(made.exit_code, 0) << made.errors;
  }
  RunResult run_together(int ranks, const std::string& name, const Words& options) const {
    Words words{tool(name), points_, "--threads", "1"};
    words.insert(words.end(), options.begin(), options.end());
    return run_ranks(ranks, words);
  }

  TemporaryFolder folder_;
  std::string points_ = folder_ / "points.ply";
  std::string out_ = folder_ / "out.ply";
};

TEST_F(MpiBlocks, AnyNumberOfProcessesMakesTheSameBytes) {
  const auto expect_same = [&](const std::string& name, const Words& options) {
    Words alone{tool(name), points_, "-o", folder_ / "alone.ply"};
    alone.insert(alone.end(), options.begin(), options.end());
    ASSERT_EQ(run(alone).exit_code, 0);
    for (const int ranks : {2, 3}) {
      Words shared = options;
      shared.insert(shared.end(), {"-o", out_, "--stats", folder_ / "stats.json"});
      const RunResult together = run_together(ranks, name, shared);
      ASSERT_EQ(together.exit_code, 0) << together.errors;
      EXPECT_TRUE(read_text(out_) == read_text(folder_ / "alone.ply")) << name << ", " << ranks;
      // One process speaks for all.
      EXPECT_EQ(together.errors.find("out.ply: "), together.errors.rfind("out.ply: "));
      EXPECT_TRUE(contains(together.errors, "out.ply: ")) << together.errors;
      fs::remove(out_);
    }
  };
  expect_same("surfel-estimate", {"--orient", "up", "--memory", "4M"});
  expect_same("surfel-estimate", {"--orient", "mst", "--memory", "16M"});
  expect_same("surfel-lod", {"--reduction", "9"});
}

TEST_F(MpiBlocks, ProcessorsMayDiffer) {
  for (const char* name : {"surfel-estimate", "surfel-lod"}) {
    Words command{tool(name), points_};
    if (std::string_view(name) == "surfel-estimate") {
      command.insert(command.end(), {"--orient", "up", "--memory", "4M"});
    }
    Words alone = command;
    alone.insert(alone.end(), {"-o", folder_ / "alone.ply"});
    ASSERT_EQ(run(alone).exit_code, 0);
    command.insert(command.end(), {"-o", out_});
    const RunResult together = run_mixed({"sse4", "scalar"}, command);
    ASSERT_EQ(together.exit_code, 0) << together.errors;
    EXPECT_TRUE(read_text(out_) == read_text(folder_ / "alone.ply")) << name;
  }
}

TEST_F(MpiBlocks, WhatOneProcessCanDoAloneIsRefused) {
  const auto expect_refused = [&](const std::string& name, const Words& options,
                                  const std::string& message) {
    const RunResult result = run_together(2, name, options);
    EXPECT_NE(result.exit_code, 0);
    EXPECT_TRUE(contains(result.errors, message)) << result.errors;
    EXPECT_FALSE(fs::exists(out_));
  };
  expect_refused("surfel-estimate", {"--orient", "up", "-o", folder_ / "out.xyz"},
                 "several processes write PLY alone");
  expect_refused("surfel-estimate", {"--orient", "up", "--resume", "-o", out_},
                 "--resume is for one process");
  expect_refused("surfel-estimate", {"-o", out_}, "sides by winding are found by one process");
  expect_refused("surfel-lod", {"--resume", "-o", out_}, "--resume is for one process");
}

TEST_F(MpiBlocks, AProcessThatFailsEndsTheRunAndOlderFilesStay) {
  write_text(out_, "old");
  const std::string whole = read_text(points_);
  write_text(points_, whole.substr(0, whole.size() - 100));
  for (const char* name : {"surfel-estimate", "surfel-lod"}) {
    Words options{"-o", out_};
    if (std::string_view(name) == "surfel-estimate")
      options.insert(options.end(), {"--orient", "up"});
    const RunResult result = run_together(2, name, options);
    EXPECT_NE(result.exit_code, 0) << name;
    EXPECT_TRUE(contains(result.errors, "points.ply: ")) << result.errors;
    EXPECT_EQ(read_text(out_), "old") << name;
  }
  EXPECT_EQ(entries(folder_ / "").size(), 2U);
}

}  // namespace
}  // namespace surfel::test
