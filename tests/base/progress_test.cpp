#include <cstdint>
#include <mutex>
#include <stdexcept>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/parallel.h>
#include <surfel/base/progress.h>

namespace surfel::test {
namespace {

/// Writes down what it is told.
class Recorder : public ProgressObserver {
 public:
  Recorder() { set_progress_observer(this); }
  ~Recorder() override { set_progress_observer(nullptr); }
  void begin(const ProgressStage& stage) override { note("begin", stage); }
  void end(const ProgressStage& stage) noexcept override { note("end", stage); }
  std::vector<std::string> said;

 private:
  void note(const char* event, const ProgressStage& stage) {
    const std::lock_guard guard(mutex_);
    said.push_back(std::string(event) + ' ' + stage.name() + ' ' + std::to_string(stage.done()) +
                   " of " + std::to_string(stage.total()) + ' ' + stage.unit());
  }
  std::mutex mutex_;
};

TEST(Progress, StagesCountOnAllThreadsAndLieWithinOneAnother) {
  Recorder recorder;
  {
    ProgressStage outer("outer", 10, "files");
    outer.set_share(0.5);
    ProgressStage stage("inner", 100000, "points");
    parallel_for(100000, 64,
                 [&](std::size_t begin, std::size_t end, int) { stage.add(end - begin); });
  }
  EXPECT_EQ(recorder.said, (std::vector<std::string>{
                               "begin outer 0 of 10 files", "begin inner 0 of 100000 points",
                               "end inner 100000 of 100000 points", "end outer 5 of 10 files"}));
}

TEST(Progress, AStageEndsWithAnExceptionAndSharesStayInTheirRange) {
  Recorder recorder;
  EXPECT_THROW(
      {
        ProgressStage stage("work", 8, "B");
        stage.set_share(7);
        throw std::runtime_error("");
      },
      std::runtime_error);
  EXPECT_EQ(recorder.said.back(), "end work 8 of 8 B");
}

TEST(Progress, NobodyNeedsToListen) {
  ProgressStage stage("work", 2, "points");
  stage.add(1);
  EXPECT_EQ(stage.done(), 1U);
}

}  // namespace
}  // namespace surfel::test
