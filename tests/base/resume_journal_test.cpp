#include <filesystem>
#include <functional>

#include <gtest/gtest.h>
#include <surfel/base/output_file.h>
#include <surfel/base/resume_journal.h>
#include <surfel/base/scratch_file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "support/message_of.h"
#include "support/run_tool.h"

namespace surfel::test {
namespace {

using Entries = std::vector<std::string>;

Entries entries_of(const std::string& path, const std::string& job) {
  return ResumeJournal(path, job).take_entries();
}

TEST(ResumeJournal, EntriesOfTheSameJobComeBack) {
  const TemporaryFolder folder;
  const std::string path = folder / "journal";
  const std::string zeros(3, '\0');
  {
    ResumeJournal journal(path, "job");
    EXPECT_EQ(journal.take_entries(), Entries{});
    EXPECT_FALSE(std::filesystem::exists(path));
    for (const std::string& entry : {std::string("one"), zeros, std::string()}) journal.add(entry);
  }
  {
    ResumeJournal journal(path, "job");
    EXPECT_EQ(journal.take_entries(), (Entries{"one", zeros, ""}));
    journal.add("four");
  }
  // A run of another job that ends before it has done anything changes nothing.
  EXPECT_EQ(entries_of(path, "other job"), Entries{});
  EXPECT_EQ(entries_of(path, "job"), (Entries{"one", zeros, "", "four"}));
  ResumeJournal(path, "other job").add("five");
  EXPECT_EQ(entries_of(path, "job"), Entries{});
  ResumeJournal journal(path, "other job");
  EXPECT_EQ(journal.take_entries(), Entries{"five"});
  journal.remove();
  EXPECT_FALSE(std::filesystem::exists(path));
  journal.remove();
}

TEST(ResumeJournal, IsReadUpToTheFirstEntryThatIsNotWhole) {
  const TemporaryFolder folder;
  const std::string path = folder / "journal";
  {
    ResumeJournal journal(path, "job");
    for (const char* entry : {"first", "second", "third"}) journal.add(entry);
  }
  const std::string whole = read_text(path);
  for (std::size_t size = 0; size <= whole.size(); ++size) {
    write_text(path, whole.substr(0, size));
    ResumeJournal journal(path, "job");
    const Entries entries = journal.take_entries();
    const Entries all{"first", "second", "third"};
    ASSERT_LE(entries.size(), all.size());
    EXPECT_TRUE(std::equal(entries.begin(), entries.end(), all.begin())) << size;
    EXPECT_EQ(entries.size() == all.size(), size == whole.size());
    // What is added next is whole again.
    journal.add("next");
    EXPECT_EQ(entries_of(path, "job").size(), entries.size() + 1);
  }
  for (std::size_t at = 0; at < whole.size(); ++at) {
    std::string damaged = whole;
    damaged[at] ^= 1;
    write_text(path, damaged);
    EXPECT_LT(entries_of(path, "job").size(), 3U) << at;
  }
}

TEST(ResumeJournal, AFileThatCannotBeWrittenIsAnError) {
  EXPECT_NE(message_of([] {
              ResumeJournal("/no/folder/journal", "job").add("entry");
            }).find("/no/folder/journal: cannot be written"),
            std::string::npos);
}

TEST(FileMark, ChangesWithTheFile) {
  const TemporaryFolder folder;
  const std::string path = folder / "file";
  const std::string bytes(std::size_t{6} << 20, 'a');
  write_text(path, bytes);
  const auto time = std::filesystem::last_write_time(path);
  const std::string mark = file_mark(path);
  EXPECT_EQ(file_mark(path), mark);
  std::string changed = bytes;
  changed.back() = 'b';
  write_text(path, changed);
  std::filesystem::last_write_time(path, time);
  EXPECT_NE(file_mark(path), mark);
  write_text(path, bytes);
  std::filesystem::last_write_time(path, time);
  EXPECT_EQ(file_mark(path), mark);
  std::filesystem::last_write_time(path, time + std::chrono::seconds(1));
  EXPECT_NE(file_mark(path), mark);
  EXPECT_NE(message_of([] { file_mark("/no/file"); }).find("/no/file: cannot be read"),
            std::string::npos);
}

TEST(OutputFile, KeepsTheBytesOfAnUnfinishedFile) {
  const TemporaryFolder folder;
  const std::string path = folder / "file";
  write_text(path, "old");
  {
    OutputFile file(path, false, Unfinished::kKept);
    file.write("begun");
    EXPECT_NE(
        message_of([&] { OutputFile(path, false, Unfinished::kKept); }).find("another process"),
        std::string::npos);
  }
  EXPECT_EQ(read_text(path), "old");
  EXPECT_EQ(read_text(path + ".unfinished"), "begun");
  {
    OutputFile file(path, false, Unfinished::kKept);
    std::string there(9, '.');
    EXPECT_EQ(file.read_at(0, there.data(), there.size()), 5U);
    EXPECT_EQ(there, "begun....");
    file.write_at(5, " and done", 9);
    file.commit();
  }
  EXPECT_EQ(read_text(path), "begun and done");
  EXPECT_FALSE(std::filesystem::exists(path + ".unfinished"));
  EXPECT_NE(message_of([] { OutputFile("-", false, Unfinished::kKept); }).find("`resume`"),
            std::string::npos);
}

TEST(ContentMark, IsOfTheContentAlone) {
  const TemporaryFolder folder;
  const std::string zeros(300000, '\0');
  write_text(folder / "a", zeros);
  write_text(folder / "b", zeros);
  std::filesystem::last_write_time(folder / "b", std::filesystem::file_time_type::min());
  const std::string mark = content_mark(folder / "a");
  EXPECT_EQ(content_mark(folder / "b"), mark);
  for (const std::size_t place : {std::size_t{0}, std::size_t{65536}, zeros.size() - 1}) {
    std::string changed = zeros;
    changed[place] = 'x';
    write_text(folder / "b", changed);
    EXPECT_NE(content_mark(folder / "b"), mark) << place;
  }
  EXPECT_TRUE(message_of([] { content_mark("/no/file"); }).starts_with("/no/file: cannot be read"));
  std::filesystem::create_directory(folder / "c");
  const std::string empty = content_mark(folder / "c");
  write_text(folder / "c/d", "one");
  const std::string one = content_mark(folder / "c");
  EXPECT_NE(one, empty);
  write_text(folder / "c/d", "two");
  EXPECT_NE(content_mark(folder / "c"), one);
}

TEST(ResumeJournal, KeptFilesAreNotThoseThatOthersPointAt) {
  const TemporaryFolder folder;
  const std::string target = folder / "out.ply";
  const std::string victim = folder / "victim";
  write_text(victim, "as it was");
  struct Case {
    std::string name;
    std::function<void()> open;
  };
  const std::vector<Case> cases{
      {target + ".unfinished", [&] { OutputFile(target, false, Unfinished::kKept); }},
      {target + ".unfinished-parts",
       [&] { ResumeJournal(target + ".unfinished-parts", "job").add("one"); }},
      {target + ".unfinished-scratch",
       [&] { ScratchFile(target, target + ".unfinished-scratch"); }}};
  for (const Case& each : cases) {
    const auto refused = [&](const std::string& why) {
      const std::string message = message_of([&] { each.open(); });
      EXPECT_TRUE(message.starts_with(each.name + ": " + why)) << message;
      EXPECT_EQ(read_text(victim), "as it was");
      std::filesystem::remove(each.name);
    };
    std::filesystem::create_symlink(victim, each.name);
    refused("is a symbolic link");
    std::filesystem::create_symlink(folder / "nothing", each.name);
    refused("is a symbolic link");
    EXPECT_FALSE(std::filesystem::exists(folder / "nothing"));
    std::filesystem::create_hard_link(victim, each.name);
    refused("is the name of a file that has other names");
    ASSERT_EQ(mkfifo(each.name.c_str(), 0600), 0);
    refused("is no file");
    if (geteuid() == 0) {  // Only root can give a file away.
      write_text(each.name, "");
      ASSERT_EQ(chown(each.name.c_str(), 12345, 12345), 0);
      refused("belongs to another user");
    }
    each.open();  // A file that is not there is made.
    std::filesystem::remove(each.name);
  }
}

}  // namespace
}  // namespace surfel::test
