#include <string>

#include <gtest/gtest.h>
#include <surfel/base/crc32c.h>

namespace surfel::test {
namespace {

std::uint32_t crc_of(const std::string& text) { return crc32c(std::as_bytes(std::span(text))); }

TEST(Crc32c, ChecksOfTheStandard) {
  // RFC 3720, B.4, and the check value of the catalogues of such codes.
  EXPECT_EQ(crc_of(std::string(32, '\0')), 0x8A9136AAU);
  EXPECT_EQ(crc_of(std::string(32, '\xFF')), 0x62A8AB43U);
  std::string ascending;
  for (int i = 0; i < 32; ++i) ascending += static_cast<char>(i);
  EXPECT_EQ(crc_of(ascending), 0x46DD794EU);
  EXPECT_EQ(crc_of("123456789"), 0xE3069283U);
  EXPECT_EQ(crc_of(""), 0U);
}

TEST(Crc32c, AllLengthsAgreeWithOneBitAtATime) {
  std::string text;
  for (int length = 0; length < 40; ++length) {
    std::uint32_t remainder = ~std::uint32_t{0};
    for (const char c : text) {
      remainder ^= static_cast<unsigned char>(c);
      for (int bit = 0; bit < 8; ++bit) {
        remainder = (remainder >> 1) ^ ((remainder & 1) != 0 ? 0x82F63B78U : 0U);
      }
    }
    EXPECT_EQ(crc_of(text), ~remainder) << length;
    text += static_cast<char>(37 * length + 11);
  }
}

}  // namespace
}  // namespace surfel::test
