#include <cmath>
#include <random>
#include <span>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/coordinate_spread.h>

namespace surfel {
namespace {

Bounds core_of(const std::vector<Vec3d>& points) {
  CoordinateSpread spread;
  Bounds box;
  for (const Vec3d& p : points) {
    for (int axis = 0; axis < 3; ++axis) spread.add(axis, std::span(&p[axis], 1));
    if (p.allFinite()) box.add(p);
  }
  return spread.core(box);
}

std::vector<Vec3d> cube(std::size_t count, const Vec3d& corner) {
  std::mt19937_64 engine(1);
  std::uniform_real_distribution<double> within(0, 10);
  std::vector<Vec3d> points;
  for (std::size_t i = 0; i < count; ++i) {
    points.emplace_back(corner + Vec3d(within(engine), within(engine), within(engine)));
  }
  return points;
}

TEST(CoordinateSpread, ACloudWithoutStraysHasItsBox) {
  for (const double place : {0.0, -5.0, 5e2, -5e6}) {
    const std::vector<Vec3d> points = cube(1000, Vec3d(place, 0, -place));
    Bounds box;
    for (const Vec3d& p : points) box.add(p);
    const Bounds core = core_of(points);
    EXPECT_EQ(core.min, box.min);
    EXPECT_EQ(core.max, box.max);
  }
}

TEST(CoordinateSpread, StraysAreLeftOutWhateverTheOrder) {
  for (const double place : {1e3, -1e5, 1e7}) {
    std::vector<Vec3d> points = cube(1000, Vec3d(place, 10 * place, 100));
    points.insert(points.begin() + 10, 200, Vec3d::Zero());
    points.emplace_back(1e12, 0, NAN);
    const Bounds core = core_of(points);
    const Bounds others = core_of(cube(1000, Vec3d(place, 10 * place, 100)));
    EXPECT_EQ(core.min, others.min);
    EXPECT_EQ(core.max, others.max);
    std::shuffle(points.begin(), points.end(), std::mt19937(2));
    EXPECT_EQ(core_of(points).min, core.min);
    EXPECT_EQ(core_of(points).max, core.max);
  }
}

TEST(CoordinateSpread, HalvesAreNoStrays) {
  std::vector<Vec3d> points = cube(500, Vec3d(1e6, 0, 0));
  const std::vector<Vec3d> others = cube(500, Vec3d(-1e6, 0, 0));
  points.insert(points.end(), others.begin(), others.end());
  EXPECT_GT(core_of(points).diagonal(), 2e6 - 20);
}

TEST(CoordinateSpread, PartsAddUp) {
  std::vector<Vec3f> offsets;
  for (const Vec3d& p : cube(100000, Vec3d::Zero())) offsets.push_back(p.cast<float>());
  const Vec3d origin(5e5, 5e6, 0);
  CoordinateSpread parts;
  parts.add(Vec3d::Zero(), std::vector<Vec3f>(3, Vec3f::Zero()));
  parts.add(origin, offsets);
  std::vector<Vec3d> points(3, Vec3d::Zero());
  for (const Vec3f& p : offsets) points.emplace_back(origin + p.cast<double>());
  Bounds box;
  for (const Vec3d& p : points) box.add(p);
  EXPECT_EQ(parts.core(box).min, core_of(points).min);
  EXPECT_EQ(parts.core(box).max, core_of(points).max);
}

}  // namespace
}  // namespace surfel
