// Pictures that several processes make together, by mpirun.

#include <csignal>
#include <filesystem>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <surfel/base/process.h>

#include "support/mpi_test_base.h"
#include "support/run_tool.h"
#include "support/test_data.h"

namespace surfel::test {
namespace {

namespace fs = std::filesystem;

class Mpi : public MpiTest {
 protected:
  void SetUp() override {
    MpiTest::SetUp();
    if (IsSkipped() || HasFatalFailure()) return;
    const RunResult made =
        run({tool("surfel-generate"), "terrain", "--count", "20000", "--no-uv", "-o", terrain_});
    ASSERT_EQ(made.exit_code, 0) << made.errors;
  }
  Words command(const std::string& output, const Words& more = {}) const {
    Words words{tool("surfel-render"), terrain_, "--size", "120x100",
                "--threads",           "1",      "-o",     output};
    words.insert(words.end(), more.begin(), more.end());
    return words;
  }
  /// Gives the surfels levels of detail.
  void make_levels() {
    const std::string plain = terrain_;
    terrain_ = folder_ / "levels.ply";
    const RunResult made = run({tool("surfel-lod"), plain, "-o", terrain_});
    ASSERT_EQ(made.exit_code, 0) << made.errors;
  }
  /// Compares what so many processes make with what one makes.
  void expect_same_bytes(const std::vector<int>& counts, const Words& options) {
    const RunResult alone = run(command(folder_ / "alone.exr", options));
    ASSERT_EQ(alone.exit_code, 0) << alone.errors;
    for (const int ranks : counts) {
      const RunResult together = run_ranks(ranks, command(folder_ / "together.exr", options));
      ASSERT_EQ(together.exit_code, 0) << together.errors;
      EXPECT_TRUE(read_text(folder_ / "together.exr") == read_text(folder_ / "alone.exr"))
          << ranks << " ranks " << fmt::format("{}", fmt::join(options, " "));
    }
  }

  TemporaryFolder folder_;
  std::string terrain_ = folder_ / "terrain.ply";
};

TEST_F(Mpi, AnyNumberOfProcessesMakesTheSameBytes) {
  const Words views{"--turntable", "3"};
  const RunResult alone = run(command(folder_ / "alone_%d.exr", views));
  ASSERT_EQ(alone.exit_code, 0) << alone.errors;
  // With 12 ranks some have no rows.
  for (const int ranks : {1, 2, 4, 12}) {
    const std::string name = folder_ / fmt::format("ranks{}_", ranks);
    const RunResult together = run_ranks(ranks, command(name + "%d.exr", views));
    ASSERT_EQ(together.exit_code, 0) << together.errors;
    // Only one tells of it.
    EXPECT_EQ(together.errors.find("surfel-render:"), together.errors.rfind("surfel-render: up"))
        << together.errors;
    for (int view = 0; view < 3; ++view) {
      EXPECT_TRUE(read_text(name + fmt::format("{}.exr", view)) ==
                  read_text(folder_ / fmt::format("alone_{}.exr", view)))
          << ranks << " ranks, view " << view;
    }
  }
}

TEST_F(Mpi, ProcessorsMayDiffer) {
  ASSERT_EQ(run(command(folder_ / "alone.exr")).exit_code, 0);
  const RunResult together = run_mixed({"avx2", "scalar"}, command(folder_ / "together.exr"));
  ASSERT_EQ(together.exit_code, 0) << together.errors;
  EXPECT_TRUE(read_text(folder_ / "together.exr") == read_text(folder_ / "alone.exr"));
}

TEST_F(Mpi, LevelsOfDetailHaveTheSameBytes) {
  make_levels();
  expect_same_bytes({3}, {"--zoom", "3"});
  expect_same_bytes({2}, {"--lod-error", "8"});
  expect_same_bytes({3}, {"--shading", "phong", "--relief", "occlusion", "--lod-error", "4"});
  expect_same_bytes({2}, {"--zoom", "4", "--progressive", "2"});
}

TEST_F(Mpi, FilesThatAreCutShortAreRefused) {
  make_levels();
  const std::string bytes = read_text(terrain_);
  write_text(terrain_, bytes.substr(0, bytes.size() - 5000));
  write_text(folder_ / "old.exr", "old");
  const RunResult failed = run_ranks(2, command(folder_ / "old.exr"));
  EXPECT_EQ(failed.exit_code, 1) << failed.errors;
  EXPECT_NE(failed.errors.find("levels.ply"), std::string::npos) << failed.errors;
  EXPECT_EQ(read_text(folder_ / "old.exr"), "old");
}

/// Each process holds the whole tree of the levels.
TEST_F(Mpi, LevelsOfDetailLargerThanMemoryAreRefused) {
  make_levels();
  const RunResult failed = run_ranks(2, command(folder_ / "a.exr", {"--memory", "100k"}));
  EXPECT_EQ(failed.exit_code, 1) << failed.errors;
  EXPECT_NE(failed.errors.find("levels.ply"), std::string::npos) << failed.errors;
  EXPECT_NE(failed.errors.find("to each process"), std::string::npos) << failed.errors;
  EXPECT_FALSE(fs::exists(folder_ / "a.exr"));
}

TEST_F(Mpi, FilmsAndReportsAreWrittenOnce) {
  if (find_program("ffmpeg").empty()) GTEST_SKIP() << "ffmpeg is not installed";
  const Words views{"--turntable", "3", "--background", "white", "--stats", folder_ / "stats.json"};
  const RunResult together = run_ranks(2, command(folder_ / "turn.mp4", views));
  ASSERT_EQ(together.exit_code, 0) << together.errors;
  ASSERT_EQ(
      run(command(folder_ / "alone.mp4", {"--turntable", "3", "--background", "white"})).exit_code,
      0);
  EXPECT_TRUE(read_text(folder_ / "turn.mp4") == read_text(folder_ / "alone.mp4"));
  EXPECT_NE(read_text(folder_ / "stats.json").find("\"frames\""), std::string::npos);
  // terrain.ply, two films and the report.
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_ / ""), {}), 4);
}

