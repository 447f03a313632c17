// What may happen to a run: calls of the system that fail, one after the other; limits of memory
// and threads; signals at any time; another program that cuts its input, or writes the same output.
// It says so and leaves the older output whole, or it ends well and the output is right.

#include <cerrno>
#include <chrono>
#include <cstring>
#include <thread>
#include <utility>

#include <gtest/gtest.h>
#include <surfel/base/process.h>

#include "support/run_tool.h"
#include "support/sanitized.h"

namespace surfel::test {
namespace {

namespace fs = std::filesystem;

struct Fault {
  const char* call;
  /// errno; 0: the call does half of its work; -1: half of the file is cut off before; -2: the call
  /// does half of its work, and the process is killed.
  int error;
};

/// How every tool is run, without its output, which is a PLY file, a picture or standard output.
struct Command {
  std::string words;
  std::string output;
};

const std::vector<Command>& commands() {
  static const std::vector<Command> all = {
      {"surfel-convert many.ply", "out.ply"},
      {"surfel-convert many.ply --sort curve --memory 100000", "out.ply"},
      {"surfel-estimate many.ply", "out.ply"},
      {"surfel-texture many.ply --from colors --fit render", "out.ply"},
      {"surfel-group many.ply", "out.ply"},
      {"surfel-lod many.ply", "out.ply"},
      {"surfel-simplify many.ply --count 200", "out.ply"},
      {"surfel-render many.ply --size 64", "out.png"},
      {"surfel-render many.ply --size 64 --method two-pass --memory 1M", "out.png"},
      {"surfel-render many.ply --size 64 --tiles 1/2", "out.exr"},
      {"surfel-join part.exr", "out.png"},
      {"surfel-render --mesh mesh.obj --size 16 --samples 1", "out.png"},
      {"surfel-from-mesh mesh.obj --count 300", "out.ply"},
      {"surfel-generate sphere --count 3000", "out.ply"},
      {"surfel-compare a.png a.png", "out.exr"},
      {"surfel-info many.ply", ""},
      {"surfel-chart cloud.ply --recommend --max-error 1 --quick --size 8x8 --repeats 1 "
       "--samples 1",
       ""},
  };
  return all;
}

/// Commands that make files which only some tests read.
constexpr const char* kMakeChecker = "surfel-generate checker --size 8x8 -o a.png";
constexpr const char* kMakeMany = "surfel-generate sphere --texture noise --count 3000 -o many.ply";
constexpr const char* kMakePart = "surfel-render many.ply --size 32 --tiles 1/1 -o part.exr";

class Faults : public testing::Test {
 protected:
  void SetUp() override {
    if (kSanitized) GTEST_SKIP() << "sanitizers want to be loaded before all other libraries";
    write_text(folder_ / "cloud.ply",
               "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
               "property float z\nproperty float nx\nproperty float ny\nproperty float nz\n"
               "property float variance\nend_header\n0 0 0 0 0 1 .2\n1 0 0 0 0 1 .2\n"
               "0 1 0 0 0 1 .2\n1 1 0 0 0 1 .2\n");
    write_text(folder_ / "mesh.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
  }

  void make(const std::vector<const char*>& commands) const {
    for (const char* command : commands) {
      const RunResult result = run_here(command);
      EXPECT_EQ(result.exit_code, 0) << command << result.errors;
    }
  }

  /// Runs the command in the folder, with the fault if there is one.
  RunResult run_here(const std::string& command, const std::string& environment = "",
                     const RunSetup& setup = {}) const {
    return run({"sh", "-c",
                "cd '" + (folder_ / "") + "' && exec env " + environment + " " +
                    (fs::path(SURFEL_TOOL_DIR) / command).string()},
               setup);
  }
  static std::string fault(const Fault& fault, int number, const std::string& seen) {
    return "LD_PRELOAD='" + std::string(SURFEL_FAULT_LIBRARY) + "' FAULT_CALL=" + fault.call +
           " FAULT_NUMBER=" + std::to_string(number) +
           " FAULT_ERROR=" + std::to_string(fault.error) + " FAULT_SEEN='" + seen + "'";
  }

  /// Lets each call in turn fail until the run makes no more of them.
  /// \param sparse  Where there are many calls: from one that fails to the next is a part of all
  ///                that come before, 1 / sparse; 0: every call fails.
  /// \return how many runs failed.
  int expect_sound(const std::string& command, const std::string& output, const Fault& fault,
                   int sparse = 0) {
    const std::string path = folder_ / output;
    fs::remove(path);
    const RunResult sound = run_here(command);
    EXPECT_EQ(sound.exit_code, 0) << command << sound.errors;
    const std::string right = read_text(path);
    const std::string seen = seen_ / "seen";
    const int kMostCalls = sparse > 0 ? 100000 : 100;
    int failed = 0;
    int number = 1;
    for (; number < kMostCalls; number += 1 + (sparse > 0 ? number / sparse : 0)) {
      write_text(path, "old");
      const auto before = entries(folder_ / "");
      const RunResult result = run_here(command, Faults::fault(fault, number, seen));
      const std::string what = command + ", " + fault.call + " " + std::to_string(number) + ", " +
                               std::strerror(fault.error) + ": " + result.errors;
      if (!fs::exists(seen)) {
        EXPECT_EQ(result.exit_code, 0) << what;
        break;
      }
      fs::remove(seen);
      EXPECT_EQ(entries(folder_ / ""), before) << what;
      if (result.exit_code == 0) {
        EXPECT_EQ(read_text(path), right) << what;
        continue;
      }
      ++failed;
      EXPECT_EQ(result.exit_code, 1) << what;
      EXPECT_EQ(read_text(path), "old") << what;
      EXPECT_TRUE(contains(result.errors, output) || contains(result.errors, "cloud.ply") ||
                  contains(result.errors, "points.ply") || contains(result.errors, "mesh.obj") ||
                  contains(result.errors, "a.png"))
          << what;
    }
    EXPECT_LT(number, kMostCalls) << command;
    // Levels of detail go to their places by pwrite() alone.
    const bool in_place =
        contains(command, "surfel-lod") && fault.call == std::string_view("write");
    EXPECT_TRUE(number > 1 || in_place || std::string_view(fault.call).starts_with("p")) << command;
    return failed;
  }

  TemporaryFolder folder_;
  TemporaryFolder seen_;
};

TEST_F(Faults, EveryCallOfASmallRunMayFail) {
  for (const Fault& fault :
       {Fault{"open", EMFILE}, Fault{"open", EINTR}, Fault{"write", ENOSPC}, Fault{"write", EINTR},
        Fault{"write", 0}, Fault{"pwrite", ENOSPC}, Fault{"pwrite", EINTR}, Fault{"pwrite", 0},
        Fault{"pread", EIO}, Fault{"pread", EINTR}, Fault{"pread", 0}, Fault{"fsync", EIO},
        Fault{"fsync", EINTR}, Fault{"rename", EIO}, Fault{"close", EIO}}) {
    expect_sound("surfel-convert cloud.ply -o out.ply", "out.ply", fault);
    expect_sound("surfel-render cloud.ply --size 8x8 -o out.png", "out.png", fault);
  }
}

TEST_F(Faults, EveryToolKeepsTheOlderOutput) {
  make({kMakeChecker});
  for (const Fault& fault : {Fault{"open", EMFILE}, Fault{"write", ENOSPC}, Fault{"pwrite", EIO},
                             Fault{"rename", EIO}}) {
    for (const char* command :
         {"surfel-estimate cloud.ply", "surfel-texture cloud.ply --solid marble",
          "surfel-group cloud.ply", "surfel-lod cloud.ply", "surfel-simplify cloud.ply --count 2",
          "surfel-from-mesh mesh.obj --count 3", "surfel-generate plane --count 50"}) {
      expect_sound(std::string(command) + " -o out.ply", "out.ply", fault);
    }
    expect_sound("surfel-compare a.png a.png -o out.png", "out.png", fault);
  }
}

TEST_F(Faults, WorkIsTakenUpAfterCallsThatFailWhileSidesWaitOnTheDisk) {
  ASSERT_EQ(run_here("surfel-generate terrain --count 9000 --no-uv -o points.ply").exit_code, 0);
  const std::string command =
      "surfel-estimate points.ply --threads 1 --memory 8M --orient winding --resume -o out.ply";
  const std::string path = folder_ / "out.ply";
  ASSERT_EQ(run_here(command).exit_code, 0);
  const std::string right = read_text(path);
  const auto whole = entries(folder_ / "");
  for (const Fault& fault : {Fault{"open", EMFILE}, Fault{"write", ENOSPC}, Fault{"write", 0},
                             Fault{"pwrite", EIO}, Fault{"pread", EIO}}) {
    int failed = 0;
    for (int number = 1;; number *= 2) {
      const RunResult result = run_here(command, Faults::fault(fault, number, seen_ / "seen"));
      if (!fs::remove(seen_ / "seen")) break;
      const std::string what = std::string(fault.call) + ": " + result.errors;
      if (result.exit_code != 0) {
        ++failed;
        EXPECT_EQ(result.exit_code, 1) << what;
        EXPECT_TRUE(contains(result.errors, "out.ply") || contains(result.errors, "points.ply"))
            << what;
        EXPECT_EQ(run_here(command).exit_code, 0) << what;
      }
      EXPECT_TRUE(read_text(path) == right) << what;
      EXPECT_EQ(entries(folder_ / ""), whole) << what;
    }
    EXPECT_EQ(failed > 0, fault.error != 0) << fault.call;
  }
  // What is written first waits there.
  const RunResult full = run_here(command, fault({"write", ENOSPC}, 1, seen_ / "seen"));
  EXPECT_TRUE(contains(full.errors, "(for out.ply)")) << full.errors;
  EXPECT_TRUE(contains(full.errors, "make room")) << full.errors;
}

TEST_F(Faults, AFileThatShrinksWhileItIsReadIsAnError) {
  make({kMakeMany});
  const std::string seen = seen_ / "seen";
  const std::string input = folder_ / "many.ply";
  const std::string whole = read_text(input);
  for (const Command& command : commands()) {
    if (!contains(command.words, "many.ply")) continue;
    const std::string output = command.output.empty() ? "" : " -o " + command.output;
    const std::string path = folder_ / command.output;
    ASSERT_EQ(run_here(command.words + output).exit_code, 0) << command.words;
    const std::string right = command.output.empty() ? "" : read_text(path);
    int refused = 0;
    for (int number = 1;; ++number) {
      ASSERT_LT(number, 100);
      write_text(input, whole);
      const RunResult result = run_here(command.words + output, fault({"pread", -1}, number, seen));
      if (!fs::remove(seen)) break;
      const std::string what = command.words + ": " + result.errors;
      if (result.exit_code == 0) {
        // What was cut off had been read already.
        EXPECT_TRUE(command.output.empty() || read_text(path) == right) << what;
        continue;
      }
      ++refused;
      EXPECT_EQ(result.exit_code, 1) << what;
      // The file of what does not fit into memory may be the one that shrinks.
      const bool named = contains(result.errors, "many.ply: ") ||
                         contains(result.errors, "what was written beside it cannot be read");
      EXPECT_TRUE(named) << what;
    }
    write_text(input, whole);
    EXPECT_GT(refused, 0) << command.words;
  }
}

TEST_F(Faults, WorkThatIsKilledAtAnyMomentIsTakenUpAndHasTheSameBytes) {
  const std::string seen = seen_ / "seen";
  ASSERT_EQ(run_here("surfel-generate terrain --count 40000 --no-uv -o points.ply").exit_code, 0);
  for (const std::string command : {"surfel-convert points.ply --sort curve --memory 600000",
                                    "surfel-estimate points.ply --orient up --memory 2M",
                                    "surfel-texture points.ply --solid checker --memory 2M",
                                    "surfel-lod points.ply --reduction 9 --memory 64M"}) {
    ASSERT_EQ(run_here(command + " -o right.ply").exit_code, 0) << command;
    const std::string right = read_text(folder_ / "right.ply");
    int kills = 0;
    int taken_up = 0;
    for (int run = 0;; ++run) {
      ASSERT_LT(run, 300) << command;
      // The journal is written by write(), rows by pwrite().
      const Fault kill{run % 3 == 0 ? "write" : "pwrite", -2};
      const RunResult result =
          run_here(command + " --resume -o out.ply", fault(kill, 1 + run * 7 % 19, seen));
      taken_up += contains(result.errors, "going on where an earlier run stopped") ? 1 : 0;
      if (result.exit_code == 0) break;
      ++kills;
      EXPECT_FALSE(fs::exists(folder_ / "out.ply")) << command;
    }
    EXPECT_TRUE(read_text(folder_ / "out.ply") == right) << command;
    EXPECT_GT(kills, 0) << command;
    EXPECT_GT(taken_up, 0) << command;
    fs::remove(folder_ / "out.ply");
    fs::remove(folder_ / "right.ply");
    EXPECT_FALSE(fs::exists(folder_ / "out.ply.unfinished")) << command;
    EXPECT_FALSE(fs::exists(folder_ / "out.ply.unfinished-parts")) << command;
    EXPECT_FALSE(fs::exists(folder_ / "out.ply.unfinished-scratch")) << command;
  }
}

TEST_F(Faults, WorkInBlocksAlongTheCurveIsTakenUp) {
  // So many surfels that they are worked on in blocks.
  ASSERT_EQ(run_here("surfel-generate terrain --count 264000 --no-uv -o surfels.ply").exit_code, 0);
  struct Work {
    std::string command;
    std::vector<std::pair<Fault, int>> kills;  ///< Of each run, before which of its calls.
  };
  for (const Work& work :
       {Work{"surfel-group surfels.ply", {{{"pwrite", -2}, 30}, {{"write", -2}, 2}}},
        Work{"surfel-simplify surfels.ply --count 2000", {{{"write", -2}, 4}, {{"pwrite", -2}, 1}}},
        Work{"surfel-texture surfels.ply --from colors --fit render --cutoff 0.2",
             {{{"pwrite", -2}, 30}}}}) {
    const std::string& command = work.command;
    ASSERT_EQ(run_here(command + " -o right.ply").exit_code, 0) << command;
    for (const auto& [kill, number] : work.kills) {
      const RunResult killed =
          run_here(command + " --resume -o out.ply", fault(kill, number, seen_ / "seen"));
      EXPECT_NE(killed.exit_code, 0) << command;
      EXPECT_TRUE(fs::exists(folder_ / "out.ply.unfinished-parts")) << command;
      EXPECT_FALSE(fs::exists(folder_ / "out.ply")) << command;
    }
    const RunResult result = run_here(command + " --resume -o out.ply");
    EXPECT_EQ(result.exit_code, 0) << command << result.errors;
    EXPECT_TRUE(contains(result.errors, "going on where an earlier run stopped")) << command;
    EXPECT_TRUE(read_text(folder_ / "out.ply") == read_text(folder_ / "right.ply")) << command;
    for (const char* rest : {"", "-parts", "-scratch"}) {
      EXPECT_FALSE(fs::exists(folder_ / "out.ply.unfinished" + rest)) << command;
    }
    fs::remove(folder_ / "out.ply");
    fs::remove(folder_ / "right.ply");
  }
}

TEST_F(Faults, WorkThatCannotBeTakenUpIsRefused) {
  ASSERT_EQ(run_here("surfel-generate terrain --count 300 --no-uv -o points.ply").exit_code, 0);
  for (const std::string command :
       {"surfel-convert points.ply --sort curve", "surfel-estimate points.ply --orient up",
        "surfel-texture points.ply --solid checker", "surfel-group points.ply",
        "surfel-simplify points.ply --count 9", "surfel-lod points.ply"}) {
    const RunResult piped = run_here(command + " --resume -o -");
    EXPECT_EQ(piped.exit_code, 2) << command;
    EXPECT_TRUE(contains(piped.errors, "name a file")) << command << piped.errors;
  }
  for (const std::string command :
       {"surfel-texture points.ply --from colors --fit render --robust auto",
        "surfel-texture points.ply --from colors --fit gram --bounds 0,1",
        "surfel-group points.ply --groups 3", "surfel-group points.ply --cover enlarge"}) {
    const RunResult result = run_here(command + " --resume -o out.ply");
    EXPECT_EQ(result.exit_code, 2) << command;
    EXPECT_TRUE(contains(result.errors, "leave out --resume")) << command << result.errors;
  }
}

TEST_F(Faults, WhereNoThreadCanBeStartedToolsWorkOrSaySo) {
  make({kMakeChecker, kMakeMany, kMakePart});
  const std::string seen = seen_ / "seen";
  for (const Command& command : commands()) {
    const std::string words =
        command.words + " --threads 8" + (command.output.empty() ? "" : " -o " + command.output);
    const std::string path = folder_ / command.output;
    ASSERT_EQ(run_here(words).exit_code, 0) << words;
    const std::string right = command.output.empty() ? "" : read_text(path);
    const bool plugin =
        contains(words, "--mesh") || contains(words, ".exr") || contains(words, "surfel-chart");
    // From the first thread on; else in the middle of the threads that a loop wants at once.
    for (const int number : {1, 5}) {
      const RunResult result = run_here(words, fault({"pthread_create", EAGAIN}, number, seen));
      const std::string what = words + ": " + result.errors;
      if (result.exit_code == 0) {
        EXPECT_TRUE(command.output.empty() || read_text(path) == right) << what;
        continue;
      }
      // Libraries that would end the process are not loaded.
      EXPECT_EQ(result.exit_code, 1) << what;
      EXPECT_TRUE(contains(result.errors, "needs more threads than can be started")) << what;
      EXPECT_TRUE(plugin) << what;
    }
  }
  EXPECT_TRUE(fs::exists(seen));
}

TEST_F(Faults, LimitsOfMemoryAreToldByEveryTool) {
  make({kMakeChecker, kMakeMany, kMakePart});
  for (const Command& command : commands()) {
    const std::string words =
        command.words + (command.output.empty() ? "" : " -o " + command.output);
    const std::string path = folder_ / command.output;
    ASSERT_EQ(run_here(words).exit_code, 0) << words;
    const std::string right = command.output.empty() ? "" : read_text(path);
    bool enough = false;
    // KB of address space: from what the libraries alone take on.
    for (const int kilobytes : {24000, 48000, 96000, 320000, 1280000}) {
      if (!command.output.empty()) write_text(path, "old");
      const auto before = entries(folder_ / "");
      const RunResult result =
          run({"sh", "-c",
               "cd '" + (folder_ / "") + "' && ulimit -v " + std::to_string(kilobytes) +
                   " && exec " + (fs::path(SURFEL_TOOL_DIR) / words).string() + " --threads 8"});
      const std::string what = words + " in " + std::to_string(kilobytes) + " kB: " + result.errors;
      // The loader of programs ends with 127 where there is no room for the libraries.
      if (result.exit_code == 127) continue;
      EXPECT_EQ(entries(folder_ / ""), before) << what;
      enough = result.exit_code == 0;
      if (enough) {
        EXPECT_TRUE(command.output.empty() || read_text(path) == right) << what;
        continue;
      }
      EXPECT_EQ(result.exit_code, 1) << what << " signal " << result.signal;
      EXPECT_TRUE(contains(result.errors, "memory")) << what;
      EXPECT_TRUE(command.output.empty() || read_text(path) == "old") << what;
    }
    EXPECT_TRUE(enough) << words;
  }
}

TEST_F(Faults, SignalsAtAnyTimeLeaveTheOlderOutputOrTheNewOne) {
  const std::string words = "surfel-generate terrain --count 60000 --quiet -o out.ply";
  const std::string path = folder_ / "out.ply";
  const auto start = std::chrono::steady_clock::now();
  ASSERT_EQ(run_here(words).exit_code, 0);
  const auto whole_run = std::chrono::steady_clock::now() - start;
  const std::string right = read_text(path);
  for (const int signal : {SIGKILL, SIGTERM, SIGINT}) {
    for (int tenth = 0; tenth < 10; ++tenth) {
      write_text(path, "old");
      const auto before = entries(folder_ / "");
      const RunResult result =
          run_here(words, "", {.input = {}, .meanwhile = [&](pid_t process) {
                                 std::this_thread::sleep_for(whole_run * tenth / 10);
                                 kill(process, signal);
                               }});
      const std::string what =
          std::to_string(signal) + " after " + std::to_string(tenth) + " tenths: " + result.errors;
      if (result.exit_code == 0) {
        EXPECT_EQ(read_text(path), right) << what;
      } else if (result.exit_code == 1) {
        EXPECT_NE(signal, SIGKILL);
        EXPECT_TRUE(contains(result.errors, "surfel-generate: error: interrupted")) << what;
      } else {
        // SIGKILL, or a signal that came before the tool could ask for it.
        EXPECT_EQ(result.signal, signal) << what;
      }
      // A file that is written is on the disk before it has its name; it may have it already.
      if (result.exit_code != 0) {
        EXPECT_TRUE(read_text(path) == "old" || read_text(path) == right) << what;
      }
      // The next run that writes to the folder removes what a killed one has left.
      if (signal == SIGKILL) {
        ASSERT_EQ(run_here("surfel-convert cloud.ply -o next.ply").exit_code, 0);
        fs::remove(folder_ / "next.ply");
      }
      EXPECT_EQ(entries(folder_ / ""), before) << what;
    }
  }
}

/// Another process takes what is new for what a killed one left, and is about to remove it.
TEST_F(Faults, WhatAnotherProcessLocksAsItIsMadeIsLeftToIt) {
  make({kMakeMany});
  const std::string seen = seen_ / "seen";
  const auto run_locked = [&](const std::string& command, int number, int error) {
    const RunResult result = run_here(command, fault({"flock", error}, number, seen));
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    EXPECT_TRUE(fs::remove(seen)) << number;
    std::size_t left = 0;
    for (const std::string& name : entries(folder_ / "")) {
      if (!name.starts_with('.')) continue;
      ++left;
      EXPECT_TRUE(fs::is_empty(folder_ / name)) << name;
      fs::remove_all(folder_ / name);
    }
    return left;
  };
  EXPECT_EQ(run_locked("surfel-convert many.ply -o a.ply", 1, EWOULDBLOCK), 1U);
  EXPECT_EQ(run_locked("surfel-convert many.ply -o a.ply", 1, ENOLCK), 0U);
  if (find_program("ffmpeg").empty()) GTEST_SKIP() << "ffmpeg is not installed";
  // The first lock is that of the film's own file.
  const std::string film = "surfel-render many.ply --size 16 --turntable 2 -o a.mp4";
  EXPECT_EQ(run_locked(film, 2, EWOULDBLOCK), 1U);
  EXPECT_EQ(run_locked(film, 2, ENOLCK), 0U);
}

TEST_F(Faults, OfTwoWritersOfOneFileOneWins) {
  make({kMakeMany});
  const std::string path = folder_ / "out.ply";
  const std::vector<std::string> words = {"surfel-convert many.ply --scale 2 -o out.ply",
                                          "surfel-convert many.ply --scale 3 -o out.ply"};
  std::vector<std::string> right;
  for (const std::string& command : words) {
    ASSERT_EQ(run_here(command).exit_code, 0);
    right.push_back(read_text(path));
  }
  ASSERT_NE(right[0], right[1]);
  const auto before = entries(folder_ / "");
  for (int repeat = 0; repeat < 10; ++repeat) {
    RunResult second;
    std::thread other([&] { second = run_here(words[1]); });
    const RunResult first = run_here(words[0]);
    other.join();
    EXPECT_EQ(first.exit_code, 0) << first.errors;
    EXPECT_EQ(second.exit_code, 0) << second.errors;
    const std::string left = read_text(path);
    EXPECT_TRUE(left == right[0] || left == right[1]);
    EXPECT_EQ(entries(folder_ / ""), before);
  }
}

}  // namespace
}  // namespace surfel::test
