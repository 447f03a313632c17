#include <algorithm>
#include <cmath>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/random.h>
#include <surfel/scene/stray_points.h>

namespace surfel::test {
namespace {

using Points = std::vector<Vec3d>;

Vec3d random_point(std::uint64_t seed, std::uint64_t i) {
  return {2 * random_uniform(seed, i, 0) - 1, 2 * random_uniform(seed, i, 1) - 1,
          2 * random_uniform(seed, i, 2) - 1};
}

/// Points on the unit sphere.
Points sphere(int count, std::uint64_t seed = 1) {
  Points points;
  for (std::uint64_t i = 0; points.size() < static_cast<std::size_t>(count); ++i) {
    const Vec3d p = random_point(seed, i);
    if (p.norm() > 0.1 && p.norm() < 1) points.push_back(p.normalized());
  }
  return points;
}

/// Points all over a cube of some half side, but not within 3 of the origin.
Points scattered(int count, double half_side) {
  Points points;
  for (std::uint64_t i = 0; points.size() < static_cast<std::size_t>(count); ++i) {
    const Vec3d p = half_side * random_point(9, i);
    if (p.norm() > 3) points.push_back(p);
  }
  return points;
}

Points joined(Points a, const Points& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

/// The core of points in groups of `size` that follow one another along the x axis.
std::optional<CloudCore> core_of(Points points, std::size_t size = 64) {
  std::stable_sort(points.begin(), points.end(),
                   [](const Vec3d& a, const Vec3d& b) { return a.x() < b.x(); });
  std::vector<PointGroup> groups;
  for (std::size_t begin = 0; begin < points.size(); begin += size) {
    const std::size_t end = std::min(begin + size, points.size());
    Bounds box;
    for (std::size_t i = begin; i < end; ++i) box.add(points[i]);
    groups.push_back({box.center(), box.diagonal() / 2, end - begin});
  }
  return find_core(groups, [&](std::size_t g, FunctionRef<void(const Vec3d&)> add) {
    for (std::size_t i = g * size; i < std::min((g + 1) * size, points.size()); ++i) add(points[i]);
  });
}

TEST(StrayPoints, AreTheFewFarFromTheCloud) {
  for (const int count : {400, 2000, 30000}) {
    // As far as a diameter, and as far as numbers go.
    for (const double far : {6.0, 1e3, 1e12}) {
      const Vec3d place = far * Vec3d(0.2, -0.9, 0.3).normalized();
      const std::optional<CloudCore> core = core_of(joined(sphere(count), {place}));
      ASSERT_TRUE(core) << count << ' ' << far;
      EXPECT_EQ(core->stray, 1U);
      EXPECT_TRUE(core->box.contains(Vec3d(0.9, 0, 0)) && core->box.contains(Vec3d(0, -0.9, 0)));
      EXPECT_LT(core->box.diagonal(), 2 * std::sqrt(3.0) * 1.3);
    }
  }
}

TEST(StrayPoints, MayComeInClumpsAndFromAllSides) {
  Points points = sphere(100000);
  for (int side = 0; side < 4; ++side) {
    for (std::uint64_t i = 0; i < 100; ++i) {
      const Vec3d place = 40 * Vec3d(side % 2 == 0 ? 1 : -1, side < 2 ? 1 : -1, 0.2);
      points.push_back(place + 0.1 * random_point(3 + side, i));
    }
  }
  const std::optional<CloudCore> core = core_of(joined(points, scattered(90, 100)));
  ASSERT_TRUE(core);
  EXPECT_EQ(core->stray, 490U);
}

TEST(StrayPoints, AreNotWellPopulatedParts) {
  // A lamp of few points far from a chair of many, and two equal ones.
  for (const int count : {101, 1000, 100000}) {
    Points lamp = sphere(count, 2);
    for (Vec3d& p : lamp) p = 0.3 * p + Vec3d(30, 10, 0);
    EXPECT_FALSE(core_of(joined(sphere(100000), lamp))) << count;
  }
}

TEST(StrayPoints, AreNotWhatReachesOutFromTheCloud) {
  Points mast = sphere(50000);
  for (int i = 0; i < 100; ++i) mast.emplace_back(0, 1 + 0.2 * i, 0);
  EXPECT_FALSE(core_of(mast));
  Points line;
  for (int i = 0; i < 5000; ++i) line.emplace_back(std::pow(0.001 * i, 3), 0, 0);
  EXPECT_FALSE(core_of(line));
}

TEST(StrayPoints, AreAtMostATwoHundredth) {
  EXPECT_TRUE(core_of(joined(sphere(20000), scattered(90, 60))));
  EXPECT_FALSE(core_of(joined(sphere(20000), scattered(120, 60))));
  EXPECT_FALSE(core_of(joined(sphere(150), {Vec3d(50, 0, 0)})));
}

TEST(StrayPoints, DoNotMatterNextToTheCloud) {
  EXPECT_FALSE(core_of(sphere(10000)));
  EXPECT_FALSE(core_of(joined(sphere(10000), {Vec3d(1.4, 0, 0)})));
}

TEST(StrayPoints, DependNeitherOnGroupsNorOnScaleAndPlace) {
  const Points points = joined(sphere(20000), scattered(20, 50));
  const std::optional<CloudCore> core = core_of(points, 1);
  ASSERT_TRUE(core);
  EXPECT_EQ(core->stray, 20U);
  for (const std::size_t size : {7, 256, 5000, 50000}) {
    const std::optional<CloudCore> other = core_of(points, size);
    ASSERT_TRUE(other) << size;
    EXPECT_EQ(other->stray, core->stray);
    EXPECT_LT((other->box.min - core->box.min).norm(), 0.3);
    EXPECT_LT((other->box.max - core->box.max).norm(), 0.3);
  }
  Points moved = points;
  for (Vec3d& p : moved) p = 1e-6 * p + Vec3d(10, 20, -5);
  const std::optional<CloudCore> same = core_of(moved, 1);
  ASSERT_TRUE(same);
  EXPECT_EQ(same->stray, core->stray);
  EXPECT_LT((same->box.min - Vec3d(10, 20, -5) - 1e-6 * core->box.min).norm(), 1e-12);
}

TEST(StrayPoints, AreNotInCloudsWithoutExtent) {
  EXPECT_FALSE(core_of({}));
  EXPECT_FALSE(core_of(Points(5, Vec3d(1, 2, 3))));
  EXPECT_FALSE(core_of(joined(Points(5000, Vec3d(1, 2, 3)), {Vec3d(7, 0, 0)})));
  EXPECT_FALSE(core_of(joined(sphere(100), {Vec3d::Constant(std::nan(""))})));
}

}  // namespace
}  // namespace surfel::test
