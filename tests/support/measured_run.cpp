#include <filesystem>
#include <fstream>
#include <sstream>

#include <fcntl.h>
#include <support/measured_run.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

namespace surfel::test {

MeasuredRun measured_run(const std::vector<std::string>& command, const std::string& folder,
                         const RunLimits& limits) {
  const std::string errors = folder + "/errors";
  const pid_t process = fork();
  if (process == 0) {
    const rlimit seconds{limits.seconds, limits.seconds};
    const rlimit bytes{limits.gigabytes << 30, limits.gigabytes << 30};
    setrlimit(RLIMIT_CPU, &seconds);
    if (limits.gigabytes > 0) setrlimit(RLIMIT_AS, &bytes);
    const int file = open(errors.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
    dup2(file, 2);
    dup2(open("/dev/null", O_WRONLY), 1);
    std::vector<char*> words;
    for (const std::string& word : command) words.push_back(const_cast<char*>(word.c_str()));
    words.push_back(nullptr);
    execv(words[0], words.data());
    _exit(127);
  }
  int status = 0;
  rusage usage{};
  wait4(process, &status, 0, &usage);
  MeasuredRun result;
  if (WIFEXITED(status)) result.exit_code = WEXITSTATUS(status);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  result.seconds = seconds(usage.ru_utime) + seconds(usage.ru_stime);
  result.megabytes = static_cast<double>(usage.ru_maxrss) / 1024;
  std::ifstream text(errors);
  std::getline(text, result.message);
  std::filesystem::remove(errors);
  return result;
}

std::vector<std::string> words_of(const std::string& text) {
  std::istringstream stream(text);
  std::vector<std::string> words;
  for (std::string word; stream >> word;) words.push_back(word);
  return words;
}

}  // namespace surfel::test
