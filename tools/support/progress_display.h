#pragma once

#include <condition_variable>
#include <cstddef>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include <surfel/base/progress.h>
#include <surfel/base/timing.h>

namespace surfel::tool {

/// How a tool shows its progress.
enum class ProgressStyle {
  kNone,
  kLine,  ///< One line of a terminal, rewritten ten times a second from the first second on.
  kJson   ///< A JSON object a line: at the begin and the end of a stage, and between them ten times
          ///< a second at most.
};

/// "4.2 M" of 4200000.
std::string scaled_count(double count);

/// Shows on standard error how far the work is: a line has the name of the outermost stage and what
/// the outermost counts that counts, JSON tells of all stages and goes on with the innermost.
/// Messages are written under lock(), which takes the line away first.
class ProgressDisplay : public ProgressObserver {
 public:
  ProgressDisplay() = default;
  ~ProgressDisplay() override;
  ProgressDisplay(const ProgressDisplay&) = delete;
  ProgressDisplay& operator=(const ProgressDisplay&) = delete;

  void start(ProgressStyle style);
  /// Takes the line away, and shows no more.
  void stop() noexcept;
  /// Takes the line away and keeps standard error for the caller.
  std::unique_lock<std::mutex> lock();

  void begin(const ProgressStage& stage) override;
  void end(const ProgressStage& stage) noexcept override;

 private:
  struct Running {
    const ProgressStage* stage;
    Timer timer;
  };
  void run();
  void erase();
  void show_line();
  static void show_json(const Running& running, const char* event);

  std::mutex mutex_;
  std::condition_variable wake_;
  std::thread thread_;
  bool stopping_ = false;
  ProgressStyle style_ = ProgressStyle::kNone;
  Timer since_start_;
  std::size_t width_ = 0;  ///< Columns that the line takes now.
  std::vector<Running> running_;
};

}  // namespace surfel::tool
