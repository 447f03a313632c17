#include <cmath>
#include <numbers>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/texture/kernel_overlap.h>

#include "support/message_of.h"

namespace surfel {
namespace {

/// Square grid of spacing 1, in rows.
SurfelCloud square_grid(int side, float variance) {
  SurfelCloud cloud;
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      cloud.position.emplace_back(static_cast<float>(x), static_cast<float>(y), 0.0F);
    }
  }
  cloud.normal.assign(cloud.size(), Vec3f(0, 0, 1));
  cloud.variance.assign(cloud.size(), variance);
  cloud.area.assign(cloud.size(), 1);
  return cloud;
}

TEST(KernelOverlap, IsTheDiscsAreaByThatOfACell) {
  // Discs at a border reach beyond it: a twentieth of a side is a radius.
  for (const double cutoff : {4.0, 16.0}) {
    const double radius2 = 2 * cutoff;
    EXPECT_NEAR(kernel_overlap(make_basis(square_grid(120, 1)), cutoff), std::numbers::pi * radius2,
                0.12 * std::numbers::pi * radius2);
  }
  EXPECT_EQ(kernel_overlap(SurfelBasis(), 1), 0);
}

TEST(KernelOverlap, OfAFewHugeDiscsIsSmallAndOfManyRefused) {
  SurfelCloud cloud = square_grid(60, 1);
  for (std::size_t i = 0; i < 10; ++i) cloud.variance[i * 300] = 1e6;
  EXPECT_NO_THROW(require_bounded_overlap(make_basis(cloud), 2, "a.ply"));
  SurfelCloud places = square_grid(60, 1);
  for (std::size_t i = 0; i < places.size(); i += 2) places.position[i] = {3, 3, 0};
  for (const SurfelCloud& bad : {square_grid(60, 1000), places}) {
    const std::string message =
        test::message_of([&] { require_bounded_overlap(make_basis(bad), 2, "a.ply"); });
    EXPECT_EQ(message.find("a.ply: "), 0U) << message;
  }
}

}  // namespace
}  // namespace surfel
