#include <algorithm>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/random.h>
#include <surfel/sample/sizing_field.h>

namespace surfel {
namespace {

Vec3f random_point(std::uint64_t seed, std::uint64_t i) {
  return {static_cast<float>(random_uniform(seed, i, 0)),
          static_cast<float>(random_uniform(seed, i, 1)),
          static_cast<float>(random_uniform(seed, i, 2))};
}

std::vector<SizingCell> random_cells(std::size_t count) {
  std::vector<SizingCell> cells;
  for (std::size_t i = 0; i < count; ++i) {
    const Vec3f min = random_point(1, i);
    const auto side = static_cast<float>(0.1 * random_uniform(2, i));
    cells.push_back(
        {min, min + Vec3f::Constant(side), static_cast<float>(0.01 + 0.2 * random_uniform(3, i))});
  }
  return cells;
}

TEST(SizingField, IsTheLeastOfAllCellsBounds) {
  constexpr double kGradient = 0.3;
  constexpr double kLargest = 0.15;
  for (const std::size_t count : {1u, 4u, 5u, 37u, 1000u}) {
    const std::vector<SizingCell> cells = random_cells(count);
    const SizingField field(cells, kGradient, kLargest);
    for (std::size_t i = 0; i < 300; ++i) {
      const Vec3f p = 1.5f * random_point(4, i) - Vec3f::Constant(0.2f);
      double expected = kLargest;
      for (const SizingCell& cell : cells) {
        const Vec3f nearest = p.cwiseMax(cell.min).cwiseMin(cell.max);
        expected = std::min(expected, cell.spacing + kGradient * (p - nearest).norm());
      }
      EXPECT_NEAR(field.at(p), expected, 1e-6) << count;
    }
    EXPECT_LE(field.least(), field.largest());
  }
}

TEST(SizingField, ChangesNoFasterThanItsGradient) {
  const SizingField field(random_cells(200), 0.3, 1);
  for (std::size_t i = 0; i < 1000; ++i) {
    const Vec3f p = random_point(5, i);
    const Vec3f q = p + 0.05f * random_point(6, i);
    EXPECT_LE(std::abs(field.at(p) - field.at(q)), 0.3 * (p - q).norm() + 1e-6);
  }
}

TEST(SizingField, WithoutCellsIsTheSameEverywhere) {
  const SizingField field(0.25);
  EXPECT_EQ(field.at(Vec3f(3, -1, 7)), 0.25);
  EXPECT_EQ(field.least(), 0.25);
  EXPECT_EQ(field.largest(), 0.25);
  EXPECT_EQ(field.gradient(), 0);
  EXPECT_EQ(SizingField({}, 0.3, 2).at(Vec3f(0, 0, 0)), 2);
}

}  // namespace
}  // namespace surfel
