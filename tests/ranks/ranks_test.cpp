#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numeric>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/ranks/ranks.h>

namespace surfel::test {
namespace {

/// Rows follow one another, and rank 0 has some.
void expect_whole(const std::vector<RowRange>& rows, int height) {
  EXPECT_GT(rows.front().end, 0);
  int next = 0;
  for (const RowRange& range : rows) {
    EXPECT_EQ(range.begin, next);
    EXPECT_GE(range.end, range.begin);
    next = range.end;
  }
  EXPECT_EQ(next, height);
}

TEST(RowBalance, RowsMakeUpThePicture) {
  for (const int ranks : {1, 2, 3, 8, 100}) {
    for (const int height : {1, 16, 17, 100, 1080, 65536}) {
      expect_whole(RowBalance(ranks).rows(height), height);
    }
  }
}

/// The cost of a row is a bump in the upper half of the picture.
double cost_of(const RowRange& rows, int height) {
  double sum = 0;
  for (int y = rows.begin; y < rows.end; ++y) {
    const double z = (y - 0.3 * height) / (0.1 * height);
    sum += 0.05 + std::exp(-z * z / 2);
  }
  return sum;
}

TEST(RowBalance, TimesBecomeAlikeWithinAFewPictures) {
  constexpr int kHeight = 2160;
  constexpr int kRanks = 8;
  RowBalance balance(kRanks);
  double busiest = 0;
  for (int picture = 0; picture < 6; ++picture) {
    const std::vector<RowRange> rows = balance.rows(kHeight);
    expect_whole(rows, kHeight);
    std::vector<double> times;
    for (const RowRange& range : rows) times.push_back(cost_of(range, kHeight));
    const double mean = std::accumulate(times.begin(), times.end(), 0.0) / kRanks;
    busiest = *std::max_element(times.begin(), times.end()) / mean;
    if (picture == 0) {
      EXPECT_GT(busiest, 2);
    }
    balance.learn(rows, times);
  }
  EXPECT_LT(busiest, 1.25);  // A row of tiles is a sixteenth of a rank's rows.
}

TEST(RowBalance, ASlowRankGetsFewerRows) {
  RowBalance balance(2);
  for (int picture = 0; picture < 8; ++picture) {
    const std::vector<RowRange> rows = balance.rows(1024);
    const std::vector<double> times{1.0 * (rows[0].end - rows[0].begin),
                                    3.0 * (rows[1].end - rows[1].begin)};
    balance.learn(rows, times);
  }
  EXPECT_NEAR(balance.rows(1024)[0].end, 768, 16);
}

TEST(RowBalance, TimesOfNothingChangeNothing) {
  RowBalance balance(4);
  const std::vector<RowRange> rows = balance.rows(512);
  balance.learn(rows, std::vector<double>{0, 0, 0, 0});
  for (std::size_t i = 0; i < rows.size(); ++i) {
    EXPECT_EQ(balance.rows(512)[i].begin, rows[i].begin);
  }
  balance.learn(rows, std::vector<double>{0, 0, 0, 5});
  expect_whole(balance.rows(512), 512);
}

TEST(Ranks, AreToldByTheEnvironment) {
  EXPECT_EQ(started_rank().count, 1);
  setenv("OMPI_COMM_WORLD_RANK", "3", 1);
  EXPECT_EQ(started_rank().count, 1);
  setenv("OMPI_COMM_WORLD_SIZE", "8", 1);
  EXPECT_EQ(started_rank().rank, 3);
  EXPECT_EQ(started_rank().count, 8);
  for (const char* wrong : {"", "x", "2", "-1"}) {
    setenv("OMPI_COMM_WORLD_SIZE", wrong, 1);
    EXPECT_EQ(started_rank().count, 1) << wrong;
  }
  unsetenv("OMPI_COMM_WORLD_RANK");
  unsetenv("OMPI_COMM_WORLD_SIZE");
  EXPECT_FALSE(Ranks::join());
}

}  // namespace
}  // namespace surfel::test
