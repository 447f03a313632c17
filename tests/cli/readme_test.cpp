// The commands of README.md, run as they are printed, one after another, in a folder like a fresh
// clone of the project; and the pictures that README.md shows of them. Where these change on
// purpose, they are made anew by running this test with SURFEL_WRITE_PICTURES=1 set.

#include <cstdlib>
#include <filesystem>
#include <regex>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "support/project_text.h"
#include "support/run_tool.h"

namespace surfel::test {
namespace {

namespace fs = std::filesystem;

const fs::path kRoot = SURFEL_SOURCE_DIR;

/// Commands that build the project or run its own tests, which are what the test stands in, and
/// commands that install: tests/packages.sh does that in another root.
const std::vector<std::string>& excepted() {
  static const std::vector<std::string> kStarts = {"samples/demo.sh", "tests/run.sh",
                                                   "cmake --preset release ", "packaging/build.sh",
                                                   "sudo apt install "};
  return kStarts;
}

/// Parts of commands that would take the test minutes, and what it runs in their stead: the same
/// with fewer surfels, pixels or sweeps.
const std::vector<std::pair<std::string, std::string>>& shortened() {
  static const std::vector<std::pair<std::string, std::string>> kParts = {
      {"--count 4782011 ", "--count 47820 "},
      {"--turntable 36 ", "--turntable 3 "},
      {"head.obj --quick ", "head.obj --quick --sweep cutoff --count 2000 --frames 0 "},
      {"truth.exr --reference --size 256x256 ", "truth.exr --reference --size 32x32 --samples 4 "},
      {"fast.exr --size 256x256 ", "fast.exr --size 32x32 "}};
  return kParts;
}

/// Pictures of README.md that no command of the tools makes: a browser's view of a report.
bool made_by_hand(const std::string& picture) { return picture == "chart.png"; }

/// The lines of README.md's code blocks.
std::vector<std::string> readme_commands() {
  std::vector<std::string> found;
  for (const std::string& block :
       matches(text_of(kRoot / "README.md"), std::regex("\n```\n([^`]*)```"))) {
    for (const std::string& line : matches(block, std::regex("([^\n]+)\n"))) found.push_back(line);
  }
  return found;
}

bool is_excepted(const std::string& command) {
  for (const std::string& start : excepted()) {
    if (command.starts_with(start)) return true;
  }
  return false;
}

/// The files that a command says it writes; of a sequence the first.
std::vector<std::string> outputs(const std::string& command) {
  const std::string plain = command.substr(0, command.find(" #"));
  std::vector<std::string> names =
      matches(plain, std::regex(R"( (?:-o|--keep) '?([^\s'-][^\s']*))"));
  for (std::string& name : names) {
    const std::size_t pattern = name.find("%04d");
    if (pattern != std::string::npos) name.replace(pattern, 4, "0000");
  }
  return names;
}

/// The command with the parts that take minutes shortened; marks the parts that it has as used.
std::string shorten(std::string command, std::vector<bool>& used) {
  for (std::size_t i = 0; i < shortened().size(); ++i) {
    const auto& [part, instead] = shortened()[i];
    const std::size_t at = command.find(part);
    if (at == std::string::npos) continue;
    command.replace(at, part.size(), instead);
    used[i] = true;
  }
  return command;
}

/// README.md's pictures of one command each, without those that scripts or people put together.
std::vector<std::string> pictures() {
  std::vector<std::string> names =
      matches(text_of(kRoot / "README.md"), std::regex(R"(\]\(docs/([\w.-]+\.png)\))"));
  std::erase_if(names, made_by_hand);
  return names;
}

/// The picture that README.md shows is the one that its command has made.
void compare(const std::string& made, const fs::path& shown) {
  ASSERT_TRUE(fs::exists(made)) << "no command of README.md makes " << shown.filename();
  if (std::getenv("SURFEL_WRITE_PICTURES")) {
    fs::copy_file(made, shown, fs::copy_options::overwrite_existing);
    return;
  }
  // Processors round differently, which shows in few pixels.
  const RunResult result = run({tool("surfel-compare"), made, shown, "--json"});
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  const nlohmann::json psnr = nlohmann::json::parse(result.output)["psnr"];
  EXPECT_TRUE(psnr.is_null() || psnr.get<double>() > 45)
      << shown << " is " << psnr << " dB from what its command makes";
}

TEST(Readme, EveryCommandRunsAndThePicturesAreTheirs) {
  const TemporaryFolder clone;
  for (const char* part : {"samples", "configs"}) {
    fs::copy(kRoot / part, fs::path(clone / part), fs::copy_options::recursive);
  }
  std::vector<bool> used(shortened().size());
  int ran = 0;
  for (const std::string& printed : readme_commands()) {
    if (is_excepted(printed)) continue;
    const std::string command = shorten(printed, used);
    const RunResult result = run({"/bin/bash", "-c",
                                  "set -e -o pipefail; cd " + (clone / ".") +
                                      "; PATH=" SURFEL_TOOL_DIR ":$PATH; " + command});
    EXPECT_EQ(result.exit_code, 0) << command << '\n' << result.errors;
    for (const std::string& name : outputs(command)) {
      EXPECT_TRUE(fs::exists(clone / name)) << command << " makes no " << name;
    }
    ++ran;
  }
  EXPECT_GE(ran, 25);
  for (std::size_t i = 0; i < used.size(); ++i) {
    EXPECT_TRUE(used[i]) << "README.md has no " << shortened()[i].first;
  }
  EXPECT_GE(pictures().size(), 6U);
  for (const std::string& name : pictures()) compare(clone / name, kRoot / "docs" / name);
}

}  // namespace
}  // namespace surfel::test
