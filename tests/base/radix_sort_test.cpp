#include <algorithm>
#include <numeric>

#include <gtest/gtest.h>
#include <surfel/base/parallel.h>
#include <surfel/base/radix_sort.h>
#include <surfel/base/random.h>

namespace surfel {
namespace {

std::vector<std::uint32_t> stable_order(const Array<std::uint64_t>& keys) {
  std::vector<std::uint32_t> order(keys.size());
  std::iota(order.begin(), order.end(), 0U);
  std::stable_sort(order.begin(), order.end(),
                   [&](std::uint32_t a, std::uint32_t b) { return keys[a] < keys[b]; });
  return order;
}

void expect_sorted(const Array<std::uint64_t>& keys) {
  for (const int threads : {1, 2, 5}) {
    set_thread_count(threads);
    Array<std::uint64_t> sorted = keys;
    const Array<std::uint32_t> order = sort_keys(sorted);
    ASSERT_EQ(std::vector<std::uint32_t>(order.begin(), order.end()), stable_order(keys));
    for (std::size_t i = 0; i < keys.size(); ++i) ASSERT_EQ(sorted[i], keys[order[i]]) << i;
  }
  set_thread_count(0);
}

Array<std::uint64_t> random_keys(std::size_t count, std::uint64_t mask) {
  Array<std::uint64_t> keys(count);
  for (std::size_t i = 0; i < count; ++i) keys[i] = random_bits(count, i) & mask;
  return keys;
}

TEST(RadixSort, OrdersLikeAStableSort) {
  // Below, at and past the size of a block; 200000 has several blocks.
  for (const std::size_t count : {0, 1, 2, 3, 1000, 16383, 16384, 16385, 200000}) {
    expect_sorted(random_keys(count, ~std::uint64_t{0}));
  }
}

TEST(RadixSort, KeepsTheOrderOfEqualKeys) {
  for (const std::uint64_t mask :
       {0ULL, 1ULL, 0x3ULL << 62, 0x8000000000000001ULL, 0x7ffULL << 5}) {
    expect_sorted(random_keys(50000, mask));
  }
}

TEST(RadixSort, DividesWhatIsNearlyAllInOneBucket) {
  Array<std::uint64_t> keys = random_keys(600000, 0xffffff);
  keys[300000] = ~std::uint64_t{0};
  expect_sorted(keys);
}

TEST(RadixSort, OrdersSortedAndReversedKeys) {
  Array<std::uint64_t> keys(70000);
  for (std::size_t i = 0; i < keys.size(); ++i) keys[i] = i << 20;
  expect_sorted(keys);
  std::reverse(keys.begin(), keys.end());
  expect_sorted(keys);
}

TEST(RadixSort, SeesADifferenceInEveryBit) {
  for (int bit = 0; bit < 64; ++bit) {
    Array<std::uint64_t> keys = {std::uint64_t{1} << bit, 0};
    const Array<std::uint32_t> order = sort_keys(keys);
    EXPECT_EQ(order[0], 1U) << bit;
    EXPECT_EQ(order[1], 0U) << bit;
  }
}

}  // namespace
}  // namespace surfel
