#pragma once

// Tests of processes that mpirun starts together.

#include <cstdlib>
#include <initializer_list>
#include <string>

#include <gtest/gtest.h>
#include <surfel/base/process.h>

#include "support/run_tool.h"

namespace surfel::test {

class MpiTest : public testing::Test {
 protected:
  void SetUp() override {
    if (find_program("mpirun").empty()) {
      ASSERT_EQ(std::getenv("CI"), nullptr) << "mpirun is not installed";
      GTEST_SKIP() << "mpirun is not installed";
    }
  }
  /// The words before each process's command.
  static Words mpirun() {
    return {"env", "OMPI_ALLOW_RUN_AS_ROOT=1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1",
            "OMPI_MCA_rmaps_base_oversubscribe=1", "mpirun"};
  }
  static RunResult run_ranks(int ranks, const Words& command) {
    Words words = mpirun();
    words.insert(words.end(), {"-n", std::to_string(ranks)});
    words.insert(words.end(), command.begin(), command.end());
    return run(words);
  }
  /// Runs a command by processes of other instruction sets each.
  static RunResult run_mixed(std::initializer_list<const char*> instructions,
                             const Words& command) {
    Words words = mpirun();
    for (const char* set : instructions) {
      words.insert(words.end(), {"-n", "1", "-x", std::string("SURFEL_INSTRUCTIONS=") + set});
      words.insert(words.end(), command.begin(), command.end());
      words.emplace_back(":");
    }
    words.pop_back();
    return run(words);
  }
};

}  // namespace surfel::test
