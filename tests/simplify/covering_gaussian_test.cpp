#include <Eigen/Geometry>
#include <cmath>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/random.h>
#include <surfel/simplify/covering_gaussian.h>

namespace surfel {
namespace {

float uniform(std::uint64_t i, int dimension) {
  return static_cast<float>(random_uniform(7, i, dimension));
}

TEST(CoveringGaussian, HoldsTheDiscsOfAllPlaces) {
  const Vec3f center(10, -3, 2);
  const Vec3f n = Vec3f(1, 2, -0.5F).normalized();
  const Vec3f t = n.unitOrthogonal();
  const Vec3f b = n.cross(t);
  std::vector<CoveredPlace> places;
  for (int i = 0; i < 40; ++i) {
    places.push_back({center + 3 * (uniform(i, 0) - 0.5F) * t + (uniform(i, 1) - 0.5F) * b +
                          0.1F * uniform(i, 2) * n,
                      0.02F + 0.02F * uniform(i, 3)});
  }
  for (const bool ellipse : {false, true}) {
    for (const double cutoff : {1.0, 3.0}) {
      const TangentGaussian g = covering_gaussian(center, n, places, ellipse, cutoff);
      EXPECT_NEAR(g.tangent.norm(), 1, 1e-5);
      EXPECT_NEAR(g.tangent.dot(n), 0, 1e-5);
      const Vec3f across = n.cross(g.tangent);
      double largest = 0;
      for (const CoveredPlace& place : places) {
        const Vec3f d = place.position - center;
        Vec2d flat(d.dot(g.tangent), d.dot(across));
        // The disc's point furthest from the middle.
        flat *= 1 + kPlaceReach * std::sqrt(place.area) / flat.norm();
        const double beta =
            0.5 * (flat.x() * flat.x() / g.variance_u + flat.y() * flat.y() / g.variance_v);
        EXPECT_LE(beta, cutoff * (1 + 1e-5));
        largest = std::max(largest, beta);
      }
      EXPECT_NEAR(largest, cutoff, 1e-4 * cutoff) << "it only just does";
      if (ellipse) {
        EXPECT_GT(g.variance_u, 3 * g.variance_v);
        EXPECT_GT(std::abs(g.tangent.dot(t)), 0.95F);
      } else {
        EXPECT_EQ(g.variance_u, g.variance_v);
      }
    }
  }
}

TEST(CoveringGaussian, OnePlaceIsItsOwnDisc) {
  const CoveredPlace place{Vec3f(1, 2, 3), 0.25F};
  for (const bool ellipse : {false, true}) {
    const TangentGaussian g =
        covering_gaussian(place.position, Vec3f::UnitZ(), {&place, 1}, ellipse, 2);
    EXPECT_NEAR(g.variance_u, kPlaceReach * kPlaceReach * 0.25 / 4, 1e-6);
    EXPECT_NEAR(g.variance_v, g.variance_u, 1e-6);
  }
}

TEST(CoveringGaussian, PlacesOnALineMakeNoNeedle) {
  std::vector<CoveredPlace> places;
  for (int i = -50; i <= 50; ++i) {
    places.push_back({Vec3f(static_cast<float>(i), 0, 0), 0.0F});
  }
  const TangentGaussian g = covering_gaussian(Vec3f(0, 0, 0), Vec3f::UnitZ(), places, true, 1);
  EXPECT_NEAR(g.variance_u, 50 * 50 / 2.0, 1);
  EXPECT_NEAR(g.variance_u / g.variance_v, 256, 0.1);
}

}  // namespace
}  // namespace surfel
