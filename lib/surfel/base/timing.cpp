#include <surfel/base/timing.h>

namespace surfel {

void StageTimes::add(const std::string& stage, double milliseconds) {
  for (auto& [name, time] : stages_) {
    if (name == stage) {
      time += milliseconds;
      return;
    }
  }
  stages_.emplace_back(stage, milliseconds);
}

}  // namespace surfel
