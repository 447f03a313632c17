#include "tools/support/options.h"

#include <gtest/gtest.h>
#include <surfel/base/color.h>

#include "tools/support/color.h"

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
    } catch (const OptionError& error) {
      const std::string message = error.what();
      EXPECT_NE(message.find("--eye"), std::string::npos) << message;
      EXPECT_NE(message.find(std::string("'") + text + "'"), std::string::npos) << message;
    }
  }
}

TEST(ParseSize, TakesWidthAndHeight) {
  EXPECT_EQ(parse_size("--size", "640x480"), std::make_pair(640, 480));
  EXPECT_EQ(parse_size("--size", "1x65536"), std::make_pair(1, 65536));
  EXPECT_EQ(parse_size("--size", "512"), std::make_pair(512, 512));
}

TEST(ParseSize, RefusesAllElse) {
  for (const char* text :
       {"", "x", "0", "65537", "-5", "6.5", "640x", "x480", "0x480", "640x-1", "640x65537",
        "640X480", "640x480x3", "6.5x4", "640 x 480", "99999999999x1"}) {
    EXPECT_THROW(parse_size("--size", text), OptionError) << text;
  }
}

TEST(WholeNumber, IsReadHoweverItIsWritten) {
  for (const auto& [text, digits] : std::vector<std::pair<std::string, std::string>>{
           {"0", "0"},
           {"-0", "0"},
           {"+7", "7"},
           {"-7", "-7"},
           {"010", "10"},
           {"1e5", "100000"},
           {"1E+5", "100000"},
           {"1.5e3", "1500"},
           {"20e-1", "2"},
           {"0e-9", "0"},
           {"100k", "100000"},
           {"100K", "100000"},
           {"2M", "2000000"},
           {"1.5G", "1500000000"},
           {".5k", "500"},
           {"3.00", "3"},
           {"18446744073709551615", "18446744073709551615"}}) {
    EXPECT_EQ(whole_number(text), digits) << text;
  }
  for (const char* text :
       {"",    ".",   "-",  "k",    "e5", "1.5", "1.2345k", "15e-1", "1e",  "1e999",
        "1kk", "1k5", "1m", "0x10", " 1", "1 ",  "1,000",   "nan",   "inf", "100kB"}) {
    EXPECT_EQ(whole_number(text), std::nullopt) << text;
  }
  EXPECT_EQ(whole_number(std::string(1000, '1')), std::nullopt);
}

TEST(ParseColor, TakesNamesAndHexadecimalsAsSrgbAndNumbersAsLinear) {
  using Color = std::array<float, 4>;
  const auto parse = [](const std::string& text) { return parse_color("--background", text); };
  const float half = srgb8_to_linear(0x80);
  EXPECT_EQ(parse("white"), (Color{1, 1, 1, 1}));
  EXPECT_EQ(parse("Gray"), (Color{half, half, half, 1}));
  EXPECT_EQ(parse("lime"), (Color{0, 1, 0, 1}));
  EXPECT_EQ(parse("transparent"), (Color{0, 0, 0, 0}));
  EXPECT_EQ(parse("#f00"), (Color{1, 0, 0, 1}));
  EXPECT_EQ(parse("#a1b"), parse("#aa11bb"));
  EXPECT_EQ(parse("#0080FF"), (Color{0, half, 1, 1}));
  EXPECT_EQ(parse("#0080ff33"), (Color{0, half, 1, 0.2f}));
  EXPECT_EQ(parse("1,0.5,0"), (Color{1, 0.5f, 0, 1}));
  EXPECT_EQ(parse("1,0.5,0,0.25"), (Color{1, 0.5f, 0, 0.25f}));
  EXPECT_EQ(parse_opaque_color("--dark", "navy")[2], half);
}

TEST(ParseColor, RefusesAllElseNamingOptionAndText) {
  for (const char* text : {"", "#", "#12", "#1234", "#12345", "#1234567", "#ggg", "#-12", "# 12",
                           "whit", "1", "1,1", "1,1,1,1,1", "1,1,x", "fff"}) {
    try {
      parse_color("--background", text);
      ADD_FAILURE() << text;
    } catch (const OptionError& error) {
      const std::string message = error.what();
      EXPECT_NE(message.find("--background"), std::string::npos) << message;
      EXPECT_NE(message.find(std::string("'") + text + "'"), std::string::npos) << message;
    }
  }
  EXPECT_THROW(parse_opaque_color("--dark", "transparent"), OptionError);
  EXPECT_THROW(parse_opaque_color("--dark", "1,1,1,0.5"), OptionError);
}

TEST(LongName, IsTheOneWithTwoDashes) {
  EXPECT_EQ(long_name("-o,--output"), "--output");
  EXPECT_EQ(long_name("--output,-o"), "--output");
  EXPECT_EQ(long_name("--size"), "--size");
  EXPECT_EQ(long_name("file"), "file");
}

class OptionNames : public testing::Test {
 protected:
  OptionNames() {
    for (const char* name : {"--outlier-k", "--lod-error", "-k", "-o,--output"}) {
      app_.add_option(name, value_);
    }
  }
  std::string told(const std::string& message) const {
    return with_option_names(message, app_, {{"neighbors", "--outlier-k"}});
  }
  std::string value_;
  CommandLine app_;
};

TEST_F(OptionNames, StandForTheFieldsThatTheySet) {
  EXPECT_EQ(told("`lod_error` is 5; it must be less"), "--lod-error is 5; it must be less");
  EXPECT_EQ(told("raise `neighbors` or `k`"), "raise --outlier-k or -k");
  EXPECT_EQ(told("a.ply: lower `output`"), "a.ply: lower --output");
}

TEST_F(OptionNames, FieldsWithoutAnOptionLoseTheirQuotes) {
  EXPECT_EQ(told("`max_distance` is -1"), "max_distance is -1");
  EXPECT_EQ(told("`x` is -1"), "x is -1");
}

TEST_F(OptionNames, OtherQuotesStay) {
  for (const char* text : {"", "`", "``", "`a", "``a", "`My file`.ply", "a `b c` d"}) {
    EXPECT_EQ(told(text), text);
  }
}

TEST_F(OptionNames, OfOptionsWithoutEffectAreTold) {
  app_.parse({"3", "-k", "1", "--lod-error"});
  EXPECT_EQ(without_effect(app_, {"--lod-error", "--outlier-k", "-k"}, "here"),
            (std::vector<std::string>{"--lod-error has no effect here; leave it out",
                                      "-k has no effect here; leave it out"}));
}

}  // namespace
}  // namespace surfel::tool
