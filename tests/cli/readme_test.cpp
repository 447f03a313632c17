// The commands of README.md and of documents that are meant to be followed step by step, run as
// they are printed, one after another, in a folder like a fresh clone of the project; and the
// pictures that these documents show of them. Where pictures change on purpose, they are made anew
// by running this test with SURFEL_WRITE_PICTURES=1 set.

#include <cstdlib>
#include <filesystem>
#include <optional>
#include <regex>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <surfel/io/cloud_io.h>

#include "support/project_text.h"
#include "support/run_tool.h"

namespace surfel::test {
namespace {

namespace fs = std::filesystem;

const fs::path kRoot = SURFEL_SOURCE_DIR;

using Parts = std::vector<std::pair<std::string, std::string>>;

/// What is run of a document, and what it has at least, so that nothing is missed unseen.
struct Document {
  std::string file;
  int commands = 1;
  std::size_t pictures = 0;
  Parts shortened = {};  ///< Parts of commands, and what is run in their stead.
};

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
const Parts& shortened() {
  static const Parts kParts = {
      {"--count 4782011 ", "--count 47820 "},
      {"--turntable 36 ", "--turntable 3 "},
      {"head.obj --quick ", "head.obj --quick --sweep cutoff --count 2000 --frames 0 "},
      {"truth.exr --reference --size 256x256 ", "truth.exr --reference --size 32x32 --samples 4 "},
      {"fast.exr --size 256x256 ", "fast.exr --size 32x32 "}};
  return kParts;
}

/// Pictures of README.md that no command of the tools makes: a browser's view of a report.
bool made_by_hand(const std::string& picture) { return picture == "chart.png"; }

/// The lines of the blocks of code of a document that are in a language, "" where none is named.
std::vector<std::string> code_lines(const std::string& file, const std::string& language) {
  std::vector<std::string> found;
  std::optional<std::string> block;  // Language of the block that a line is in.
  for (const std::string& line : matches(text_of(kRoot / file), std::regex("([^\n]*)\n"))) {
    if (line.starts_with("```")) {
      block = block ? std::nullopt : std::optional(line.substr(3));
    } else if (block == language && !line.empty()) {
      found.push_back(line);
    }
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
std::string shorten(std::string command, const Parts& parts, std::vector<bool>& used) {
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const auto& [part, instead] = parts[i];
    const std::size_t at = command.find(part);
    if (at == std::string::npos) continue;
    command.replace(at, part.size(), instead);
    used[i] = true;
  }
  return command;
}

/// The pictures that a document shows of its commands: README.md's of one command each, without
/// those that scripts or people put together; of other documents those that begin with its name.
std::vector<std::string> pictures(const std::string& file) {
  const std::string text = text_of(kRoot / file);
  const std::string stem = fs::path(file).stem();
  if (stem != "README") {
    return matches(text, std::regex(R"(\]\(()" + stem + R"(-[\w.-]+\.(?:png|jpg))\))"));
  }
  std::vector<std::string> names = matches(text, std::regex(R"(\]\(docs/([\w.-]+\.png)\))"));
  std::erase_if(names, made_by_hand);
  return names;
}

/// The picture that a document shows is the one that its command has made.
void compare(const std::string& made, const fs::path& shown) {
  ASSERT_TRUE(fs::exists(made)) << "no command makes " << shown.filename();
  if (std::getenv("SURFEL_WRITE_PICTURES")) {
    fs::copy_file(made, shown, fs::copy_options::overwrite_existing);
    return;
  }
  if (read_text(made) == read_text(shown)) return;
  // Processors round differently, which shows in few pixels.
  const RunResult result = run({tool("surfel-compare"), made, shown, "--json"});
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  const nlohmann::json psnr = nlohmann::json::parse(result.output)["psnr"];
  EXPECT_TRUE(psnr.is_null() || psnr.get<double>() > 45)
      << shown << " is " << psnr << " dB from what its command makes";
}

/// Runs the commands of a document, and compares its pictures with what they have made.
void run_commands(const Document& document) {
  const TemporaryFolder clone;
  for (const char* part : {"samples", "configs"}) {
    fs::copy(kRoot / part, fs::path(clone / part), fs::copy_options::recursive);
  }
  std::vector<bool> used(document.shortened.size());
  int ran = 0;
  for (const std::string& printed : code_lines(document.file, "")) {
    if (is_excepted(printed)) continue;
    const std::string command = shorten(printed, document.shortened, used);
    const RunResult result = run({"/bin/bash", "-c",
                                  "set -e -o pipefail; cd " + (clone / ".") +
                                      "; PATH=" SURFEL_TOOL_DIR ":$PATH; " + command});
    EXPECT_EQ(result.exit_code, 0) << command << '\n' << result.errors;
    for (const std::string& name : outputs(command)) {
      EXPECT_TRUE(fs::exists(clone / name)) << command << " makes no " << name;
    }
    ++ran;
  }
  EXPECT_GE(ran, document.commands);
  for (std::size_t i = 0; i < used.size(); ++i) {
    EXPECT_TRUE(used[i]) << document.file << " has no " << document.shortened[i].first;
  }
  EXPECT_GE(pictures(document.file).size(), document.pictures);
  for (const std::string& name : pictures(document.file)) {
    compare(clone / name, kRoot / "docs" / name);
  }
}

TEST(Readme, EveryCommandRunsAndThePicturesAreTheirs) {
  run_commands({"README.md", 25, 6, shortened()});
}

TEST(Documents, TheTutorialOfScansRuns) { run_commands({"docs/tutorial-scan.md", 15, 8}); }

TEST(Documents, TheTutorialOfMeshesRuns) { run_commands({"docs/tutorial-mesh.md", 15, 8}); }

TEST(Documents, TheCommandsOfChoosingRun) {
  run_commands(
      {"docs/choose.md",
       5,
       0,
       {{"head.obj --quick ", "head.obj --quick --sweep cutoff --count 2000 --frames 0 "}}});
}

TEST(Documents, TheGalleryRuns) { run_commands({"docs/gallery.md", 8, 4}); }

/// A command that the gallery names and does not run stands in README.md, or on a page that says
/// which file of the test data the command is for; and the gallery shows every picture.
TEST(Documents, TheGalleryIsWhole) {
  const std::string gallery = text_of(kRoot / "docs/gallery.md");
  std::string pages = text_of(kRoot / "README.md");
  for (const char* page : {"rendering.md", "view.md"}) pages += text_of(kRoot / "docs" / page);
  for (const std::string& command :
       matches(gallery, std::regex("`(surfel-[a-z-]+ [^`]* -o [^`]*)`"))) {
    EXPECT_TRUE(contains(pages, command)) << command;
  }
  for (const fs::directory_entry& entry : fs::directory_iterator(kRoot / "docs")) {
    const std::string name = entry.path().filename();
    const bool picture = entry.path().extension() == ".png" || entry.path().extension() == ".jpg";
    if (picture && !name.starts_with("tutorial-")) {
      EXPECT_TRUE(contains(gallery, "](" + name + ")")) << "the gallery lacks " << name;
    }
  }
}

/// The reader of docs/format.md, in plain Python, reads what the tools write.
TEST(Documents, TheReaderInTenLinesReads) {
  const TemporaryFolder folder;
  std::string program;
  const std::vector<std::string> lines = code_lines("docs/format.md", "python");
  for (const std::string& line : lines) program += line + '\n';
  EXPECT_LE(lines.size(), 14U);
  write_text(folder / "reader.py", program);
  const std::string file = folder / "plane.ply";
  ASSERT_EQ(run({tool("surfel-generate"), "plane", "--count", "1000", "-o", file}).exit_code, 0);
  const RunResult result = run({"python3", folder / "reader.py", file});
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  std::istringstream output(result.output);
  std::string names;
  std::getline(output, names);
  EXPECT_TRUE(names.starts_with("1000 surfels: x y z nx ny nz variance ")) << names;
  const SurfelCloud cloud = read_cloud(file);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    Vec3d position;
    double radius = 0;
    output >> position.x() >> position.y() >> position.z() >> radius;
    ASSERT_TRUE(output) << i;
    EXPECT_NEAR((position - cloud.origin - cloud.position[i].cast<double>()).norm(), 0, 1e-6);
    EXPECT_NEAR(radius * radius, 2 * cloud.variance[i], 1e-6);
  }
}

}  // namespace
}  // namespace surfel::test
