#include <algorithm>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/instructions.h>

#include "support/message_of.h"

namespace surfel::test {
namespace {

TEST(Instructions, AreChosenByName) {
  const std::vector<std::string> names = available_instructions();
  ASSERT_FALSE(names.empty());
  const std::string fastest = instructions();
  EXPECT_EQ(fastest, names.front());
  for (const std::string& name : names) {
    set_instructions(name);
    EXPECT_EQ(instructions(), name);
    EXPECT_EQ(available_instructions(), names);
  }
  set_instructions(fastest);
}

TEST(Instructions, UnknownNamesAreRefused) {
  const std::string before = instructions();
  const std::string message = message_of([] { set_instructions("mmx"); });
  EXPECT_NE(message.find("'mmx'"), std::string::npos) << message;
  for (const std::string& name : available_instructions()) {
    EXPECT_NE(message.find(name), std::string::npos) << message;
  }
  EXPECT_EQ(instructions(), before);
}

}  // namespace
}  // namespace surfel::test
