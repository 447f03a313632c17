#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <tuple>

#include <gtest/gtest.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/surface/neighbor_lists.h>
#include <surfel/surface/neighbor_search.h>

namespace surfel {
namespace {

using Points = Array<Vec3f>;

float uniform(std::size_t i, std::uint64_t dimension) {
  return static_cast<float>(random_uniform(7, i, dimension));
}

Points random_points(std::size_t count, float scale = 1, const Vec3f& shift = {0, 0, 0}) {
  Points p;
  for (std::size_t i = 0; i < count; ++i) {
    p.push_back(shift + scale * Vec3f(uniform(i, 0), uniform(i, 1), uniform(i, 2)));
  }
  return p;
}

/// Shuffled, so that indices and places have nothing to do with each other. Most distances have
/// many ties.
Points grid_points(int side) {
  Points p;
  for (int i = 0; i < side * side * side; ++i) {
    p.emplace_back(static_cast<float>(i % side), static_cast<float>(i / side % side),
                   static_cast<float>(i / side / side));
  }
  for (std::size_t i = p.size() - 1; i > 0; --i) std::swap(p[i], p[random_bits(3, i) % (i + 1)]);
  return p;
}

/// A few tight clusters far from each other, with points that coincide.
Points clustered_points(std::size_t count) {
  Points p;
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t cluster = random_bits(5, i) % 5;
    const std::size_t twin = random_bits(6, i) % 4 == 0 ? i / 8 * 8 : i;
    p.push_back(Vec3f(uniform(twin, 0), uniform(twin, 1), uniform(twin, 2)) * 1e-3F +
                Vec3f::Constant(static_cast<float>(cluster * cluster)));
  }
  return p;
}

std::vector<Neighbor> brute_force(const Points& points, const Vec3f& query, float limit2,
                                  std::size_t most) {
  std::vector<Neighbor> all;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const float distance2 = (points[i] - query).squaredNorm();
    if (distance2 <= limit2) all.push_back({static_cast<std::uint32_t>(i), distance2});
  }
  std::sort(all.begin(), all.end(), [](const Neighbor& a, const Neighbor& b) {
    return std::tie(a.distance2, a.index) < std::tie(b.distance2, b.index);
  });
  all.resize(std::min(all.size(), most));
  return all;
}

constexpr float kNoLimit = std::numeric_limits<float>::infinity();

bool same(std::span<const Neighbor> a, std::span<const Neighbor> b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const auto& x, const auto& y) {
    return x.index == y.index && x.distance2 == y.distance2;
  });
}

void expect_same_as_brute_force(const Points& points, float radius) {
  const auto search = make_neighbor_search(points);
  ASSERT_EQ(search->size(), points.size());
  std::vector<Neighbor> found;
  for (std::size_t q = 0; q < 60; ++q) {
    // At points and between them.
    Vec3f query = points[random_bits(11, q) % points.size()];
    if (q % 3 == 0) query += radius * Vec3f(uniform(q, 4), uniform(q, 5), -uniform(q, 6));
    for (const std::size_t k : {1, 2, 7, 16, 100, 300}) {
      search->nearest(query, k, found);
      ASSERT_TRUE(same(found, brute_force(points, query, kNoLimit, k))) << q << ", k = " << k;
    }
    for (const std::size_t most : {std::size_t{5}, std::size_t{200}, points.size() + 1}) {
      search->within(query, radius, most, found);
      ASSERT_TRUE(same(found, brute_force(points, query, radius * radius, most))) << q;
    }
  }
}

TEST(NeighborSearch, SameAsBruteForceOnRandomPoints) {
  for (const float scale : {1e-6F, 1.0F, 1e6F}) {
    expect_same_as_brute_force(random_points(3000, scale), 0.2F * scale);
  }
  expect_same_as_brute_force(random_points(3000, 1, Vec3f(1e4F, -1e4F, 1e4F)), 0.1F);
}

TEST(NeighborSearch, EqualDistancesAreOrderedByIndex) {
  expect_same_as_brute_force(grid_points(14), 2);
}

