// The scripts that make pictures by many jobs, under a Slurm of the test's own and under GNU
// parallel.

#include <cstdlib>
#include <filesystem>
#include <string>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <surfel/base/process.h>

#include "support/run_tool.h"
#include "support/test_data.h"

namespace surfel::test {
namespace {

namespace fs = std::filesystem;

const std::string kSource = SURFEL_SOURCE_DIR;
constexpr int kNotHere = 77;

/// Skips where a program is not installed; CI installs it.
void skip_without(const std::string& program) {
  ASSERT_EQ(std::getenv("CI"), nullptr) << program << " is not installed, or does not start";
  GTEST_SKIP() << program << " is not installed, or does not start";
}

class Cluster : public testing::Test {
 protected:
  void SetUp() override {
    const RunResult made = run({tool("surfel-generate"), "sphere", "--count", "2000", "--texture",
                                "checker", "-o", ball_});
    ASSERT_EQ(made.exit_code, 0) << made.errors;
    const RunResult whole =
        run({tool("surfel-render"), ball_, "--size", "80x90", "-o", folder_ / "whole.png"});
    ASSERT_EQ(whole.exit_code, 0) << whole.errors;
  }
  /// Runs a script that finds the tools by their names.
  static RunResult run_script(Words command) {
    const fs::path tools = fs::path(tool("surfel-render")).parent_path();
    Words words{"env", fmt::format("PATH={}:{}", tools.string(), std::getenv("PATH"))};
    words.insert(words.end(), command.begin(), command.end());
    return run(words);
  }
  void expect_whole() {
    EXPECT_TRUE(read_text(folder_ / "picture.png") == read_text(folder_ / "whole.png"));
  }

  TemporaryFolder folder_;
  std::string ball_ = folder_ / "a ball.ply";  // Names may have blanks.
  std::string picture_ = folder_ / "picture.png";
};

TEST_F(Cluster, ParallelMakesThePictureAndRepairsIt) {
  if (find_program("parallel").empty()) return skip_without("parallel");
  const Words command{
      kSource + "/samples/parallel/picture.sh", picture_, "4", ball_, "--size", "80x90"};
  const RunResult made = run_script(command);
  ASSERT_EQ(made.exit_code, 0) << made.errors;
  expect_whole();
  // A part that is gone is made again, the others are left alone.
  fs::remove(picture_);
  fs::remove(picture_ + ".parts/2-of-4.exr");
  const auto time = fs::last_write_time(picture_ + ".parts/3-of-4.exr");
  const RunResult again = run_script(command);
  ASSERT_EQ(again.exit_code, 0) << again.errors;
  EXPECT_EQ(fs::last_write_time(picture_ + ".parts/3-of-4.exr"), time);
  expect_whole();
  // Parts that other options made are no parts of this picture.
  Words other = command;
  other.insert(other.end(), {"--zoom", "1.5"});
  ASSERT_EQ(run_script(other).exit_code, 0);
  EXPECT_FALSE(read_text(picture_) == read_text(folder_ / "whole.png"));
  ASSERT_EQ(run_script(command).exit_code, 0);
  expect_whole();
}

TEST_F(Cluster, ParallelFailsWhereAPartDoes) {
  if (find_program("parallel").empty()) return skip_without("parallel");
  // Nothing can be written to the place of a part.
  fs::create_directories(picture_ + ".parts/2-of-4.exr");
  const RunResult made = run_script(
      {kSource + "/samples/parallel/picture.sh", picture_, "4", ball_, "--size", "80x90"});
  EXPECT_NE(made.exit_code, 0);
  EXPECT_FALSE(fs::exists(picture_));
  EXPECT_NE(made.errors.find("there is no part 2 of 4"), std::string::npos) << made.errors;
}

/// One Slurm serves all that is tried, as it takes seconds to start.
TEST_F(Cluster, SlurmMakesPicturesAndFilms) {
  const std::string script = folder_ / "try.sh";
  write_text(script, fmt::format(R"(set -e
cd {0}
{1}/samples/slurm/picture.sh picture.png 3 'a ball.ply' --size 80x90
cp picture.png first.png
rm picture.png picture.png.parts/2-of-3.exr
head -c 200 picture.png.parts/3-of-3.exr > cut.exr && mv cut.exr picture.png.parts/3-of-3.exr
{1}/samples/slurm/picture.sh picture.png 3 'a ball.ply' --size 80x90
if {1}/samples/slurm/picture.sh broken.png 2 nowhere.ply; then exit 1; fi
{1}/samples/slurm/film.sh turn.mp4 5 2 'a ball.ply' --turntable 5 --size 64 --background white
)",
                                 folder_ / "", kSource));
  const RunResult made = run_script({kSource + "/tests/support/with_slurm.sh", "bash", script});
  if (made.exit_code == kNotHere) return skip_without("Slurm: " + made.errors);
  ASSERT_EQ(made.exit_code, 0) << made.output << made.errors;
  expect_whole();
  EXPECT_TRUE(read_text(folder_ / "first.png") == read_text(folder_ / "whole.png"));
  EXPECT_FALSE(fs::exists(folder_ / "broken.png"));
  EXPECT_TRUE(fs::exists(folder_ / "turn.mp4"));
}

}  // namespace
}  // namespace surfel::test
