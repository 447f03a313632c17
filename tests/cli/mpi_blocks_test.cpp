// Surfels and levels of detail whose blocks several processes share, by mpirun.

#include <filesystem>
#include <string>
#include <utility>

#include <gtest/gtest.h>

#include "support/mpi_test_base.h"
#include "support/run_tool.h"
#include "support/sanitized.h"

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
  expect_same("surfel-estimate", {"--orient", "winding", "--memory", "64M"});
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
    const RunResult together = run_mixed({"avx2", "scalar"}, command);
    ASSERT_EQ(together.exit_code, 0) << together.errors;
    EXPECT_TRUE(read_text(out_) == read_text(folder_ / "alone.ply")) << name;
  }
}

TEST_F(MpiBlocks, WorkThatIsKilledIsTakenUpByAnyNumberOfProcesses) {
  if (kSanitized) GTEST_SKIP() << "sanitizers want to be loaded before all other libraries";
  struct Work {
    std::string name;
    Words options;
    int first_write;  ///< Before which the first run is killed.
  };
  for (const Work& work : {Work{"surfel-estimate", {"--orient", "up", "--memory", "4M"}, 4},
                           Work{"surfel-lod", {"--reduction", "9"}, 9}}) {
    Words alone{tool(work.name), points_, "-o", folder_ / "alone.ply"};
    alone.insert(alone.end(), work.options.begin(), work.options.end());
    ASSERT_EQ(run(alone).exit_code, 0);
    Words command{tool(work.name), points_, "--threads", "1", "--resume", "-o", out_};
    command.insert(command.end(), work.options.begin(), work.options.end());
    // How many processes each run has, and how many writes later than in the first run each of them
    // is killed.
    int taken_up = 0;
    int kills = 0;
    for (const auto& [ranks, later] : {std::pair{2, 0}, {3, 0}, {1, 3}, {2, 2}}) {
      Words killed{"env",
                   "LD_PRELOAD=" + std::string(SURFEL_FAULT_LIBRARY),
                   "FAULT_CALL=pwrite",
                   "FAULT_NUMBER=" + std::to_string(work.first_write + later),
                   "FAULT_ERROR=-2",
                   "FAULT_SEEN=" + (folder_ / "seen")};
      killed.insert(killed.end(), command.begin(), command.end());
      const RunResult result = ranks > 1 ? run_ranks(ranks, killed) : run(killed);
      taken_up += contains(result.errors, "going on where an earlier run stopped") ? 1 : 0;
      if (result.exit_code == 0) break;
      ++kills;
      EXPECT_FALSE(fs::exists(out_)) << work.name;
    }
    EXPECT_GT(kills, 1) << work.name;
    if (!fs::exists(out_)) {
      const RunResult result = run_ranks(2, command);
      EXPECT_EQ(result.exit_code, 0) << result.errors;
      taken_up += contains(result.errors, "going on where an earlier run stopped") ? 1 : 0;
    }
    EXPECT_GT(taken_up, 0) << work.name;
    EXPECT_TRUE(read_text(out_) == read_text(folder_ / "alone.ply")) << work.name;
    fs::remove(folder_ / "seen");
    fs::remove(folder_ / "alone.ply");
    fs::remove(out_);
    EXPECT_EQ(entries(folder_ / "").size(), 1U) << work.name;
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
  expect_refused("surfel-convert", {"--sort", "curve", "--resume", "-o", out_},
                 "--resume is for one process");
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