TEST(NeighborSearch, SameAsBruteForceInClusters) {
  expect_same_as_brute_force(clustered_points(3000), 3e-4F);
}

TEST(NeighborSearch, SameAsBruteForceInShellsWithinEachOther) {
  // Boxes of all scales overlap around the points of the inner shells.
  Points p;
  for (std::size_t i = 0; i < 4000; ++i) {
    const Vec3f direction(uniform(i, 0) - 0.5F, uniform(i, 1) - 0.5F, uniform(i, 2) - 0.5F);
    p.push_back(direction.normalized() * std::pow(0.01F, static_cast<float>(i % 8)));
  }
  expect_same_as_brute_force(p, 1e-6F);
}

TEST(NeighborSearch, SameAsBruteForceOnALineOfGrowingGaps) {
  Points p;  // A tree over it is as deep as they get.
  for (int i = 0; i < 120; ++i) p.emplace_back(std::ldexp(1.0F, i - 60), 0.0F, 0.0F);
  expect_same_as_brute_force(p, 3);
}

TEST(NeighborSearch, RadiusIsInclusive) {
  const Points points = {{0, 0, 0}, {3, 4, 0}, {0, 5, 0}, {5.000001F, 0, 0}};
  std::vector<Neighbor> found;
  make_neighbor_search(points)->within(points[0], 5, 10, found);
  ASSERT_EQ(found.size(), 3U);
  EXPECT_EQ(found[1].index, 1U);
  EXPECT_EQ(found[2].index, 2U);
  EXPECT_EQ(found[2].distance2, 25.0F);
}

TEST(NeighborSearch, FewPointsAndNone) {
  std::vector<Neighbor> found(3);
  const Points none;
  const auto empty = make_neighbor_search(none);
  EXPECT_EQ(empty->size(), 0U);
  empty->nearest({0, 0, 0}, 5, found);
  EXPECT_TRUE(found.empty());
  empty->for_each_nearest(5, [](std::size_t, std::span<const Neighbor>, int) { FAIL(); });

  const Points one = {{1, 2, 3}};
  const auto single = make_neighbor_search(one);
  single->nearest({1, 2, 5}, 5, found);
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].distance2, 4.0F);
  single->within({1, 2, 5}, 1, 5, found);
  EXPECT_TRUE(found.empty());
  single->nearest({1, 2, 5}, 0, found);
  EXPECT_TRUE(found.empty());

  const Points points = random_points(10);
  make_neighbor_search(points)->nearest(points[0], 1000, found);
  EXPECT_TRUE(same(found, brute_force(points, points[0], kNoLimit, 1000)));
}

TEST(NeighborSearch, CoincidentPointsAreFoundByIndexInLinearTime) {
  Points points;
  points.assign(100000, Vec3f(1, 2, 3));
  points.emplace_back(1.0F, 2.0F, 3.5F);
  const auto search = make_neighbor_search(points);
  std::atomic<std::size_t> right = 0;
  search->for_each_nearest(16, [&](std::size_t i, std::span<const Neighbor> found, int) {
    const bool apart = i + 1 == points.size();
    bool good = found.size() == 16;
    for (std::uint32_t j = 0; good && j < 16; ++j) {
      const std::uint32_t expected = !apart ? j : j == 0 ? 100000 : j - 1;
      good = found[j].index == expected && found[j].distance2 == (!apart || j == 0 ? 0 : 0.25F);
    }
    right += good ? 1 : 0;
  });
  EXPECT_EQ(right, points.size());
}

