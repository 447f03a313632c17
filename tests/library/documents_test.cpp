// What README.md, lib/README.md, samples/README.md and docs/*.md name is there: files of the
// library and of the tests, and the targets of links.

#include <filesystem>
#include <regex>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "support/project_text.h"

namespace surfel::test {
namespace {

namespace fs = std::filesystem;

const fs::path kRoot = SURFEL_SOURCE_DIR;

std::vector<fs::path> pages() {
  std::vector<fs::path> found{kRoot / "README.md", kRoot / "CHANGELOG.md", kRoot / "lib/README.md",
                              kRoot / "samples/README.md"};
  for (const fs::directory_entry& entry : fs::directory_iterator(kRoot / "docs")) {
    if (entry.path().extension() == ".md") found.push_back(entry.path());
  }
  return found;
}

/// Is there a file of that name in the project, or in the folders that pages name paths from?
bool known(const std::string& path) {
  for (const char* base : {"", "lib", "lib/surfel", "tests"}) {
    if (fs::exists(kRoot / base / path)) return true;
  }
  return false;
}

TEST(Documents, EveryPathInBackquotesExists) {
  const std::regex path(R"(`((?:[\w.-]+/)+[\w.-]+\.(?:h|cpp|md|sh|toml|txt))`)");
  std::size_t paths = 0;
  for (const fs::path& page : pages()) {
    for (const std::string& name : matches(text_of(page), path)) {
      EXPECT_TRUE(known(name)) << page << " names " << name << ", which is not there";
      ++paths;
    }
  }
  EXPECT_GT(paths, 100u);
}

TEST(Documents, EveryLinkResolves) {
  const std::regex link(R"(\]\(([^)\s]+)\))");
  std::size_t links = 0;
  for (const fs::path& page : pages()) {
    for (const std::string& target : matches(text_of(page), link)) {
      if (target.starts_with("http") || target.starts_with('#')) continue;
      EXPECT_TRUE(fs::exists(page.parent_path() / target.substr(0, target.find('#'))))
          << page << " links to " << target << ", which is not there";
      ++links;
    }
  }
  EXPECT_GT(links, 20u);
}

TEST(Documents, EveryPageHasItsPlaceInTheNavigationOfTheSite) {
  const std::string navigation = text_of(kRoot / "cmake/documents/mkdocs.yml.in");
  for (const fs::path& page : pages()) {
    const std::string place = ": " + fs::relative(page, kRoot).string() + '\n';
    EXPECT_NE(navigation.find(place), std::string::npos) << page << " is in no section of the site";
  }
}

TEST(Documents, TheListOfPagesHasAll) {
  const std::string list = text_of(kRoot / "docs/README.md");
  for (const fs::path& page : pages()) {
    const std::string name = page.filename();
    if (page.parent_path() != kRoot / "docs" || name == "README.md") continue;
    EXPECT_NE(list.find("](" + name + ")"), std::string::npos) << name;
  }
}

TEST(Documents, TableOfLayersHasTheFoldersInTheirOrder) {
  const std::string page = text_of(kRoot / "lib/README.md");
  const std::size_t begin = page.find("## Layers");
  ASSERT_NE(begin, std::string::npos);
  const std::size_t end = page.find("\n## ", begin + 1);
  EXPECT_EQ(matches(page.substr(begin, end - begin), std::regex(R"(\n\| `(\w+)` \|)")),
            library_folders());
}

}  // namespace
}  // namespace surfel::test
