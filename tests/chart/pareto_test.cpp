#include <random>

#include <gtest/gtest.h>
#include <surfel/chart/pareto.h>

namespace surfel {
namespace {

/// Points on a coarse grid, so that there are ties.
std::vector<CostPoint> random_points(std::size_t count, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_int_distribution<int> value(1, 12);
  std::vector<CostPoint> points(count);
  for (CostPoint& p : points) p = {0.5 * value(random), 0.25 * value(random)};
  return points;
}

bool dominates(const CostPoint& a, const CostPoint& b) {
  return a.time <= b.time && a.error <= b.error && (a.time < b.time || a.error < b.error);
}

TEST(ParetoFront, IsWhatNoOtherPointDominates) {
  for (unsigned seed = 0; seed < 40; ++seed) {
    const auto points = random_points(1 + seed, seed);
    const std::vector<bool> front = pareto_front(points);
    for (std::size_t i = 0; i < points.size(); ++i) {
      bool dominated = false;
      for (const CostPoint& other : points) dominated = dominated || dominates(other, points[i]);
      EXPECT_EQ(front[i], !dominated) << "seed " << seed << " point " << i;
    }
  }
}

TEST(ParetoFront, HasEqualPointsTogether) {
  EXPECT_EQ(pareto_front({{1, 2}, {1, 2}, {2, 2}}), (std::vector<bool>{true, true, false}));
  EXPECT_TRUE(pareto_front({}).empty());
}

TEST(FrontDistance, IsWhatTheBestOthersSave) {
  for (unsigned seed = 0; seed < 40; ++seed) {
    const auto points = random_points(20, seed);
    for (std::size_t i = 0; i < points.size(); ++i) {
      double time = points[i].time;
      double error = points[i].error;
      for (const CostPoint& p : points) {
        if (p.error <= points[i].error) time = std::min(time, p.time);
        if (p.time <= points[i].time) error = std::min(error, p.error);
      }
      const FrontDistance d = front_distance(points, i);
      EXPECT_EQ(d.time, points[i].time / time);
      EXPECT_EQ(d.error, points[i].error / error);
      EXPECT_EQ(points[d.faster].time, time);
      EXPECT_EQ(points[d.sharper].error, error);
    }
  }
}

TEST(FrontDistance, IsOneOnTheFront) {
  const std::vector<CostPoint> points = {{1, 3}, {2, 2}, {3, 1}, {3, 3}};
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(front_distance(points, i).time, 1);
    EXPECT_EQ(front_distance(points, i).error, 1);
  }
  EXPECT_EQ(front_distance(points, 3).time, 3);
  EXPECT_EQ(front_distance(points, 3).error, 3);
  EXPECT_THROW(front_distance(points, 4), std::out_of_range);
}

}  // namespace
}  // namespace surfel
