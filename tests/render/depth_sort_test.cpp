#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <random>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/render/depth_sort.h>
#include <surfel/render/splat.h>

namespace surfel {
namespace {

/// Places of the sorted splats in the list that they came in.
std::vector<std::uint32_t> sorted(const std::vector<float>& depths, DepthOrder how) {
  std::vector<float> padded = depths;
  padded.resize(depths.size() + kTileSize, std::numeric_limits<float>::quiet_NaN());
  std::vector<std::uint32_t> splats(depths.size());
  // Numbers that are not their places, as a tile's splats are strewn over its block.
  for (std::size_t i = 0; i < splats.size(); ++i) splats[i] = static_cast<std::uint32_t>(1000 + i);
  DepthSortScratch scratch;
  std::vector<std::uint32_t> order(depths.size());
  sort_front_to_back(padded.data(), splats.data(), splats.size(), how, scratch, order.data());
  for (std::uint32_t& splat : order) splat -= 1000;
  return order;
}

std::vector<float> random_depths(std::size_t count, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> depth(-3, 5);
  std::vector<float> depths(count);
  for (float& d : depths) d = depth(random);
  return depths;
}

class DepthSort : public testing::TestWithParam<std::size_t> {};

TEST_P(DepthSort, FineOrderIsThatOfAStableSort) {
  // On a grid of 2^22 steps: depths that differ are told apart, those that agree are not.
  std::vector<float> depths = random_depths(GetParam(), 3);
  for (float& d : depths) d = std::round(d * 64) / 64;
  std::vector<std::uint32_t> expected(depths.size());
  std::iota(expected.begin(), expected.end(), 0U);
  std::stable_sort(expected.begin(), expected.end(),
                   [&](std::uint32_t a, std::uint32_t b) { return depths[a] > depths[b]; });
  EXPECT_EQ(sorted(depths, DepthOrder::kFine), expected);
}

TEST_P(DepthSort, CoarseOrderIsOffByAStepAtMost) {
  const std::vector<float> depths = random_depths(GetParam(), 5);
  const std::vector<std::uint32_t> order = sorted(depths, DepthOrder::kCoarse);
  std::vector<std::uint32_t> all = order;
  std::sort(all.begin(), all.end());
  for (std::size_t i = 0; i < all.size(); ++i) ASSERT_EQ(all[i], i);
  const float step = 8.0F / 511;
  for (std::size_t i = 1; i < order.size(); ++i) {
    EXPECT_LE(depths[order[i]], depths[order[i - 1]] + step) << i;
  }
}

INSTANTIATE_TEST_SUITE_P(Counts, DepthSort, testing::Values(0, 1, 2, 15, 16, 17, 700, 5000));

TEST(DepthSortTies, EqualDepthsStayInOrder) {
  for (const DepthOrder how : {DepthOrder::kCoarse, DepthOrder::kFine}) {
    const std::vector<std::uint32_t> order = sorted(std::vector<float>(40, 0.25F), how);
    EXPECT_TRUE(std::is_sorted(order.begin(), order.end()));
  }
}

TEST(DepthSortTies, DepthsThatNearlyAgreeAreSortedSomehow) {
  std::vector<float> depths(40, 0.0F);
  for (std::size_t i = 0; i < depths.size(); i += 3) depths[i] = 1e-42F;
  for (const DepthOrder how : {DepthOrder::kCoarse, DepthOrder::kFine}) {
    std::vector<std::uint32_t> order = sorted(depths, how);
    std::sort(order.begin(), order.end());
    for (std::size_t i = 0; i < order.size(); ++i) EXPECT_EQ(order[i], i);
  }
}

}  // namespace
}  // namespace surfel
