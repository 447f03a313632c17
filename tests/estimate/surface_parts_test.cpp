#include <algorithm>
#include <cstdint>
#include <string>
#include <tuple>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/disjoint_sets.h>
#include <surfel/base/random.h>
#include <surfel/estimate/forest_sides.h>
#include <surfel/estimate/surface_parts.h>

#include "support/message_of.h"
#include "support/run_tool.h"

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
    join.place.position.setZero();
    join.place.number = random(i, 0, 5000);
    join.rank = static_cast<std::uint8_t>(random(i, 1, 64));
    join.weight = static_cast<float>(random(i, 2, 9)) / 100;
    // Edges that are equal in the order are one and the same.
    join.from = random(join.place.number, 3, kParts);
    join.to = random(join.place.number * 64 + join.rank, 4, kParts);
    join.opposed = random(join.place.number * 64 + join.rank, 5, 2) != 0;
    if (join.from != join.to) joins.push_back(join);
  }
  return joins;
}

using Ends = std::tuple<float, std::uint64_t, std::uint8_t, std::uint32_t, std::uint32_t, bool>;
Ends ends_of(const PartJoin& join) {
  return {join.weight, join.place.number, join.rank, join.from, join.to, join.opposed};
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

  PartJoins forward{CurveOrder()};
  for (const PartJoin& join : all) forward.add(join);
  EXPECT_EQ(forest_of(forward), expected);
  // Backwards, in pieces of which each is a forest of its own.
  std::reverse(all.begin(), all.end());
  PartJoins whole{CurveOrder()};
  for (std::size_t begin = 0; begin < all.size(); begin += 7000) {
    PartJoins piece{CurveOrder()};
    for (std::size_t i = begin; i < std::min(begin + 7000, all.size()); ++i) piece.add(all[i]);
    whole.add(piece);
  }
  EXPECT_EQ(forest_of(whole), expected);
}

TEST(PartJoins, AreNotKeptBeyondTheMemory) {
  // Points far from one another are parts by themselves.
  constexpr std::size_t kCount = 2000;
  const test::TemporaryFolder folder;
  const MortonGrid grid = morton_grid(Array<Vec3f>{Vec3f(0, 0, 0), Vec3f(1, 1, 1)});
  Array<Vec3f> position(kCount), normal(kCount);
  for (std::size_t i = 0; i < kCount; ++i) {
    position[i] = Vec3f(static_cast<float>(i) / kCount, 0, 0);
    normal[i] = Vec3f(0, 0, 1);
  }
  BlockEdges edges;
  edges.resize(kCount, 1);
  const auto join_all = [&](std::uint64_t memory) {
    ForestSides sides(kCount, grid,
                      {.method = Orientation::kMst,
                       .memory = memory,
                       .of_memory = memory,
                       .beside = folder / "out.ply"});
    sides.add(BlockForest::of(position, normal, edges, 0, grid));
    sides.unite();
    EXPECT_TRUE(sides.looks_for_joins());
    PartJoins joins = sides.joins();
    for (std::uint32_t i = 0; i < kCount / 2; ++i) {
      joins.add({.place = {position[i], i}, .weight = 0.01F, .from = i, .to = i + 1});
      joins.add({.place = {position[i], i}, .weight = 0.02F, .from = i + 1, .to = i, .rank = 1});
    }
    sides.require_room_for(joins, 0.5);
    sides.join(joins);
    return sides.turn().parts;
  };
  const std::string message = test::message_of([&] { join_all(200000); });
  const std::string words = "give at least ";
  ASSERT_NE(message.find(words), std::string::npos) << message;
  const std::uint64_t needed = std::stoull(message.substr(message.find(words) + words.size()));
  EXPECT_GT(needed, kCount * 200);
  EXPECT_EQ(join_all(needed), kCount / 2);
}

}  // namespace
}  // namespace surfel
