// Messages of the library name fields, those of the tools name options; commands in messages run as
// they stand, whatever the names of files.

#include <cctype>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "support/run_tool.h"

namespace surfel::test {
namespace {

namespace fs = std::filesystem;

/// The string literals of a source text, one after the other; comments are skipped.
std::string string_literals(const std::string& source) {
  std::string found;
  for (std::size_t at = 0; at < source.size(); ++at) {
    if (source.compare(at, 2, "//") == 0) {
      at = source.find('\n', at);
      if (at == std::string::npos) break;
    } else if (source[at] == '"' || source[at] == '\'') {
      const char quote = source[at];
      for (++at; at < source.size() && source[at] != quote; ++at) {
        if (source[at] == '\\') ++at;
        if (quote == '"' && at < source.size()) found += source[at];
      }
      found += '\n';
    }
  }
  return found;
}

/// "--x" at the beginning of a word.
bool names_an_option(const std::string& text) {
  for (std::size_t at = 0; (at = text.find("--", at)) != std::string::npos; at += 2) {
    const bool begins = at == 0 || std::isspace(static_cast<unsigned char>(text[at - 1])) != 0 ||
                        text[at - 1] == '(';
    const bool named =
        at + 2 < text.size() && std::islower(static_cast<unsigned char>(text[at + 2])) != 0;
    if (begins && named) return true;
  }
  return false;
}

TEST(StringLiterals, AreFoundBesideCommentsAndCharacters) {
  EXPECT_EQ(string_literals("a(\"b\\\"c\"); // \"d\"\n'\"' + \"e\""), "b\"c\n\ne\n");
  EXPECT_TRUE(names_an_option("lower --overlap"));
  EXPECT_TRUE(names_an_option("(--mesh"));
  EXPECT_FALSE(names_an_option("a -- b, i--j"));
}

TEST(LibraryMessages, NameFieldsNotOptions) {
  // Files whose messages hold commands, of the tools or of other programs, or that hold a style
  // sheet.
  const std::vector<std::string> commands = {"chart",      "cloud_needs.cpp",   "cloud_ranges.cpp",
                                             "colmap.cpp", "hard_cases.cpp",    "intake.cpp",
                                             "page.cpp",   "cloud_summary.cpp", "view_page.cpp"};
  int files = 0;
  for (const auto& entry :
       fs::recursive_directory_iterator(fs::path(SURFEL_SOURCE_DIR) / "lib" / "surfel")) {
    const fs::path& path = entry.path();
    if (path.extension() != ".cpp" && path.extension() != ".h") continue;
    const bool makes_commands =
        std::count(commands.begin(), commands.end(), path.filename()) > 0 ||
        std::count(commands.begin(), commands.end(), path.parent_path().filename()) > 0;
    if (makes_commands) continue;
    ++files;
    EXPECT_FALSE(names_an_option(string_literals(read_text(path)))) << path;
  }
  EXPECT_GT(files, 200);
}

TEST(ToolMessages, NameTheOptionsThatSetTheFields) {
  const TemporaryFolder folder;
  const std::string points = folder / "points.xyz";
  write_text(points, "0 0 0\n1 0 0\n0 1 0\n1 1 0\n2 0 0\n2 1 0\n");
  const auto refused = [&](std::vector<std::string> words, const std::string& message) {
    words.front() = tool(words.front());
    words.insert(words.end(),
                 {"-o", folder / (words.front().ends_with("render") ? "out.png" : "out.ply")});
    const RunResult result = run(words);
    EXPECT_EQ(result.exit_code, 2) << result.errors;
    EXPECT_NE(result.errors.find(message), std::string::npos) << result.errors;
    EXPECT_EQ(result.errors.find('`'), std::string::npos) << result.errors;
  };
  refused({"surfel-render", points, "--cutoff", "99"}, " --cutoff is 99;");
  refused({"surfel-render", points, "--depth-epsilon", "-1"}, " --depth-epsilon is -1;");
  refused({"surfel-estimate", points, "-k", "1"}, " -k is 1;");
  refused({"surfel-estimate", points, "--remove-outliers", "--outlier-k", "0"},
          " --outlier-k is 0;");
  refused({"surfel-estimate", points, "--voxel", "small"}, "--voxel is 'small';");
  refused({"surfel-estimate", points, "--voxel", "1e12"}, " --voxel is 1000000000000;");
  refused({"surfel-estimate", points, "--smooth", "mls", "--smooth-order", "9"},
          " --smooth-order is 9;");
  refused({"surfel-estimate", points, "--smooth", "mls", "--smooth-radius", "1"},
          " --smooth-radius of 1 takes in 3 points, too few for polynomials of --smooth-order 2;");
  refused({"surfel-estimate", points, "--smooth-radius", "4"},
          "--smooth-radius has no effect without --smooth mls");
  refused({"surfel-group", points, "--cover", "enlarge", "--cover-target", "2"},
          " --cover-target is 2;");
  refused({"surfel-simplify", points}, "either --max-error or --count must");
  refused({"surfel-texture", points, "--image", "checker", "--fit", "render", "--robust", "-1"},
          " --robust is -1;");
}

TEST(SuggestedCommands, RunAsTheyStandForAnyName) {
  for (const char* name : {"plain.xyz", "two words.xyz", "it's $(one).xyz", "-dash.xyz"}) {
    const TemporaryFolder folder;
    std::string points;
    for (int i = 0; i < 100; ++i) points += fmt::format("{} {} 0\n", i % 10, i / 10);
    write_text(folder / name, points);
    const auto in_shell = [&](const std::string& command) {
      return run({"sh", "-c", "cd \"$1\" && PATH=\"$2:$PATH\" && " + command, "sh", folder / "",
                  SURFEL_TOOL_DIR, name});
    };
    const RunResult info = in_shell("surfel-info --json -- \"$3\"");
    ASSERT_EQ(info.exit_code, 0) << info.errors;
    const auto needs = nlohmann::json::parse(info.output)["needs"];
    ASSERT_FALSE(needs.empty());
    const RunResult mended = in_shell(needs[0]["command"].get<std::string>());
    EXPECT_EQ(mended.exit_code, 0) << needs[0]["command"] << mended.errors;
    EXPECT_TRUE(fs::exists(folder / "OUT"));
  }
}

}  // namespace
}  // namespace surfel::test
