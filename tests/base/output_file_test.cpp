#include <atomic>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <thread>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/export.h>
#include <surfel/base/output_file.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include "support/test_data.h"

namespace {

std::atomic<int> g_umask_calls{0};

}  // namespace

/// Stands before the C library's function in the library under test as well, which sees it.
extern "C" SURFEL_API mode_t umask(mode_t mask) noexcept {
  ++g_umask_calls;
  return static_cast<mode_t>(syscall(SYS_umask, mask));
}

namespace surfel {
namespace {

namespace fs = std::filesystem;
using test::TemporaryFolder;

void put(const std::string& path, const std::string& text) { std::ofstream(path) << text; }

std::string content(const std::string& path) {
  std::ostringstream text;
  text << std::ifstream(path).rdbuf();
  return text.str();
}

std::size_t entries(const TemporaryFolder& folder) {
  return static_cast<std::size_t>(
      std::distance(fs::directory_iterator(folder / ""), fs::directory_iterator()));
}

/// The message of the Error(kIo) that the action throws; empty if it throws none.
template <class Action>
std::string io_error(Action action) {
  try {
    action();
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kIo);
    return error.what();
  }
  return "";
}

TEST(OutputFile, AppearsWholeOnCommit) {
  const TemporaryFolder folder;
  const std::string path = folder / "a.ply";
  {
    OutputFile file(path);
    file.write("one ");
    EXPECT_FALSE(fs::exists(path));
    file.write("two");
    file.commit();
    EXPECT_EQ(content(path), "one two");
  }
  EXPECT_EQ(entries(folder), 1U);
}

TEST(OutputFile, LeavesNoTraceWithoutCommit) {
  const TemporaryFolder folder;
  const std::string path = folder / "a.ply";
  put(path, "old");
  {
    OutputFile file(path);
    file.write("new");
  }
  EXPECT_EQ(content(path), "old");
  EXPECT_EQ(entries(folder), 1U);
}

TEST(OutputFile, ReplacesAnOlderFileAndKeepsItsMode) {
  const TemporaryFolder folder;
  const std::string path = folder / "a.ply";
  put(path, "old and longer");
  ASSERT_EQ(chmod(path.c_str(), 0640), 0);
  OutputFile file(path);
  file.write("new");
  file.commit();
  EXPECT_EQ(content(path), "new");
  EXPECT_EQ(fs::status(path).permissions(), fs::perms(0640));
}

TEST(OutputFile, HonoursTheUmaskForANewFile) {
  const TemporaryFolder folder;
  const pid_t child = fork();
  if (child == 0) {
    umask(027);
    OutputFile(folder / "a").commit();
    _exit(0);
  }
  int status = -1;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  EXPECT_EQ(status, 0);
  EXPECT_EQ(fs::status(folder / "a").permissions(), fs::perms(0640));
}

TEST(OutputFile, LeavesTheUmaskAlone) {
  const TemporaryFolder folder;
  const int calls = g_umask_calls;
  OutputFile(folder / "a").commit();
  EXPECT_EQ(g_umask_calls, calls);
}

TEST(OutputFile, NoClobberRefusesAnOlderFile) {
  const TemporaryFolder folder;
  const std::string path = folder / "a.ply";
  put(path, "old");
  const std::string message = io_error([&] { OutputFile file(path, true); });
  EXPECT_NE(message.find(path), std::string::npos);
  EXPECT_NE(message.find("`no_clobber`"), std::string::npos);
  EXPECT_EQ(content(path), "old");
}

TEST(OutputFile, NoClobberRefusesAFileThatCameMeanwhile) {
  const TemporaryFolder folder;
  const std::string path = folder / "a.ply";
  {
    OutputFile file(path, true);
    file.write("new");
    put(path, "meanwhile");
    EXPECT_NE(io_error([&] { file.commit(); }), "");
  }
  EXPECT_EQ(content(path), "meanwhile");
  EXPECT_EQ(entries(folder), 1U);
}

TEST(OutputFile, NamesFileAndCauseWhereItCannotBe) {
  const TemporaryFolder folder;
  fs::create_directory(folder / "sub");
  put(folder / "plain", "");
  for (const std::string& path : {folder / "sub", folder / "none/a.ply", folder / "plain/a.ply",
                                  folder / "sub/", std::string("/proc/a.ply")}) {
    const std::string message = io_error([&] { OutputFile file(path); });
    EXPECT_NE(message.find(path), std::string::npos) << path << ": " << message;
  }
  EXPECT_NE(io_error([&] { OutputFile file(""); }), "");
}

TEST(OutputFile, RefusesReadOnlyFilesAndFolders) {
  if (geteuid() == 0) GTEST_SKIP() << "root may write anywhere";
  const TemporaryFolder folder;
  put(folder / "a", "old");
  ASSERT_EQ(chmod((folder / "a").c_str(), 0444), 0);
  EXPECT_NE(io_error([&] { OutputFile file(folder / "a"); }), "");
  ASSERT_EQ(chmod((folder / "").c_str(), 0555), 0);
  EXPECT_NE(io_error([&] { OutputFile file(folder / "b"); }), "");
  ASSERT_EQ(chmod((folder / "").c_str(), 0755), 0);
}

TEST(OutputFile, KeepsSymbolicLinksAndReplacesTheirTarget) {
  const TemporaryFolder folder;
  fs::create_directory(folder / "sub");
  put(folder / "sub/real.ply", "old");
  fs::create_symlink("sub/real.ply", folder / "link.ply");
  fs::create_symlink("link.ply", folder / "chain.ply");
  fs::create_symlink("sub/new.ply", folder / "dangling.ply");
  for (const std::string link : {"chain.ply", "dangling.ply"}) {
    OutputFile file(folder / link);
    file.write("new");
    file.commit();
    EXPECT_TRUE(fs::is_symlink(folder / link));
  }
  EXPECT_EQ(content(folder / "sub/real.ply"), "new");
  EXPECT_EQ(content(folder / "sub/new.ply"), "new");
}

TEST(OutputFile, EndlessLinksAreAnError) {
  const TemporaryFolder folder;
  fs::create_symlink("b", folder / "a");
  fs::create_symlink("a", folder / "b");
  const std::string message = io_error([&] { OutputFile file(folder / "a"); });
  EXPECT_NE(message.find("symbolic links"), std::string::npos) << message;
}

TEST(OutputFile, WritesIntoPipesOnCommit) {
  const TemporaryFolder folder;
  const std::string pipe = folder / "pipe";
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  std::string got;
  std::thread reader([&] { got = content(pipe); });
  {
    OutputFile file(pipe);
    file.write(std::string(200000, 'x'));
    file.commit();
  }
  reader.join();
  EXPECT_EQ(got, std::string(200000, 'x'));
  EXPECT_TRUE(fs::is_fifo(pipe));
}

TEST(OutputFile, WritesToDevicesWithoutReplacingThem) {
  {
    OutputFile file("/dev/null", true);
    file.write("gone");
    file.commit();
  }
  EXPECT_TRUE(fs::is_character_file("/dev/null"));
  if (!fs::exists("/dev/full")) return;
  OutputFile file("/dev/full");
  file.write("too much");
  EXPECT_NE(io_error([&] { file.commit(); }).find("/dev/full"), std::string::npos);
}

TEST(OutputFile, TemporaryKeepsTheExtensionOfLongNamesToo) {
  const TemporaryFolder folder;
  std::string longest(255, 'n');
  longest.replace(251, 4, ".png");
  for (const std::string& name : {std::string("a.png"), longest}) {
    OutputFile file(folder / name);
    EXPECT_TRUE(file.temporary().ends_with(".png"));
    file.commit();
    EXPECT_TRUE(fs::exists(folder / name));
  }
  OutputFile(folder / std::string(255, 'e').replace(0, 2, "a.")).commit();
  OutputFile(folder / ".hidden").commit();
  EXPECT_EQ(entries(folder), 4U);
}

TEST(OutputFile, RemoveTemporariesRemovesThoseThatAreOpen) {
  const TemporaryFolder folder;
  put(folder / "kept", "");
  OutputFile(folder / "done").commit();
  const OutputFile a(folder / "a");
  const OutputFile b(folder / "b");
  EXPECT_EQ(entries(folder), 4U);
  remove_temporaries();
  EXPECT_EQ(entries(folder), 2U);
}

TEST(OutputFile, TemporariesOfKilledProcessesAreRemovedByTheNext) {
  const TemporaryFolder folder;
  const OutputFile in_use(folder / "c.ply");
  const pid_t child = fork();
  if (child == 0) {
    const OutputFile a(folder / "a.ply");
    const OutputFile b(folder / "b");
    raise(SIGKILL);
  }
  int status = -1;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  // Names that others may have given.
  for (const char* name : {".a.surfel-temporary-short", ".a.surfel-temporary-longer7", "a.ply",
                           "a.surfel-temporary-abcdef", ".a.surfel-temporary-abcdeF"}) {
    put(folder / name, "mine");
  }
  EXPECT_EQ(entries(folder), 8U);
  // A process looks at a folder once, which this one has done; by another name it does again.
  OutputFile(folder / "./new").commit();
  EXPECT_EQ(entries(folder), 7U);
  EXPECT_TRUE(fs::exists(in_use.temporary()));
}

TEST(OutputFile, RoomIsFilledInAnyOrder) {
  const TemporaryFolder folder;
  OutputFile file(folder / "parts");
  file.write("head ");
  const std::uint64_t room = file.reserve(9);
  EXPECT_EQ(room, 5U);
  file.write(" tail");
  std::thread other([&] { file.write_at(room + 3, "456789", 6); });
  file.write_at(room, "123", 3);
  other.join();
  file.commit();
  EXPECT_EQ(content(folder / "parts"), "head 123456789 tail");
}

}  // namespace
}  // namespace surfel
