#include <algorithm>
#include <fstream>
#include <sstream>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/chart/journal.h>

#include "support/test_data.h"

namespace surfel {
namespace {

using test::TemporaryFolder;

std::string read(const std::string& path) {
  std::ostringstream text;
  text << std::ifstream(path, std::ios::binary).rdbuf();
  return text.str();
}

void write(const std::string& path, const std::string& text) {
  std::ofstream(path, std::ios::binary) << text;
}

class JournalFile : public testing::Test {
 protected:
  JournalFile() {
    Journal journal(path_, "run \"1\"");
    journal.add("a", "1");
    journal.add("b\n\"quoted\"", "two\nlines");
    journal.add("c", "3");
  }
  TemporaryFolder folder_;
  std::string path_ = folder_ / "journal.jsonl";
};

TEST_F(JournalFile, IsTakenUp) {
  const Journal journal(path_, "run \"1\"");
  EXPECT_EQ(journal.size(), 3U);
  ASSERT_NE(journal.find("b\n\"quoted\""), nullptr);
  EXPECT_EQ(*journal.find("b\n\"quoted\""), "two\nlines");
  EXPECT_EQ(journal.find("d"), nullptr);
}

TEST_F(JournalFile, BeginsAnewForAnotherRun) {
  EXPECT_EQ(Journal(path_, "run 2").size(), 0U);
  EXPECT_EQ(Journal(path_, "run \"1\"").size(), 0U);
}

TEST_F(JournalFile, DropsWhatIsNotWholeWhereverItWasCut) {
  const std::string whole = read(path_);
  for (std::size_t length = 0; length < whole.size(); ++length) {
    write(path_, whole.substr(0, length));
    {
      Journal journal(path_, "run \"1\"");
      // As many entries as there are whole lines after the header.
      const auto lines = std::count(whole.begin(), whole.begin() + static_cast<long>(length), '\n');
      EXPECT_EQ(journal.size(), static_cast<std::size_t>(std::max(0L, lines - 1))) << length;
      journal.add("new", "entry");
    }
    // What was appended after the cut is not joined to the rest of a broken line.
    const Journal again(path_, "run \"1\"");
    ASSERT_NE(again.find("new"), nullptr) << length;
    EXPECT_EQ(*again.find("new"), "entry");
  }
}

TEST_F(JournalFile, EndsAtALineThatIsNoEntry) {
  const std::string whole = read(path_);
  for (const char* line :
       {"{\"a\":1}", "[1,2]", "[\"a\"]", "nonsense", "[\"a\",\"b\",\"c\"]", ""}) {
    write(path_, whole + line + "\n[\"d\",\"4\"]\n");
    const Journal journal(path_, "run \"1\"");
    EXPECT_EQ(journal.size(), 3U) << line;
    EXPECT_EQ(read(path_), whole) << line;
  }
}

TEST(Journal, TellsThatItCannotBeWritten) {
  const TemporaryFolder folder;
  EXPECT_THROW(Journal(folder / "none/journal", "run"), Error);
  std::filesystem::create_directory(folder / "work");
  Journal journal(folder / "work/journal", "run");
  std::filesystem::remove_all(folder / "work");
  EXPECT_THROW(journal.add("a", "1"), Error);
}

}  // namespace
}  // namespace surfel
