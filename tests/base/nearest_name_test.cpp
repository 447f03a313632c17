#include <gtest/gtest.h>
#include <surfel/base/nearest_name.h>

namespace surfel {
namespace {

const std::vector<std::string> kNames = {"--zoom", "--size",   "--frame-all", "--lod",
                                         "--from", "--output", "--lod-error", "-o"};

TEST(NearestName, IsAFewSlipsAway) {
  EXPECT_EQ(nearest_name("--zom", kNames), "--zoom");
  EXPECT_EQ(nearest_name("--zoomm", kNames), "--zoom");
  EXPECT_EQ(nearest_name("--ZOOM", kNames), "--zoom");
  EXPECT_EQ(nearest_name("-size", kNames), "--size");
  EXPECT_EQ(nearest_name("--form", kNames), "--from");  // Two letters swapped are one slip.
  EXPECT_EQ(nearest_name("--ouptut", kNames), "--output");
  EXPECT_EQ(nearest_name("--lod_eror", kNames), "--lod-error");
}

TEST(NearestName, IsTheOnlyOneThatBeginsSo) {
  EXPECT_EQ(nearest_name("--fra", kNames), "--frame-all");
  EXPECT_EQ(nearest_name("--lod-", kNames), "--lod");
  EXPECT_EQ(nearest_name("abc", {"abcdefgh", "abcdxyzw"}), "");
}

TEST(NearestName, IsNoneWhereNothingIsNear) {
  for (const std::string& text :
       {std::string(), std::string("-"), std::string("--"), std::string("x"), std::string("exact"),
        std::string("--shininess"), std::string(100000, 'z')}) {
    EXPECT_EQ(nearest_name(text, kNames), "") << text.substr(0, 20);
  }
  EXPECT_EQ(nearest_name("zoom", {}), "");
}

TEST(DidYouMean, EndsAMessage) {
  EXPECT_EQ(did_you_mean("--zom", kNames), "; did you mean --zoom?");
  EXPECT_EQ(did_you_mean("--shininess", kNames), "");
}

}  // namespace
}  // namespace surfel
