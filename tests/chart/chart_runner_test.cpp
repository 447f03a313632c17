#include <gtest/gtest.h>
#include <surfel/chart/chart_runner.h>

namespace surfel {
namespace {

TEST(ChartOptions, DefaultsAreValidAndBadValuesAreNot) {
  EXPECT_TRUE(ChartOptions{}.problems().empty());
  const auto problems = [](auto change) {
    ChartOptions options;
    change(options);
    return options.problems().size();
  };
  EXPECT_EQ(problems([](ChartOptions& o) { o.count = 0; }), 1U);
  EXPECT_EQ(problems([](ChartOptions& o) { o.repeats = 0; }), 1U);
  EXPECT_EQ(problems([](ChartOptions& o) { o.frames = 1; }), 1U);
  EXPECT_EQ(problems([](ChartOptions& o) { o.frames = 0; }), 0U);
  EXPECT_EQ(problems([](ChartOptions& o) { o.samples = 65; }), 1U);
  EXPECT_EQ(problems([](ChartOptions& o) { o.camera.fov = 180; }), 1U);
}

}  // namespace
}  // namespace surfel
