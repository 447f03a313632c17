#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/box_tree.h>
#include <surfel/base/random.h>

namespace surfel {
namespace {

/// An interval of a line.
struct Interval {
  double min = std::numeric_limits<double>::infinity();
  double max = -std::numeric_limits<double>::infinity();

  void add(const Interval& other) {
    min = std::min(min, other.min);
    max = std::max(max, other.max);
  }
  double distance(double x) const { return std::max({min - x, x - max, 0.0}); }
};

/// Items that move along the line as a curve that sometimes turns back.
std::vector<double> places(std::size_t count) {
  std::vector<double> x(count);
  for (std::size_t i = 0; i < count; ++i) {
    x[i] = std::floor(static_cast<double>(i) + 9 * random_uniform(1, i, 0));
  }
  return x;
}

/// Counts about those at which a leaf, a parent and a level begin.
const std::size_t kCounts[] = {0,  1,  2,  3,  4,  5,   7,   8,   9,   11,  12,
                               13, 15, 16, 17, 31, 32,  33,  47,  48,  49,  63,
                               64, 65, 80, 96, 97, 128, 129, 256, 257, 1000};

template <std::size_t kLeafSize, std::size_t kChildren>
struct Shape {
  static constexpr std::size_t kLeaf = kLeafSize;
  using Tree = BoxTree<Interval, kLeafSize, kChildren>;
  static Tree make(const std::vector<double>& x) {
    return {x.size(), [&](std::size_t i) { return Interval{x[i], x[i]}; }};
  }
};

template <class T>
class BoxTreeTest : public testing::Test {};
using Shapes = testing::Types<Shape<4, 2>, Shape<4, 4>, Shape<8, 4>, Shape<1, 2>, Shape<3, 3>>;
TYPED_TEST_SUITE(BoxTreeTest, Shapes);

TYPED_TEST(BoxTreeTest, LeavesBoundTheirItems) {
  for (const std::size_t count : kCounts) {
    const std::vector<double> x = places(count);
    const auto tree = TypeParam::make(x);
    std::size_t next = 0;
    for (std::size_t leaf = 0; leaf < tree.leaf_count(); ++leaf) {
      Interval box;
      std::size_t size = 0;
      tree.for_each_item(leaf, [&](std::size_t item) {
        EXPECT_EQ(item, next++);
        EXPECT_EQ(tree.leaf_of(item), leaf);
        box.add({x[item], x[item]});
        ++size;
      });
      EXPECT_EQ(tree.leaf_size(leaf), size);
      EXPECT_EQ(tree.leaf(leaf).min, box.min);
      EXPECT_EQ(tree.leaf(leaf).max, box.max);
    }
    EXPECT_EQ(next, count);
  }
}

TYPED_TEST(BoxTreeTest, FindsTheLeavesThatAPredicateHoldsFor) {
  for (const std::size_t count : kCounts) {
    const std::vector<double> x = places(count);
    const auto tree = TypeParam::make(x);
    for (double at = -2; at < static_cast<double>(count) + 12; at += 3) {
      for (const double reach : {-1.0, 0.0, 2.0, 40.0}) {
        const auto near = [&](const Interval& box) { return box.distance(at) <= reach; };
        std::vector<std::size_t> expected;
        for (std::size_t leaf = 0; leaf < tree.leaf_count(); ++leaf) {
          if (near(tree.leaf(leaf))) expected.push_back(leaf);
        }
        std::vector<std::size_t> found;
        tree.for_each_leaf(near, [&](std::size_t leaf) { found.push_back(leaf); });
        EXPECT_EQ(found, expected) << count << " " << at << " " << reach;
      }
    }
  }
}

TYPED_TEST(BoxTreeTest, NearestSearchesShrinkTheirBound) {
  for (const std::size_t count : kCounts) {
    const std::vector<double> x = places(count);
    const auto tree = TypeParam::make(x);
    for (double at = -2; at < static_cast<double>(count) + 12; at += 2.5) {
      double expected = std::numeric_limits<double>::infinity();
      for (const double place : x) expected = std::min(expected, std::abs(place - at));
      double least = std::numeric_limits<double>::infinity();
      std::size_t visited = 0;
      const auto distance_of = [&](const Interval& box) { return box.distance(at); };
      const auto enter = [&](const Interval& box, std::size_t number, double distance) {
        EXPECT_LT(number, tree.node_count());
        EXPECT_EQ(distance, box.distance(at));
        return distance < least;
      };
      const auto visit = [&](std::size_t item) {
        ++visited;
        least = std::min(least, std::abs(x[item] - at));
      };
      tree.search(distance_of, enter, visit);
      EXPECT_EQ(least, expected) << count << " " << at;
      // The items' boxes reach 9 places at most over the next ones.
      EXPECT_LE(visited, 40U);
      if (count == 0) continue;
      const std::size_t item = static_cast<std::size_t>(std::max(at, 0.0)) % count;
      least = std::numeric_limits<double>::infinity();
      tree.search_around(item, distance_of, enter, visit);
      EXPECT_EQ(least, expected) << count << " " << at << " around " << item;
    }
  }
}

TYPED_TEST(BoxTreeTest, SearchesVisitEveryItemOnceNearestChildrenFirst) {
  for (const std::size_t count : kCounts) {
    const std::vector<double> x = places(count);
    const auto tree = TypeParam::make(x);
    const auto all = [](const Interval&, std::size_t, double) { return true; };
    std::vector<std::size_t> order;
    const auto visit = [&](std::size_t item) { order.push_back(item); };
    const auto expect_all = [&] {
      std::sort(order.begin(), order.end());
      ASSERT_EQ(order.size(), count);
      for (std::size_t i = 0; i < count; ++i) EXPECT_EQ(order[i], i);
      order.clear();
    };
    // All at one distance: in their own order.
    tree.search([](const Interval&) { return 0.0; }, all, visit);
    EXPECT_TRUE(std::is_sorted(order.begin(), order.end()));
    expect_all();
    // The last first: leaves come in descending order.
    tree.search([](const Interval& box) { return -box.min; }, all, visit);
    if (count > 0) {
      EXPECT_GT(order.front() + 30, count);
    }
    expect_all();
    for (std::size_t item = 0; item < count; item += 1 + count / 16) {
      tree.search_around(
          item, [](const Interval& box) { return box.min; }, all, visit);
      EXPECT_EQ(tree.leaf_of(order.front()), tree.leaf_of(item));
      expect_all();
    }
  }
}

TYPED_TEST(BoxTreeTest, ThePathLeadsFromTheLeafToTheRoot) {
  for (const std::size_t count : kCounts) {
    const std::vector<double> x = places(count);
    const auto tree = TypeParam::make(x);
    std::vector<std::vector<std::size_t>> above(count);
    std::vector<Interval> box(tree.node_count());
    for (std::size_t i = 0; i < count; ++i) {
      tree.for_each_node_above(i, [&](std::size_t node) {
        ASSERT_LT(node, tree.node_count());
        above[i].push_back(node);
        box[node].add({x[i], x[i]});
      });
      EXPECT_EQ(above[i].front(), tree.leaf_of(i));
      EXPECT_EQ(above[i].back(), tree.node_count() - 1);
    }
    // A node's box is that of the items below it.
    tree.search([](const Interval&) { return 0.0; },
                [&](const Interval& node, std::size_t number, double) {
                  EXPECT_EQ(node.min, box[number].min);
                  EXPECT_EQ(node.max, box[number].max);
                  return true;
                },
                [](std::size_t) {});
  }
}

}  // namespace
}  // namespace surfel
