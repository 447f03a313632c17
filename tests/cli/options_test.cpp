#include "tools/support/options.h"

#include <gtest/gtest.h>

namespace surfel::tool {
namespace {

TEST(ParseNumbers, TakesNumbersPartedByCommas) {
  EXPECT_EQ(parse_numbers("--eye", "0,0,3", 3), (std::vector<double>{0, 0, 3}));
  EXPECT_EQ(parse_numbers("--eye", "-1.5, +2 ,1e-3", 3), (std::vector<double>{-1.5, 2, 1e-3}));
  EXPECT_EQ(parse_numbers("--x", ".5", 1), (std::vector<double>{0.5}));
}

TEST(ParseNumbers, RefusesAllElseNamingOptionAndText) {
  for (const char* text : {"", "1", "1,2", "1,2,3,", ",1,2,3", "1,2,3,4", "1,,3", "1,2,x", "1,2,3x",
                           "1 2 3", "1,2,nan", "1,2,inf", "1;2;3"}) {
    try {
      parse_numbers("--eye", text, 3);
      ADD_FAILURE() << text;
    } catch (const CLI::ConversionError& error) {
      const std::string message = error.what();
      EXPECT_NE(message.find("--eye"), std::string::npos) << message;
      EXPECT_NE(message.find(std::string("'") + text + "'"), std::string::npos) << message;
    }
  }
}

TEST(ParseSize, TakesWidthAndHeight) {
  EXPECT_EQ(parse_size("--size", "640x480"), std::make_pair(640, 480));
  EXPECT_EQ(parse_size("--size", "1x65536"), std::make_pair(1, 65536));
}

TEST(ParseSize, RefusesAllElse) {
  for (const char* text : {"", "x", "640", "640x", "x480", "0x480", "640x-1", "640x65537",
                           "640X480", "640x480x3", "6.5x4", "640 x 480", "99999999999x1"}) {
    EXPECT_THROW(parse_size("--size", text), CLI::ConversionError) << text;
  }
}

TEST(LongName, IsTheOneWithTwoDashes) {
  EXPECT_EQ(long_name("-o,--output"), "--output");
  EXPECT_EQ(long_name("--output,-o"), "--output");
  EXPECT_EQ(long_name("--size"), "--size");
  EXPECT_EQ(long_name("file"), "file");
}

}  // namespace
}  // namespace surfel::tool
