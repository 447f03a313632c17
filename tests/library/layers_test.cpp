// The library's folders are layers: the order of add_subdirectory() in lib/CMakeLists.txt is the
// order of the data flow, and a folder includes only itself and folders before it.

#include <algorithm>
#include <filesystem>
#include <regex>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "support/project_text.h"

namespace surfel::test {
namespace {

namespace fs = std::filesystem;

const fs::path kLibrary = fs::path(SURFEL_SOURCE_DIR) / "lib";

TEST(Layers, EveryFolderIsOne) {
  const std::vector<std::string> known = library_folders();
  ASSERT_GT(known.size(), 10u);
  for (const fs::directory_entry& entry : fs::directory_iterator(kLibrary / "surfel")) {
    EXPECT_EQ(std::count(known.begin(), known.end(), entry.path().filename().string()), 1)
        << entry.path();
  }
}

TEST(Layers, FoldersIncludeOnlyWhatStandsBelowThem) {
  const std::vector<std::string> order = library_folders();
  const std::regex include(R"(#\s*include\s*[<"]surfel/(\w+)/)");
  std::size_t includes = 0;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(kLibrary / "surfel")) {
    const std::string extension = entry.path().extension().string();
    if (extension != ".h" && extension != ".cpp") continue;
    const auto own =
        std::find(order.begin(), order.end(), entry.path().parent_path().filename().string());
    for (const std::string& folder : matches(text_of(entry.path()), include)) {
      EXPECT_LE(std::find(order.begin(), order.end(), folder) - order.begin(), own - order.begin())
          << entry.path() << " includes surfel/" << folder << ", which stands above its own folder";
      ++includes;
    }
  }
  EXPECT_GT(includes, 1000u);
}

}  // namespace
}  // namespace surfel::test
