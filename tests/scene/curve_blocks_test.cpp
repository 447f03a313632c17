#include <algorithm>
#include <cmath>
#include <numeric>

#include <gtest/gtest.h>
#include <surfel/base/morton.h>
#include <surfel/scene/curve_blocks.h>
#include <surfel/scene/surfel_ranges.h>

#include "render/scenes.h"

namespace surfel::test {
namespace {

constexpr std::size_t kMost = 2000;

/// A cloud as it is, whatever its order.
class AsItIs final : public SurfelRanges {
 public:
  explicit AsItIs(SurfelCloud cloud) : cloud_(std::move(cloud)) {}
  std::size_t size() const override { return cloud_.size(); }
  SurfelCloud read(std::size_t begin, std::size_t end) const override {
    Array<std::uint32_t> order(end - begin);
    std::iota(order.begin(), order.end(), static_cast<std::uint32_t>(begin));
    return cloud_.gathered(order);
  }
  MortonGrid grid() const override {
    return morton_grid({cloud_.position.data(), cloud_.position.size()});
  }

 private:
  SurfelCloud cloud_;
};

/// 128 x 128 surfels, of which cells of the curve have 1024 or 4096.
SurfelCloud square() {
  SurfelCloud cloud;
  for (int y = 0; y < 128; ++y) {
    for (int x = 0; x < 128; ++x) {
      add_surfel(cloud, Vec3d(x, y, 0).cast<float>(), {0, 0, 1}, 1, 1, {1, 1, 1});
    }
  }
  return cloud;
}

/// The blocks are the whole cloud, in sequence, and their boxes hold their surfels.
void expect_sound(const CurveBlocks& cut, const SurfelRanges& ranges) {
  ASSERT_TRUE(cut.in_order);
  std::size_t next = 0;
  std::size_t usable = 0;
  for (std::size_t b = 0; b < cut.blocks.size(); ++b) {
    const CurveBlock& block = cut.blocks[b];
    EXPECT_EQ(block.begin, next);
    next = block.end;
    usable += block.count;
    EXPECT_LE(block.count, kMost);
    if (b + 1 < cut.blocks.size()) {
      EXPECT_GE(block.count, kMost / 4);
    }
    const SurfelCloud cloud = ranges.read(block.begin, block.end);
    Array<std::uint32_t> order(cloud.size());
    std::iota(order.begin(), order.end(), 0U);
    remove_unusable(cloud, false, order);
    ASSERT_EQ(order.size(), block.count);
    Vec3f low = cloud.position[order[0]];
    Vec3f high = low;
    for (const std::uint32_t i : order) {
      low = low.cwiseMin(cloud.position[i]);
      high = high.cwiseMax(cloud.position[i]);
    }
    EXPECT_EQ(block.min, low);
    EXPECT_EQ(block.max, high);
  }
  EXPECT_EQ(next, ranges.size());
  EXPECT_EQ(usable + cut.dropped.total(), ranges.size());
}

TEST(CurveBlocks, AreCellsOfTheGridWhereTheseFit) {
  SurfelCloud cloud = square();
  const OrderedCloud ranges(cloud);
  const CurveBlocks cut = curve_blocks(ranges, kMost);
  expect_sound(cut, ranges);
  ASSERT_EQ(cut.blocks.size(), 16U);
  for (const CurveBlock& block : cut.blocks) {
    EXPECT_EQ(block.count, 1024U);
    EXPECT_EQ(block.max - block.min, Vec3f(31, 31, 0));
  }
}

TEST(CurveBlocks, LeaveOutWhatCannotBeDrawn) {
  SurfelCloud cloud = fibonacci_sphere(20000, 1);
  for (std::size_t i = 0; i < cloud.size(); i += 3) cloud.variance[i] = NAN;
  for (std::size_t i = 1; i < cloud.size(); i += 30) cloud.position[i].y() = NAN;
  const OrderedCloud ranges(cloud);
  const CurveBlocks cut = curve_blocks(ranges, kMost);
  expect_sound(cut, ranges);
  EXPECT_EQ(cut.dropped.variance, 6667U);
  EXPECT_EQ(cut.dropped.position, 667U);

  // The same surfels without the others, in the same grid, make the same blocks.
  SurfelCloud rest = cloud;
  for (std::size_t i = 0; i < cloud.size(); ++i) rest.level.push_back(i % 3 == 0 || i % 30 == 1);
  Array<std::uint32_t> kept;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (rest.level[i] == 0) kept.push_back(static_cast<std::uint32_t>(i));
  }
  const SurfelCloud drawn = cloud.gathered(kept);
  const CurveBlocks same = curve_blocks(OrderedCloud(drawn), kMost);
  ASSERT_EQ(same.blocks.size(), cut.blocks.size());
  for (std::size_t b = 0; b < cut.blocks.size(); ++b) {
    EXPECT_EQ(same.blocks[b].count, cut.blocks[b].count);
    EXPECT_EQ(same.blocks[b].min, cut.blocks[b].min);
  }

  SurfelCloud none = cloud;
  std::fill(none.variance.begin(), none.variance.end(), 0.0F);
  const CurveBlocks empty = curve_blocks(OrderedCloud(none), kMost);
  EXPECT_TRUE(empty.blocks.empty());
  EXPECT_EQ(empty.dropped.total(), none.size());
}

TEST(CurveBlocks, EndWhereAllPointsAreOne) {
  SurfelCloud cloud;
  for (int i = 0; i < 9000; ++i) add_surfel(cloud, {1, 2, 3}, {0, 0, 1}, 1, 1, {1, 1, 1});
  const OrderedCloud ranges(cloud);
  const CurveBlocks cut = curve_blocks(ranges, kMost);
  expect_sound(cut, ranges);
  EXPECT_EQ(cut.blocks.size(), 5U);
}

TEST(CurveBlocks, OneFarPointChangesNoneOfTheOthers) {
  // The grid around the far point has the whole square in one cell.
  SurfelCloud cloud = square();
  add_surfel(cloud, {1e9F, 0, 0}, {0, 0, 1}, 1, 1, {1, 1, 1});
  const OrderedCloud ranges(cloud);
  const CurveBlocks cut = curve_blocks(ranges, kMost);
  expect_sound(cut, ranges);
  for (std::size_t b = 0; b + 1 < cut.blocks.size(); ++b) {
    EXPECT_EQ(cut.blocks[b].max - cut.blocks[b].min, Vec3f(31, 31, 0)) << b;
  }
}

TEST(CurveBlocks, AreNoneInAnotherOrder) {
  const SurfelCloud sphere = fibonacci_sphere(300000, 1);
  EXPECT_FALSE(curve_blocks(AsItIs(sphere), kMost).in_order);
  const SurfelCloud sorted = sphere.gathered(morton_order(sphere.position));
  EXPECT_TRUE(curve_blocks(AsItIs(sorted), kMost).in_order);
  // Two pieces that are in order, one before the other.
  Array<std::uint32_t> turned(sorted.size());
  std::iota(turned.begin(), turned.end(), 0U);
  std::rotate(turned.begin(), turned.begin() + (1 << 16), turned.end());
  EXPECT_FALSE(curve_blocks(AsItIs(sorted.gathered(turned)), kMost).in_order);
}

}  // namespace
}  // namespace surfel::test
