#include <gtest/gtest.h>
#include <surfel/base/memory.h>
#include <surfel/base/timing.h>

namespace surfel {
namespace {

TEST(StageTimes, AddsUpByNameInTheOrderOfFirstUse) {
  StageTimes times;
  times.add("load", 1);
  times.add("sort", 2);
  times.add("load", 4);
  const std::vector<std::pair<std::string, double>> expected = {{"load", 5}, {"sort", 2}};
  EXPECT_EQ(times.stages(), expected);
}

TEST(Timer, NeverRunsBackwards) {
  Timer timer;
  const double first = timer.milliseconds();
  EXPECT_GE(first, 0);
  EXPECT_GE(timer.milliseconds(), first);
}

TEST(Memory, PeakFollowsWhatIsTouched) {
  const std::uint64_t before = peak_memory_bytes();
  constexpr std::size_t kBytes = std::size_t{64} << 20;
  const std::vector<char> touched(kBytes, 1);
  const volatile char* const seen = touched.data();  // Else a compiler may leave the memory out.
  EXPECT_EQ(seen[kBytes - 1], 1);
  EXPECT_GE(peak_memory_bytes(), kBytes);
  EXPECT_GE(peak_memory_bytes(), before);
  EXPECT_GT(available_memory_bytes(), 0U);
}

}  // namespace
}  // namespace surfel
