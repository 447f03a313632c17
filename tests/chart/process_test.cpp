#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/chart/process.h>

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

TEST(ShellCommand, IsReadBackByAShell) {
  const std::vector<std::string> words = {"plain", "two words",  "it's",    "$HOME",      "", "a;b",
                                          "*",     "--eye=-1,2", "quote\"", "back\\slash"};
  const std::string command = shell_command(words);
  EXPECT_TRUE(command.starts_with("plain 'two words'"));
  // The shell writes each of its words to a line of standard error.
  const ProcessResult shell =
      run_process({"sh", "-c", "set -- " + command + "; printf '%s\\n' \"$@\" >&2"}, "/");
  std::string expected;
  for (const std::string& word : words) expected += word + "\n";
  EXPECT_EQ(shell.errors, expected);
}

}  // namespace
}  // namespace surfel
