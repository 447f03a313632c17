#include <algorithm>
#include <cstdint>
#include <tuple>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/disjoint_sets.h>
#include <surfel/base/random.h>
#include <surfel/estimate/surface_parts.h>

namespace surfel {
namespace {

constexpr std::uint32_t kParts = 700;

/// Edges between random parts, many of which have the same weight.
std::vector<PartJoin> random_joins(std::size_t count) {
  std::vector<PartJoin> joins;
  const auto random = [](std::uint64_t i, std::uint64_t d, double most) {
    return static_cast<std::uint32_t>(most * random_uniform(11, i, d));
  };
  for (std::uint64_t i = 0; joins.size() < count; ++i) {
    PartJoin join;
    join.point = random(i, 0, 5000);
    join.rank = static_cast<std::uint8_t>(random(i, 1, 64));
    join.weight = static_cast<float>(random(i, 2, 9)) / 100;
    // Edges that are equal in the order are one and the same.
    join.from = random(join.point, 3, kParts);
    join.to = random(join.point * 64 + join.rank, 4, kParts);
    join.opposed = random(join.point * 64 + join.rank, 5, 2) != 0;
    if (join.from != join.to) joins.push_back(join);
  }
  return joins;
}

using Ends = std::tuple<float, std::uint32_t, std::uint8_t, std::uint32_t, std::uint32_t, bool>;
Ends ends_of(const PartJoin& join) {
  return {join.weight, join.point, join.rank, join.from, join.to, join.opposed};
}

std::vector<Ends> forest_of(PartJoins& joins) {
  std::vector<Ends> out;
  for (const PartJoin& join : joins.forest()) out.push_back(ends_of(join));
  return out;
}

TEST(PartJoins, AreTheForestOfAllEdgesInAnyOrder) {
  std::vector<PartJoin> all = random_joins(30000);
  std::vector<Ends> sorted;
  for (const PartJoin& join : all) sorted.push_back(ends_of(join));
  std::sort(sorted.begin(), sorted.end());
  std::vector<Ends> expected;
  DisjointSets sets(kParts);
  for (const Ends& join : sorted) {
    if (sets.unite(std::get<3>(join), std::get<4>(join))) expected.push_back(join);
  }
  EXPECT_EQ(expected.size(), kParts - 1);

  PartJoins forward;
  for (const PartJoin& join : all) forward.add(join);
  EXPECT_EQ(forest_of(forward), expected);
  // Backwards, in pieces of which each is a forest of its own.
  std::reverse(all.begin(), all.end());
  PartJoins whole;
  for (std::size_t begin = 0; begin < all.size(); begin += 7000) {
    PartJoins piece;
    for (std::size_t i = begin; i < std::min(begin + 7000, all.size()); ++i) piece.add(all[i]);
    whole.add(piece);
  }
  EXPECT_EQ(forest_of(whole), expected);
}

}  // namespace
}  // namespace surfel
