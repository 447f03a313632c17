#include <algorithm>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/sp06/joint_layers.h>

namespace surfel {
namespace {

using Member = JointLayers::Member;

DiscFragment disc(std::uint16_t group, float depth, float key, bool front = true) {
  return {.disc = group * 100U,
          .group = group,
          .front = front,
          .depth = depth,
          .epsilon = 0.1F,
          .key = key,
          .rho = 1 - key};
}

DiscFragment enlarged(std::uint16_t group, float depth, float key, bool front = true) {
  DiscFragment f = disc(group, depth, key, front);
  f.enlarged = true;
  return f;
}

std::vector<Member> told(std::vector<DiscFragment> fragments, int groups,
                         std::size_t* culled = nullptr) {
  JointLayers layers;
  const auto members = layers.tell(fragments, groups);
  if (culled) *culled = layers.culled();
  return {members.begin(), members.end()};
}

TEST(JointLayers, OneFragmentOfEveryGroupForALayer) {
  std::size_t culled = 0;
  const auto members =
      told({disc(1, 1.0F, 0.5F), disc(0, 1.02F, 0.8F), disc(0, 0.98F, 0.25F)}, 3, &culled);
  ASSERT_EQ(members.size(), 2U);
  EXPECT_EQ(members[0].group, 0);
  EXPECT_EQ(members[0].key, 0.25F) << "the fragment nearest to its disc's centre";
  EXPECT_EQ(members[1].group, 1);
  EXPECT_EQ(members[0].depth, members[1].depth);
  EXPECT_NEAR(members[0].depth, (0.5 * 1 + 0.2 * 1.02 + 0.75 * 0.98) / 1.45, 1e-6);
  EXPECT_NEAR(members[0].weight, 1.45, 1e-6);
  EXPECT_EQ(culled, 1U);
}

TEST(JointLayers, FarthestLayerFirstAndSidesApart) {
  const auto members = told({disc(0, 3, 0.5F), disc(0, 1, 0.5F), disc(1, 2, 0.5F, false),
                             disc(1, 1.05F, 0.5F), disc(0, 2.99F, 0.5F, false)},
                            2);
  std::vector<float> depths(members.size());
  std::transform(members.begin(), members.end(), depths.begin(),
                 [](const Member& m) { return m.depth; });
  ASSERT_EQ(members.size(), 5U);
  EXPECT_TRUE(std::is_sorted(depths.begin(), depths.end()));
  EXPECT_EQ(depths[0], depths[1]);
  EXPECT_NE(depths[3], depths[4]) << "the two sides of a thin body are two layers";
}

TEST(JointLayers, GroupsThatEachSeeAPartOfASteepSurfaceShowOneLayer) {
  // The fragments of group 1 alone are further apart than epsilon.
  const auto members = told({disc(1, 1.08F, 0.4F), disc(0, 1.0F, 0.1F), disc(1, 0.94F, 0.5F)}, 2);
  ASSERT_EQ(members.size(), 2U);
  EXPECT_EQ(members[1].key, 0.4F);
}

TEST(JointLayers, EnlargedDiscsFillLayersAndMakeNone) {
  EXPECT_TRUE(told({enlarged(0, 1, 0.5F)}, 2).empty());
  // Group 1 has a hole in the layer at 1, and its disc sticks out of the surface at 2.
  const auto members = told({disc(0, 1, 0.5F), enlarged(1, 1.05F, 0.9F), enlarged(1, 2, 0.1F)}, 2);
  ASSERT_EQ(members.size(), 2U);
  EXPECT_TRUE(members[1].enlarged);
  EXPECT_EQ(members[1].key, 0.9F);
  EXPECT_EQ(members[1].depth, 1) << "on the surface, which the flat disc has left";
  EXPECT_EQ(members[1].weight, 0.5F);
}

TEST(JointLayers, EnlargedDiscsNeverTakeThePlaceOfOthers) {
  for (const bool first : {false, true}) {
    std::vector<DiscFragment> fragments = {disc(0, 1, 0.9F), enlarged(0, 1, 0.1F)};
    if (first) std::swap(fragments[0], fragments[1]);
    std::size_t culled = 0;
    const auto members = told(fragments, 1, &culled);
    ASSERT_EQ(members.size(), 1U);
    EXPECT_FALSE(members[0].enlarged);
    EXPECT_EQ(culled, 0U);
  }
  EXPECT_EQ(told({disc(0, 1, 0.9F), enlarged(1, 1, 0.1F, false)}, 2).size(), 1U)
      << "the other side is another layer";
}

TEST(JointLayers, CopiesOfADiscCoverOnce) {
  DiscFragment copy = disc(0, 1, 0.25F);
  copy.group = 2;
  const auto members = told({disc(0, 1, 0.25F), disc(1, 1.01F, 0.5F), copy}, 3);
  ASSERT_EQ(members.size(), 3U);
  EXPECT_NEAR(members[2].weight, 1.25, 1e-6);
}

TEST(JointLayers, OrderDoesNotMatter) {
  std::vector<DiscFragment> fragments;
  for (std::uint16_t i = 0; i < 40; ++i) {
    fragments.push_back(disc(i % 4, 1 + 0.07F * static_cast<float>(i * 7 % 40),
                             static_cast<float>(i % 9) / 9, i % 3 == 0));
  }
  const auto expected = told(fragments, 4);
  std::reverse(fragments.begin(), fragments.end());
  const auto members = told(fragments, 4);
  ASSERT_EQ(members.size(), expected.size());
  for (std::size_t i = 0; i < members.size(); ++i) {
    EXPECT_EQ(members[i].group, expected[i].group);
    EXPECT_EQ(members[i].key, expected[i].key);
    EXPECT_EQ(members[i].depth, expected[i].depth);
  }
}

}  // namespace
}  // namespace surfel
