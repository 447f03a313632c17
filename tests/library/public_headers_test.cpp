// The public headers are those that lib/CMakeLists.txt lists: other programs get them, and nothing
// else.

#include <filesystem>
#include <regex>
#include <set>
#include <string>

#include <gtest/gtest.h>

#include "support/run_tool.h"

namespace surfel {
namespace {

const std::string kLibrary = std::string(SURFEL_SOURCE_DIR) + "/lib/";

std::set<std::string> matches(const std::string& text, const std::regex& pattern) {
  std::set<std::string> found;
  for (auto it = std::sregex_iterator(text.begin(), text.end(), pattern);
       it != std::sregex_iterator(); ++it) {
    found.insert((*it)[1]);
  }
  return found;
}

std::set<std::string> public_headers() {
  return matches(test::read_text(kLibrary + "CMakeLists.txt"),
                 std::regex(R"((surfel/\w+/\w+\.h)\b)"));
}

TEST(PublicHeaders, IncludeOnlyPublicOnes) {
  const std::set<std::string> known = public_headers();
  ASSERT_GT(known.size(), 50U);
  for (const std::string& header : known) {
    const std::string text = test::read_text(kLibrary + header);
    ASSERT_FALSE(text.empty()) << header;
    for (const std::string& other :
         matches(text, std::regex(R"(#\s*include\s*[<"](surfel/[^>"]+))"))) {
      EXPECT_EQ(known.count(other), 1U) << header << " includes " << other;
    }
  }
}

TEST(PublicHeaders, ShowNoOtherLibraryThanEigen) {
  for (const std::string& header : public_headers()) {
    if (header == "surfel/pcl/conversion.h") continue;
    for (const std::string& other : matches(test::read_text(kLibrary + header),
                                            std::regex(R"(#\s*include\s*[<"]([^>"]+/[^>"]+))"))) {
      EXPECT_TRUE(other.rfind("surfel/", 0) == 0 || other.rfind("Eigen/", 0) == 0)
          << header << " includes " << other;
    }
  }
}

/// Eigen aligns types of 32 bytes and more by the instruction set that a program is compiled for.
TEST(PublicHeaders, HaveNoTypeWhoseLayoutDependsOnCompilerFlags) {
  const std::regex aligned(
      R"(\bEigen::((?:Vector4|RowVector4|Array4|Matrix2|Matrix4|Array22|Array44|Quaternion|Affine3|Isometry3|Projective3)d|Matrix4f|Array44f|Affine3f|Isometry3f|Projective3f)\b)");
  for (const std::string& header : public_headers()) {
    if (header == "surfel/pcl/conversion.h") continue;  // It has functions alone, compiled there.
    for (const std::string& type : matches(test::read_text(kLibrary + header), aligned)) {
      ADD_FAILURE() << header << " has Eigen::" << type;
    }
  }
}

}  // namespace
}  // namespace surfel
