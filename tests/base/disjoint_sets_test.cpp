#include <gtest/gtest.h>
#include <surfel/base/disjoint_sets.h>

namespace surfel {
namespace {

TEST(DisjointSets, RootIsTheSmallestInWhateverOrderSetsAreUnited) {
  DisjointSets sets(7);
  sets.unite(6, 5);
  sets.unite(3, 5);
  sets.unite(6, 4);
  sets.unite(1, 2);
  for (const std::uint32_t i : {3U, 4U, 5U, 6U}) EXPECT_EQ(sets.root(i), 3U);
  for (const std::uint32_t i : {1U, 2U}) EXPECT_EQ(sets.root(i), 1U);
  EXPECT_EQ(sets.root(0), 0U);
}

}  // namespace
}  // namespace surfel
