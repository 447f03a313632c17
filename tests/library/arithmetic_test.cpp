// Results do not depend on the instructions that a processor has: the library and the tools call no
// function whose last bit does.

#include <filesystem>
#include <regex>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "support/project_text.h"

namespace surfel::test {
namespace {

namespace fs = std::filesystem;

TEST(Arithmetic, ElementaryFunctionsAreOurs) {
  // The C library chooses these by the processor; Eigen's rotations and direct solver call them.
  const std::regex theirs(
      R"(((std::|[^\w:.>])(exp|exp2|expm1|log|log2|log10|log1p|pow|sin|cos|tan|asin|acos|atan|)"
      R"(atan2|sinh|cosh|tanh|cbrt|erf|erfc|hypot)f?\((?=[^)])|Eigen::AngleAxis|computeDirect\((?=\w)))");
  // Highway's differ by the target, and its sums by the width of vectors. What is fused is so for
  // every target in fused-inl.h alone.
  const std::regex by_target(
      R"(hn::(MulAdd|MulSub|NegMulAdd|NegMulSub|Approximate\w+|Exp\w*|Log\w*|Sin|Cos|Tanh|SumOfLanes)\()");
  std::size_t files = 0;
  for (const char* folder : {"lib/surfel", "tools"}) {
    for (const fs::directory_entry& entry :
         fs::recursive_directory_iterator(fs::path(SURFEL_SOURCE_DIR) / folder)) {
      const std::string extension = entry.path().extension().string();
      if (extension != ".h" && extension != ".cpp") continue;
      const std::string stem = entry.path().stem().string();
      ++files;
      // Comments may name them.
      const std::string code =
          std::regex_replace(text_of(entry.path()), std::regex("//[^\n]*"), std::string());
      if (stem != "elementary") {
        for (const std::string& name : matches(code, theirs)) {
          ADD_FAILURE() << entry.path() << ": " << name << " is not of base/elementary.h";
        }
      }
      if (stem == "fused-inl") continue;
      for (const std::string& name : matches(code, by_target)) {
        ADD_FAILURE() << entry.path() << ": " << name << " depends on the instruction set";
      }
    }
  }
  EXPECT_GT(files, 300U);
}

}  // namespace
}  // namespace surfel::test
