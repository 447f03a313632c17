#pragma once

#include <cstdlib>
#include <filesystem>
#include <string>

#include <gtest/gtest.h>

namespace surfel::test {

/// Folder of the real data: $SURFEL_TEST_DATA, else the one set when configuring.
inline std::filesystem::path data_folder() {
  const char* set = std::getenv("SURFEL_TEST_DATA");
  return set && *set ? set : SURFEL_TEST_DATA_DEFAULT;
}

/// A folder of this test's own, empty, removed with the object.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::string pattern = (std::filesystem::temp_directory_path() / "surfel-test-XXXXXX").string();
    if (!mkdtemp(pattern.data())) throw std::runtime_error("no temporary folder");
    path_ = pattern;
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  std::string operator/(const std::string& name) const { return (path_ / name).string(); }

 private:
  std::filesystem::path path_;
};

}  // namespace surfel::test

/// At the start of a test that needs something from outside: fails in CI where it is missing, skips
/// elsewhere.
#define SURFEL_REQUIRE(condition, missing)        \
  do {                                            \
    if (!(condition)) {                           \
      if (std::getenv("CI")) FAIL() << (missing); \
      GTEST_SKIP() << (missing);                  \
    }                                             \
  } while (false)

/// The real data.
#define SURFEL_REQUIRE_TEST_DATA()                                           \
  SURFEL_REQUIRE(std::filesystem::is_directory(surfel::test::data_folder()), \
                 "no data at " + surfel::test::data_folder().string())

/// A program on the search path.
#define SURFEL_REQUIRE_PROGRAM(name) SURFEL_REQUIRE(!surfel::find_program(name).empty(), "no " name)
