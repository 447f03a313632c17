#include <cmath>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/chart/chart_judge.h>

namespace surfel {
namespace {

ChartPoint point(double time, double psnr, bool standard = false) {
  ChartPoint p;
  p.label = "setting " + std::to_string(time);
  p.standard = standard;
  p.time = p.render = {time, 0.95 * time, 1.05 * time};
  p.error.psnr = psnr;
  p.error.rmse = std::pow(10, -psnr / 20);
  return p;
}

ChartSweep judged(std::vector<ChartPoint> points) {
  ChartSweep sweep;
  sweep.points = std::move(points);
  judge(sweep);
  return sweep;
}

TEST(Judge, FindsADefaultOnTheFront) {
  const ChartSweep sweep = judged({point(10, 40, true), point(20, 45), point(5, 30)});
  EXPECT_FALSE(sweep.standard_off);
  for (const ChartPoint& p : sweep.points) EXPECT_TRUE(p.front);
  EXPECT_NE(sweep.verdict.find("on the Pareto front"), std::string::npos);
}

TEST(Judge, FindsADefaultThatIsSlow) {
  const ChartSweep sweep = judged({point(15, 40, true), point(10, 40.1)});
  EXPECT_TRUE(sweep.standard_off);
  EXPECT_FALSE(sweep.points[0].front);
  EXPECT_NE(sweep.verdict.find("1.50 times as fast"), std::string::npos) << sweep.verdict;
  EXPECT_FALSE(judged({point(11.5, 40, true), point(10, 40.1)}).standard_off);
}

TEST(Judge, FindsADefaultThatIsCoarse) {
  // 6.02 dB: half the error in less time.
  const ChartSweep sweep = judged({point(10, 40, true), point(8.5, 46.0206)});
  EXPECT_TRUE(sweep.standard_off);
  EXPECT_NE(sweep.verdict.find("2.00 times smaller"), std::string::npos) << sweep.verdict;
  // 1 dB is 12 %.
  EXPECT_FALSE(judged({point(10, 40, true), point(8.5, 41)}).standard_off);
}

TEST(Judge, DoesNotTrustTimesThatSpreadFurtherThanTheyDiffer) {
  std::vector<ChartPoint> points{point(15, 40, true), point(10, 40)};
  points[1].time.most = 14.5;
  const ChartSweep sweep = judged(points);
  EXPECT_FALSE(sweep.standard_off);
  EXPECT_NE(sweep.verdict.find("spread"), std::string::npos) << sweep.verdict;
}

TEST(Judge, TakesErrorsOfRoundingForEqual) {
  // Both are nearer than 8 bits can tell: the faster one alone is on the front.
  const ChartSweep sweep = judged({point(10, 80, true), point(9.5, 70)});
  EXPECT_FALSE(sweep.points[0].front);
  EXPECT_TRUE(sweep.points[1].front);
}

TEST(Judge, LeavesOutWhatWasRefused) {
  ChartPoint refused;
  refused.refused = "not so";
  const ChartSweep sweep = judged({point(10, 40, true), refused});
  EXPECT_TRUE(sweep.points[0].front);
  EXPECT_FALSE(sweep.points[1].front);
}

TEST(RecommendationOrder, CheapestFirstForAnError) {
  const std::vector<ChartPoint> points = {point(10, 40), point(30, 50), point(20, 45),
                                          point(5, 30)};
  EXPECT_EQ(recommendation_order(points, {.min_psnr = 40, .max_time = {}}),
            (std::vector<std::size_t>{0, 2, 1}));
  EXPECT_EQ(recommendation_order(points, {.min_psnr = 40.1, .max_time = {}}),
            (std::vector<std::size_t>{2, 1}));
  EXPECT_TRUE(recommendation_order(points, {.min_psnr = 51, .max_time = {}}).empty());
}

TEST(RecommendationOrder, MostAccurateFirstForATimeWithAMargin) {
  const std::vector<ChartPoint> points = {point(10, 40), point(29, 50), point(20, 45),
                                          point(5, 45)};
  // 29 ms leave less than the margin to 30; of equal accuracy the faster comes first.
  EXPECT_EQ(recommendation_order(points, {.min_psnr = {}, .max_time = 30}),
            (std::vector<std::size_t>{3, 2, 0}));
  EXPECT_TRUE(recommendation_order(points, {.min_psnr = {}, .max_time = 5.5}).empty());
}

TEST(RecommendationOrder, LeavesOutWhatWasRefused) {
  std::vector<ChartPoint> points = {point(10, 40), point(20, 40)};
  points[0].refused = "not so";
  EXPECT_EQ(recommendation_order(points, {.min_psnr = 30, .max_time = {}}),
            (std::vector<std::size_t>{1}));
}

TEST(ChartGoal, IsOneOfTheTwoWithAUsableValue) {
  const auto goal = [](std::optional<double> psnr, std::optional<double> time) {
    return ChartGoal{.min_psnr = psnr, .max_time = time};
  };
  EXPECT_TRUE(goal(40, {}).problems().empty());
  EXPECT_TRUE(goal({}, 5).problems().empty());
  for (const ChartGoal& bad :
       {goal({}, {}), goal(40, 5), goal(std::nan(""), {}), goal({}, 0), goal({}, std::nan(""))}) {
    EXPECT_EQ(bad.problems().size(), 1U);
    EXPECT_THROW(recommendation_order({}, bad), Error);
  }
}

}  // namespace
}  // namespace surfel
