// samples/reproduce.sh, which makes the figures of the papers again.

#include <filesystem>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "support/run_tool.h"
#include "support/test_data.h"

namespace surfel::test {
namespace {

std::size_t count(const std::string& text, const std::string& part) {
  std::size_t found = 0;
  for (auto at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++found;
  return found;
}

class Reproduce : public testing::Test {
 protected:
  /// Runs the script with the tools of a folder.
  static RunResult reproduce(const Words& words, const std::string& tools = SURFEL_TOOL_DIR,
                             const std::string& data = data_folder()) {
    Words command{"env", "SURFEL_BIN=" + tools, "SURFEL_TEST_DATA=" + data,
                  SURFEL_SOURCE_DIR "/samples/reproduce.sh"};
    command.insert(command.end(), words.begin(), words.end());
    return run(command);
  }

  TemporaryFolder folder_;
  std::string page_ = folder_ / "a page.html";
};

TEST_F(Reproduce, MakesAPageThatNeedsNoOtherFile) {
  SURFEL_REQUIRE_TEST_DATA();
  const RunResult result = reproduce({"-s", "0.05", "-o", page_, "sp06-9"});
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  EXPECT_EQ(entries(folder_ / ""), Words{"a page.html"});
  const std::string page = read_text(page_);
  EXPECT_EQ(count(page, "src=\"data:image/png;base64,iVBORw0KGgo"), 6U);
  EXPECT_EQ(count(page, "src="), 6U);
  EXPECT_EQ(count(page, "href="), count(page, "href=\"#"));
  EXPECT_EQ(count(page, "://"), 0U);
  EXPECT_EQ(count(page, "<a href=\"#sp06-9\">"), 1U);
  EXPECT_EQ(count(page, "<h2 id=\"sp06-9\">"), 1U);
  for (const std::string command :
       {"\nsurfel-group coarse.ply --groups 1 -o coarse-1.ply\n",
        "surfel-from-mesh data/meshes/armadillo.ply --count 600 --variance-scale 1 -o coarse.ply\n",
        " --voronoi windowed "}) {
    EXPECT_GE(count(page, command), 1U) << command;
  }
}

TEST_F(Reproduce, HasThePapersFiguresBesideItsOwn) {
  const RunResult result = reproduce({"-s", "0.001", "-o", page_, "ss01-table2"});
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  const std::string page = read_text(page_);
  EXPECT_EQ(count(page, "<td>Matterhorn</td><td>terrain</td><td>4782</td><td>0.2 fps</td>"), 1U);
  EXPECT_EQ(count(page, " fps</td>"), 12U);
  EXPECT_EQ(count(page, "<td> fps</td>"), 0U);
}

TEST_F(Reproduce, RefusesWhatItDoesNotKnow) {
  for (const Words& words :
       {Words{"ss01-99"}, Words{"-s", "2"}, Words{"-s", "much"}, Words{"-x"}}) {
    Words command{"-o", page_};
    command.insert(command.end(), words.begin(), words.end());
    const RunResult result = reproduce(command);
    EXPECT_EQ(result.exit_code, 2) << words[0];
    EXPECT_FALSE(result.errors.empty());
  }
  const RunResult result = reproduce({"-o", page_, "sp06-9"}, SURFEL_TOOL_DIR, folder_ / "none");
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_EQ(count(result.errors, "set SURFEL_TEST_DATA"), 1U) << result.errors;
  EXPECT_EQ(entries(folder_ / ""), Words{});
}

TEST_F(Reproduce, LeavesTheOldPageWholeWhereACommandFails) {
  write_text(page_, "old");
  const TemporaryFolder tools;
  const auto bin = std::filesystem::path(tools / "");
  EXPECT_EQ(reproduce({"-o", page_, "ss01-table2"}, bin).exit_code, 1);
  for (const char* name : {"surfel-render", "surfel-generate"}) {
    write_text(bin / name, "#!/bin/sh\necho there is no room >&2\nexit 1\n");
    std::filesystem::permissions(bin / name, std::filesystem::perms::owner_all);
  }
  const RunResult result = reproduce({"-o", page_, "ss01-table2"}, bin);
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_EQ(count(result.errors, "this failed: surfel-generate head"), 1U) << result.errors;
  EXPECT_EQ(count(result.errors, "table-head.ply\nthere is no room"), 1U) << result.errors;
  EXPECT_EQ(entries(folder_ / ""), Words{"a page.html"});
  EXPECT_EQ(read_text(page_), "old");
}

}  // namespace
}  // namespace surfel::test
