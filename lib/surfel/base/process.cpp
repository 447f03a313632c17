#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <sstream>
#include <thread>

#include <fcntl.h>
#include <fmt/format.h>
#include <spawn.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/base/process.h>
#include <sys/wait.h>
#include <unistd.h>

namespace surfel {
namespace {

struct CloseFile {
  void operator()(std::FILE* file) const { std::fclose(file); }
};
using File = std::unique_ptr<std::FILE, CloseFile>;

std::string read_all(std::FILE* file) {
  std::rewind(file);
  std::string text;
  char buffer[4096];
  for (std::size_t n = 0; (n = std::fread(buffer, 1, sizeof buffer, file)) > 0;) {
    text.append(buffer, n);
  }
  return text;
}

/// Files that a process has open when it starts.
class FileActions {
 public:
  FileActions(const std::string& folder, int errors) {
    posix_spawn_file_actions_init(&actions_);
    posix_spawn_file_actions_addchdir_np(&actions_, folder.c_str());
    posix_spawn_file_actions_addopen(&actions_, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_addopen(&actions_, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
    posix_spawn_file_actions_adddup2(&actions_, errors, STDERR_FILENO);
  }
  ~FileActions() { posix_spawn_file_actions_destroy(&actions_); }
  FileActions(const FileActions&) = delete;
  FileActions& operator=(const FileActions&) = delete;
  const posix_spawn_file_actions_t* get() const { return &actions_; }

 private:
  posix_spawn_file_actions_t actions_;
};

/// The status that a process ended with. It is polled: the tools' signal handlers let waitpid() go
/// on, so that a wait that blocks would not see an interrupt.
int wait_for(pid_t process) {
  constexpr auto kPoll = std::chrono::milliseconds(2);  ///< Tools measure their own times.
  int status = 0;
  bool asked_to_end = false;
  while (waitpid(process, &status, WNOHANG) == 0) {
    if (interrupt_requested() && !asked_to_end) {
      kill(process, SIGTERM);
      asked_to_end = true;
    }
    std::this_thread::sleep_for(kPoll);
  }
  if (interrupt_requested()) throw Error(ErrorKind::kInterrupted, "interrupted");
  return status;
}

}  // namespace

ProcessResult run_process(const std::vector<std::string>& words, const std::string& folder) {
  const File errors(std::tmpfile());
  if (!errors) throw_io("", std::string("no temporary file: ") + std::strerror(errno));
  const FileActions actions(folder, fileno(errors.get()));
  std::vector<char*> argv;
  for (const std::string& word : words) argv.push_back(const_cast<char*>(word.c_str()));
  argv.push_back(nullptr);
  pid_t process = 0;
  const int failed = posix_spawnp(&process, argv[0], actions.get(), nullptr, argv.data(), environ);
  if (failed != 0) throw_io(words[0], std::string("cannot be run: ") + std::strerror(failed));
  const int status = wait_for(process);
  ProcessResult result;
  if (WIFEXITED(status)) result.exit_code = WEXITSTATUS(status);
  result.errors = read_all(errors.get());
  return result;
}

std::string find_program(const std::string& name) {
  const char* path = std::getenv("PATH");
  std::istringstream folders(path ? path : "/usr/bin:/bin");
  for (std::string folder; std::getline(folders, folder, ':');) {
    const std::string file = (folder.empty() ? "." : folder) + "/" + name;
    if (access(file.c_str(), X_OK) == 0) return file;
  }
  return "";
}

}  // namespace surfel