TEST(NeighborSearch, AllPointsNeighborhoodsForAnyNumberOfThreads) {
  Points points = random_points(2500);
  const Points grid = grid_points(8);
  for (const Vec3f& p : grid) points.push_back(p / 8);
  const auto search = make_neighbor_search(points);
  for (const int threads : {1, 2, 5}) {
    set_thread_count(threads);
    std::vector<std::vector<Neighbor>> nearest(points.size());
    std::vector<std::vector<Neighbor>> within(points.size());
    search->for_each_nearest(12, [&](std::size_t i, std::span<const Neighbor> found, int worker) {
      EXPECT_LT(worker, threads);
      EXPECT_TRUE(nearest[i].empty());
      nearest[i].assign(found.begin(), found.end());
    });
    search->for_each_within(0.1F, 20, [&](std::size_t i, std::span<const Neighbor> found, int) {
      within[i].assign(found.begin(), found.end());
    });
    for (std::size_t i = 0; i < points.size(); ++i) {
      ASSERT_TRUE(same(nearest[i], brute_force(points, points[i], kNoLimit, 12))) << i;
      ASSERT_TRUE(same(within[i], brute_force(points, points[i], 0.1F * 0.1F, 20))) << i;
    }
  }
  set_thread_count(0);
}

/// All points' neighbourhoods, one by one and all at once, against brute force at some points and
/// against FLANN at all.
void expect_same_as_flann(const Points& points, std::size_t k, float radius) {
  const auto ours = make_neighbor_search(points, SearchMethod::kExact);
  const auto flann = make_neighbor_search(points, SearchMethod::kFlann);
  std::vector<std::vector<Neighbor>> expected(points.size());
  const auto keep = [&](std::size_t i, std::span<const Neighbor> found, int) {
    expected[i].assign(found.begin(), found.end());
  };
  std::atomic<std::size_t> right = 0;
  const auto compare = [&](std::size_t i, std::span<const Neighbor> found, int) {
    right += same(found, expected[i]) ? 1 : 0;
  };
  flann->for_each_within(radius, 2 * k, keep);
  ours->for_each_within(radius, 2 * k, compare);
  EXPECT_EQ(right, points.size()) << "within";
  right = 0;
  flann->for_each_nearest(k, keep);
  ours->for_each_nearest(k, compare);
  EXPECT_EQ(right, points.size()) << "nearest";
  std::vector<Neighbor> found;
  for (std::size_t q = 0; q < 30; ++q) {
    const std::size_t i = random_bits(13, q) % points.size();
    ASSERT_TRUE(same(expected[i], brute_force(points, points[i], kNoLimit, k))) << i;
    ours->nearest(points[i], k, found);
    ASSERT_TRUE(same(expected[i], found)) << i;
  }
}

TEST(ExactSearch, SameAsFlannWhereTheDensityJumps) {
  Points p;  // A thousand times as many points a unit of area on one half of a plane.
  for (std::size_t i = 0; i < 12000; ++i) {
    const float x = uniform(i, 0);
    if (x >= 0.5F && i % 1000 != 0) continue;
    p.emplace_back(x, uniform(i, 1), 0.0F);
  }
  expect_same_as_flann(p, 16, 0.02F);
}

TEST(ExactSearch, SameAsFlannFarFromTheOrigin) {
  // Coordinates of 1e7 units are a unit apart: many coincide, most distances have ties.
  Points p;
  for (std::size_t i = 0; i < 5000; ++i) {
    p.push_back(Vec3f(1e7F, -2e7F, 3e7F) + 40 * Vec3f(uniform(i, 0), uniform(i, 1), 0));
  }
  expect_same_as_flann(p, 16, 3);
}

TEST(ExactSearch, SameAsFlannInAClusterOfAHugeExtent) {
  // All but a few points share a cell of the Morton grid, and of these all but a few one of its
  // finer grid.
  Points p = random_points(3000, 1e-9F);
  for (const Vec3f& q : random_points(300)) p.push_back(q);
  p.emplace_back(1e8F, 1e8F, -1e8F);
  p.emplace_back(-1e8F, 0.0F, 0.0F);
  expect_same_as_flann(p, 10, 1e-10F);
}

TEST(ExactSearch, SameAsFlannOnALine) {
  Points p;
  for (std::size_t i = 0; i < 3000; ++i) p.push_back(uniform(i / 2, 0) * Vec3f(1, 2, -3));
  expect_same_as_flann(p, 16, 0.01F);
}

