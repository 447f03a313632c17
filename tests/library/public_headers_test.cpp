// The public headers are those that lib/CMakeLists.txt lists: other programs get them, and nothing
// else.

#include <filesystem>
#include <regex>
#include <set>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "support/project_text.h"

namespace surfel::test {
namespace {

const std::string kLibraryFolder = std::string(SURFEL_SOURCE_DIR) + "/lib/";

std::set<std::string> public_headers() {
  const std::vector<std::string> found =
      matches(text_of(kLibraryFolder + "CMakeLists.txt"), std::regex(R"((surfel/\w+/\w+\.h)\b)"));
  return {found.begin(), found.end()};
}

TEST(PublicHeaders, IncludeOnlyPublicOnes) {
  const std::set<std::string> known = public_headers();
  ASSERT_GT(known.size(), 50U);
  for (const std::string& header : known) {
    const std::string text = text_of(kLibraryFolder + header);
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
    for (const std::string& other : matches(text_of(kLibraryFolder + header),
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
    for (const std::string& type : matches(text_of(kLibraryFolder + header), aligned)) {
      ADD_FAILURE() << header << " has Eigen::" << type;
    }
  }
}

/// The reference of the headers has a sentence for each.
TEST(PublicHeaders, SayWhatEveryTypeIs) {
  const std::regex type(
      R"((?:^|\n)([^\n]*)\n {0,2}(?:template <[^\n]*\n *)?(?:struct|class) (?:SURFEL_API )?(\w+)(?: final)?(?: : [^\n]*)? \{)");
  std::size_t types = 0;
  for (const std::string& header : public_headers()) {
    const std::string text = text_of(kLibraryFolder + header);
    for (auto it = std::sregex_iterator(text.begin(), text.end(), type);
         it != std::sregex_iterator(); ++it) {
      const std::string before = (*it)[1];
      if (before == " private:") continue;
      EXPECT_NE(before.find("///"), std::string::npos) << header << ": " << (*it)[2];
      ++types;
    }
  }
  EXPECT_GT(types, 200U);
}

}  // namespace
}  // namespace surfel::test
