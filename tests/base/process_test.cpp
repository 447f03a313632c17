#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/process.h>

#include "support/test_data.h"

namespace surfel {
namespace {

using test::TemporaryFolder;

TEST(RunProcess, TellsHowItEndedAndWhatWasWrong) {
  const ProcessResult failed =
      run_process({"sh", "-c", "echo output; echo wrong >&2; exit 3"}, "/");
  EXPECT_EQ(failed.exit_code, 3);
  EXPECT_EQ(failed.errors, "wrong\n");
  EXPECT_EQ(run_process({"sh", "-c", "kill -9 $$"}, "/").exit_code, -1);
}

TEST(RunProcess, RunsInTheFolder) {
  const TemporaryFolder folder;
  EXPECT_EQ(run_process({"sh", "-c", "echo > here"}, folder / "").exit_code, 0);
  EXPECT_TRUE(std::filesystem::exists(folder / "here"));
}

TEST(RunProcess, RefusesAProgramThatIsNotThere) {
  EXPECT_THROW(run_process({"/no/such/program"}, "/"), Error);
  EXPECT_EQ(find_program("no-such-program-anywhere"), "");
  EXPECT_NE(find_program("sh"), "");
}

}  // namespace
}  // namespace surfel
