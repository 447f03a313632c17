#pragma once

#include <algorithm>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <functional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include "support/test_data.h"

extern char** environ;

namespace surfel::test {

using Words = std::vector<std::string>;

inline bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

inline std::string read_text(const std::string& path) {
  std::ostringstream text;
  text << std::ifstream(path, std::ios::binary).rdbuf();
  return text.str();
}

inline void write_text(const std::string& path, const std::string& text) {
  std::ofstream(path, std::ios::binary) << text;
}

/// Names in a folder, hidden ones too.
inline std::vector<std::string> entries(const std::string& folder) {
  std::vector<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    names.push_back(entry.path().filename());
  }
  std::sort(names.begin(), names.end());
  return names;
}

/// Path of one of the project's tools.
inline std::string tool(const std::string& name) {
  return (std::filesystem::path(SURFEL_TOOL_DIR) / name).string();
}

/// Waits until the state holds; for two minutes at most, after which the test that asked fails by
/// what it finds.
template <class State>
void wait_until(const State& state) {
  const auto start = std::chrono::steady_clock::now();
  while (!state() && std::chrono::steady_clock::now() - start < std::chrono::minutes(2)) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

struct RunResult {
  int exit_code = -1;  ///< -1 where a signal ended the process.
  int signal = 0;
  std::string output;
  std::string errors;
};

struct RunSetup {
  std::string input = {};                     ///< File for standard input.
  std::function<void(pid_t)> meanwhile = {};  ///< Called once while the process runs.
  std::chrono::seconds longest{120};          ///< The process is killed after it.
};

/// Runs a program and waits for it; what does not end in time is killed, and shows as ended by a
/// signal.
inline RunResult run(const std::vector<std::string>& command, const RunSetup& setup = {}) {
  const TemporaryFolder folder;
  const std::string out = folder / "out";
  const std::string err = folder / "err";
  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  const std::string in = setup.input.empty() ? "/dev/null" : setup.input;
  constexpr int kCreate = O_WRONLY | O_CREAT | O_TRUNC;
  posix_spawn_file_actions_addopen(&files, 0, in.c_str(), O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&files, 1, out.c_str(), kCreate, 0600);
  posix_spawn_file_actions_addopen(&files, 2, err.c_str(), kCreate, 0600);
  std::vector<char*> argv;
  for (const std::string& word : command) argv.push_back(const_cast<char*>(word.c_str()));
  argv.push_back(nullptr);
  pid_t process = 0;
  const int failed = posix_spawnp(&process, argv[0], &files, nullptr, argv.data(), environ);
  posix_spawn_file_actions_destroy(&files);
  if (failed != 0) throw std::runtime_error("cannot run " + command[0]);

  if (setup.meanwhile) setup.meanwhile(process);
  const auto start = std::chrono::steady_clock::now();
  int status = 0;
  while (waitpid(process, &status, WNOHANG) == 0) {
    if (std::chrono::steady_clock::now() - start > setup.longest) kill(process, SIGKILL);
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  RunResult result;
  if (WIFEXITED(status)) result.exit_code = WEXITSTATUS(status);
  if (WIFSIGNALED(status)) result.signal = WTERMSIG(status);
  result.output = read_text(out);
  result.errors = read_text(err);
  return result;
}

}  // namespace surfel::test
