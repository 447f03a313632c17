#include <gtest/gtest.h>
#include <surfel/base/random.h>
#include <surfel/solve/column_map.h>

namespace surfel {
namespace {

TEST(ColumnMap, NumbersColumnsInTheOrderInWhichTheyCome) {
  ColumnMap map;
  // Two rows' worth: some that share a slot, some that follow each other, one twice.
  for (int row = 0; row < 2; ++row) {
    const std::vector<std::uint32_t> columns{7, 263, 519, 8, 9, 4000000000U, 0};
    for (std::uint32_t i = 0; i < columns.size(); ++i) {
      EXPECT_EQ(map.find(columns[i]), ColumnMap::kAbsent);
      EXPECT_EQ(map.number(columns[i]), i);
      EXPECT_EQ(map.number(columns[i / 2]), i / 2);
    }
    EXPECT_EQ(map.columns(), columns);
    EXPECT_EQ(map.find(775), ColumnMap::kAbsent);
    map.clear();
    EXPECT_EQ(map.size(), 0U);
    for (const std::uint32_t c : columns) EXPECT_EQ(map.find(c), ColumnMap::kAbsent);
  }
}

TEST(ColumnMap, GrowsWithTheColumnsItHolds) {
  ColumnMap map;
  std::vector<std::uint32_t> columns;
  for (std::uint32_t i = 0; i < 3000; ++i) {
    columns.push_back(static_cast<std::uint32_t>(4e9 * random_uniform(1, i, 0)));
    map.number(columns.back());
  }
  for (const std::uint32_t c : columns) EXPECT_EQ(map.columns()[map.find(c)], c);
}

TEST(ColumnMap, MemoryDoesNotFollowTheColumnsValues) {
  const auto bytes = [](std::uint32_t step) {
    ColumnMap map;
    for (std::uint32_t row = 0; row < 1000; ++row) {
      map.clear();
      for (std::uint32_t i = 0; i < 50; ++i) map.number(row * step + i);
    }
    return map.bytes();
  };
  EXPECT_EQ(bytes(1000000), bytes(1));
}

}  // namespace
}  // namespace surfel
