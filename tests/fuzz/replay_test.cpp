// Every input of tests/fuzz/corpus and tests/fuzz/found, in every build: none may crash, and what
// fuzzers check must hold.

#include <algorithm>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <vector>

#include <gtest/gtest.h>

#include "fuzz/fuzzers.h"

namespace surfel::fuzz {
namespace {

namespace fs = std::filesystem;

std::vector<fs::path> files_in(const fs::path& folder) {
  std::vector<fs::path> files;
  if (fs::exists(folder)) {
    files.assign(fs::directory_iterator(folder), fs::directory_iterator());
  }
  std::sort(files.begin(), files.end());
  return files;
}

std::vector<char> content(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

std::vector<const Fuzzer*> all_fuzzers() {
  std::vector<const Fuzzer*> all;
  for_each_fuzzer([&](const Fuzzer& fuzzer) { all.push_back(&fuzzer); });
  return all;
}

class Replay : public testing::TestWithParam<const Fuzzer*> {};

TEST_P(Replay, EveryInputIsReadOrRefused) {
  const fs::path fuzz = fs::path(SURFEL_SOURCE_DIR) / "tests/fuzz";
  std::size_t count = 0;
  for (const char* kept : {"corpus", "found"}) {
    for (const fs::path& path : files_in(fuzz / kept / GetParam()->name)) {
      SCOPED_TRACE(path);
      const std::vector<char> bytes = content(path);
      EXPECT_NO_THROW(GetParam()->run(std::as_bytes(std::span(bytes))));
      ++count;
    }
  }
  EXPECT_GT(count, 0U) << "a fuzzer without inputs";
}

INSTANTIATE_TEST_SUITE_P(Fuzzers, Replay, testing::ValuesIn(all_fuzzers()),
                         [](const auto& one) { return std::string(one.param->name); });

/// Folders that no fuzzer reads hold inputs that nobody tries.
TEST(Corpus, EveryFolderHasAFuzzer) {
  for (const char* kept : {"corpus", "found"}) {
    for (const fs::path& folder : files_in(fs::path(SURFEL_SOURCE_DIR) / "tests/fuzz" / kept)) {
      EXPECT_TRUE(find_fuzzer(folder.filename().c_str())) << folder;
    }
  }
}

}  // namespace
}  // namespace surfel::fuzz
