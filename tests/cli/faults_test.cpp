// Calls of the system that fail, one after the other: a run says so and leaves the older output
// whole, or it ends well and the output is right.

#include <cerrno>
#include <cstring>

#include <gtest/gtest.h>

#include "support/run_tool.h"

namespace surfel::test {
namespace {

namespace fs = std::filesystem;

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool kSanitized = true;
#elif defined(__has_feature)
constexpr bool kSanitized = __has_feature(address_sanitizer) || __has_feature(thread_sanitizer) ||
                            __has_feature(memory_sanitizer);
#else
constexpr bool kSanitized = false;
#endif

struct Fault {
  const char* call;
  int error;  ///< errno; 0: the call does half of its work.
};

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
    const RunResult made =
        run({tool("surfel-generate"), "checker", "--size", "8x8", "-o", folder_ / "a.png"});
    ASSERT_EQ(made.exit_code, 0) << made.errors;
  }

  /// Runs the command in the folder, with the fault if there is one.
  RunResult run_here(const std::string& command, const std::string& environment = "") const {
    return run({"sh", "-c",
                "cd '" + (folder_ / "") + "' && env " + environment + " " +
                    (fs::path(SURFEL_TOOL_DIR) / command).string()});
  }

  /// Lets each call in turn fail until the run makes no more of them.
  void expect_sound(const std::string& command, const std::string& output, const Fault& fault) {
    const std::string path = folder_ / output;
    fs::remove(path);
    ASSERT_EQ(run_here(command).exit_code, 0) << command;
    const std::string right = read_text(path);
    const std::string seen = seen_ / "seen";
    constexpr int kMostCalls = 100;
    int number = 1;
    for (; number < kMostCalls; ++number) {
      write_text(path, "old");
      const auto before = entries(folder_ / "");
      const RunResult result = run_here(
          command, "LD_PRELOAD='" + std::string(SURFEL_FAULT_LIBRARY) +
                       "' FAULT_CALL=" + fault.call + " FAULT_NUMBER=" + std::to_string(number) +
                       " FAULT_ERROR=" + std::to_string(fault.error) + " FAULT_SEEN='" + seen +
                       "'");
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
      EXPECT_EQ(result.exit_code, 1) << what;
      EXPECT_EQ(read_text(path), "old") << what;
      EXPECT_TRUE(contains(result.errors, output) || contains(result.errors, "cloud.ply") ||
                  contains(result.errors, "mesh.obj") || contains(result.errors, "a.png"))
          << what;
    }
    EXPECT_LT(number, kMostCalls) << command;
    EXPECT_TRUE(number > 1 || std::string_view(fault.call).starts_with("p")) << command;
  }

 private:
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

}  // namespace
}  // namespace surfel::test
