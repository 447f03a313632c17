#pragma once

#include <chrono>
#include <string>
#include <utility>
#include <vector>

#include <surfel/base/export.h>

namespace surfel {

/// Wall-clock stopwatch, started when made.
class Timer {
 public:
  double milliseconds() const {
    return std::chrono::duration<double, std::milli>(Clock::now() - start_).count();
  }
  void restart() { start_ = Clock::now(); }

 private:
  using Clock = std::chrono::steady_clock;
  Clock::time_point start_ = Clock::now();
};

/// Named wall-clock times in milliseconds, in the order in which they were first added.
class SURFEL_API StageTimes {
 public:
  /// Adds to the stage of that name.
  void add(const std::string& stage, double milliseconds);
  const std::vector<std::pair<std::string, double>>& stages() const { return stages_; }

 private:
  std::vector<std::pair<std::string, double>> stages_;
};

}  // namespace surfel