TEST(ExactSearch, SameAsFlannForManyNeighbors) {
  expect_same_as_flann(random_points(1200), 150, 0.3F);
  expect_same_as_flann(clustered_points(1200), 700, 1e-4F);
}

TEST(NeighborRecall, OfAnExactSearchIsOne) {
  const Points points = clustered_points(3000);
  const auto flann = make_neighbor_search(points, SearchMethod::kFlann);
  EXPECT_EQ(neighbor_recall(points, *flann, 16), 1);
  EXPECT_EQ(neighbor_recall(points, *flann, 5000), 1);
  const Points none;
  EXPECT_EQ(neighbor_recall(none, *make_neighbor_search(none), 16), 1);
}

TEST(NeighborRecall, TellsWhatAnApproximateSearchMisses) {
  const Points points = random_points(20000);
  const auto search = make_neighbor_search(points, SearchMethod::kFlannApproximate);
  const double recall = neighbor_recall(points, *search, 16);
  EXPECT_GT(recall, 0.96);
  EXPECT_LT(recall, 1);
}

TEST(NeighborSearch, ApproximateFindsMostOfTheNearest) {
  const Points points = random_points(20000);
  const auto exact = make_neighbor_search(points);
  const auto approximate = make_neighbor_search(points, SearchMethod::kFlannApproximate);
  std::vector<Neighbor> a;
  std::vector<Neighbor> b;
  std::size_t hits = 0;
  for (std::size_t i = 0; i < 2000; ++i) {
    exact->nearest(points[i], 16, a);
    approximate->nearest(points[i], 16, b);
    ASSERT_EQ(b.size(), 16U);
    for (const Neighbor& n : a) {
      hits += std::any_of(b.begin(), b.end(), [&](const auto& m) { return m.index == n.index; });
    }
  }
  EXPECT_GT(hits, 2000U * 16U * 96 / 100);
}

TEST(NeighborLists, AreWhatTheSearchFinds) {
  Array<Vec3f> points;
  for (std::uint64_t i = 0; i < 3000; ++i) {
    // Many ties and coincident points.
    const auto at = [&](int d) {
      return static_cast<float>(std::floor(10 * random_uniform(4, i, d)));
    };
    points.emplace_back(at(0), at(1), at(2));
  }
  const auto search = make_neighbor_search(points);
  const NeighborLists lists(*search, points, 12);
  // The first pass searches, the others read.
  for (const std::size_t k : {7U, 1U, 12U, 20U, 7U}) {
    std::vector<std::vector<Neighbor>> expected(points.size());
    search->for_each_nearest(k, [&](std::size_t i, std::span<const Neighbor> near, int) {
      expected[i].assign(near.begin(), near.end());
    });
    lists.for_each_nearest(k, [&](std::size_t i, std::span<const Neighbor> near, int) {
      ASSERT_EQ(near.size(), expected[i].size());
      for (std::size_t n = 0; n < near.size(); ++n) {
        EXPECT_EQ(near[n].index, expected[i][n].index);
        EXPECT_EQ(near[n].distance2, expected[i][n].distance2);
      }
    });
    for (const NeighborSearch* some :
         std::initializer_list<const NeighborSearch*>{search.get(), &lists}) {
      const NeighborRows rows = some->rows(k);
      for (std::size_t i = 0; i < points.size(); ++i) {
        ASSERT_EQ(rows.of(i).size(), expected[i].size());
        for (std::size_t n = 0; n < expected[i].size(); ++n) {
          EXPECT_EQ(rows.of(i)[n], expected[i][n].index);
        }
      }
    }
  }
  EXPECT_EQ(NeighborLists(*search, points, 12).rows(5).of(17)[3], search->rows(9).of(17)[3]);
  const Array<Vec3f> two{Vec3f(0, 0, 0), Vec3f(1, 0, 0)};
  const auto small = make_neighbor_search(two);
  NeighborLists(*small, two, 16)
      .for_each_nearest(
          9, [&](std::size_t, std::span<const Neighbor> near, int) { EXPECT_EQ(near.size(), 2U); });
}

}  // namespace
}  // namespace surfel