TEST_F(Mpi, AProcessThatFailsEndsTheRun) {
  write_text(folder_ / "old.exr", "old");
  // One of the processes names a file that is not there.
  Words words = mpirun();
  words.insert(words.end(), {"-n", "1"});
  for (const std::string& word : command(folder_ / "old.exr")) words.push_back(word);
  words.insert(words.end(), {":", "-n", "1"});
  terrain_ = folder_ / "nowhere.ply";
  for (const std::string& word : command(folder_ / "old.exr")) words.push_back(word);
  const RunResult failed = run(words);
  EXPECT_NE(failed.exit_code, 0);
  EXPECT_NE(failed.errors.find("nowhere.ply"), std::string::npos) << failed.errors;
  EXPECT_EQ(read_text(folder_ / "old.exr"), "old");
}

TEST_F(Mpi, AProcessThatIsKilledEndsTheRun) {
  write_text(folder_ / "old.exr", "old");
  // A process that takes its own life instead of drawing.
  Words words = mpirun();
  words.insert(words.end(), {"-n", "1"});
  for (const std::string& word : command(folder_ / "old.exr", {"--turntable", "1"})) {
    words.push_back(word);
  }
  words.insert(words.end(), {":", "-n", "1", "sh", "-c", "kill -9 $$"});
  const RunResult failed = run(words);
  EXPECT_NE(failed.exit_code, 0);
  EXPECT_EQ(read_text(folder_ / "old.exr"), "old");
  // Nothing is left but the surfels and the old picture.
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_ / ""), {}), 2);
}

TEST_F(Mpi, WhatOneProcessMakesIsRefused) {
  for (const Words& more : {Words{"--contact-sheet"}, Words{"--tiles", "1/2"}}) {
    const RunResult refused = run_ranks(2, command(folder_ / "a.exr", more));
    EXPECT_EQ(refused.exit_code, 2) << refused.errors;
    EXPECT_NE(refused.errors.find("by several processes"), std::string::npos) << refused.errors;
  }
}

}  // namespace
}  // namespace surfel::test
