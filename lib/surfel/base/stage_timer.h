#pragma once

#include <string>

#include <surfel/base/timing.h>

namespace surfel {

/// Stopwatch of successive stages: each lasts from the end of the one before, the first from the
/// stopwatch's making.
class StageTimer {
 public:
  /// \param times  where the stages' times are added; outlives the stopwatch.
  explicit StageTimer(StageTimes& times) : times_(times) {}

  /// Ends a stage.
  void end(const std::string& stage) {
    times_.add(stage, timer_.milliseconds());
    timer_.restart();
  }

 private:
  StageTimes& times_;
  Timer timer_;
};

}  // namespace surfel
