#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/scene/clips.h>

namespace surfel {
namespace {

SurfelCloud one_surfel() {
  SurfelCloud cloud;
  cloud.position = {{1, 2, 3}};
  cloud.normal = {{0, 0, 1}};
  cloud.variance = {1};
  return cloud;
}

TEST(Clips, HalfPlanesAreUnitVectorsAcrossTheNormal) {
  SurfelCloud cloud = one_surfel();
  EXPECT_FALSE(half_plane(cloud, 0, 0).cuts());
  cloud.clip1 = {{3, 4, 5}};
  cloud.clip1_distance = {-0.25F};
  const HalfPlane plane = half_plane(cloud, 0, 0);
  EXPECT_LT((plane.direction - Vec3d(0.6, 0.8, 0)).norm(), 1e-12);
  EXPECT_EQ(plane.distance, -0.25);
  EXPECT_EQ(count_half_planes(cloud, 0), 1);
  EXPECT_TRUE(is_cut_off(cloud, 0));
}

TEST(Clips, WhatIsNoHalfPlaneCutsNothing) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const auto cuts = [](const Vec3f& direction, float distance, const Vec3f& normal) {
    SurfelCloud cloud = one_surfel();
    cloud.normal[0] = normal;
    cloud.clip1 = {direction};
    cloud.clip1_distance = {distance};
    return is_clipped(cloud, 0) || is_cut_off(cloud, 0);
  };
  const Vec3f up(0, 0, 1);
  EXPECT_TRUE(cuts({1, 0, 0}, -1, up));
  EXPECT_FALSE(cuts({0, 0, 0}, -1, up));
  EXPECT_FALSE(cuts({0, 0, 1}, -1, up));
  EXPECT_FALSE(cuts({nan, 0, 0}, -1, up));
  EXPECT_FALSE(cuts({1, 0, 0}, nan, up));
  EXPECT_FALSE(cuts({1, 0, 0}, -1, {0, 0, 0}));
}

CutSurfel near_a_corner() {
  return {{0.7, 0.9, 0},
          Vec3d(1, 1, 0).normalized(),
          {HalfPlane{{0, 1, 0}, 0.1}, HalfPlane{{1, 0, 0}, 0.3}}};
}

TEST(Clips, ImagesGoOnBeyondOneLineTheOtherAndBoth) {
  const std::vector<CutSurfel> images = mirror_images(near_a_corner(), {0.2, 0.2});
  ASSERT_EQ(images.size(), 3U);
  const Vec3d place[] = {{0.7, 1.1, 0}, {1.3, 0.9, 0}, {1.3, 1.1, 0}};
  for (std::size_t i = 0; i < 3; ++i) {
    const CutSurfel& image = images[i];
    EXPECT_LT((image.position - place[i]).norm(), 1e-12) << i;
    EXPECT_NEAR(std::abs(image.tangent.x() * image.tangent.y()), 0.5, 1e-12) << i;
    EXPECT_EQ(image.tangent.x() * image.tangent.y() < 0, i < 2) << i;
    // All end at the lines y = 1 and x = 1.
    for (const HalfPlane& plane : image.cut) {
      EXPECT_NEAR(plane.direction.dot(image.position) + plane.distance, 1, 1e-12) << i;
    }
  }
  // What a kernel hardly reaches has no image there.
  EXPECT_EQ(mirror_images(near_a_corner(), {0.2, 0.1}).size(), 1U);
  EXPECT_EQ(mirror_images(near_a_corner(), {0.01, 0.01}).size(), 0U);
}

TEST(Clips, ImagesOfImagesAreTheSurfels) {
  const CutSurfel surfel = near_a_corner();
  for (std::size_t k = 0; k < 2; ++k) {
    const CutSurfel back = mirror_image(mirror_image(surfel, k), k);
    EXPECT_LT((back.position - surfel.position).norm(), 1e-12);
    EXPECT_LT((back.tangent - surfel.tangent).norm(), 1e-12);
    for (std::size_t j = 0; j < 2; ++j) {
      EXPECT_NEAR(back.cut[j].distance, surfel.cut[j].distance, 1e-12);
    }
  }
}

/// What lies within a surfel's half-planes.
bool holds(const CutSurfel& surfel, const Vec3d& place) {
  return std::all_of(surfel.cut.begin(), surfel.cut.end(), [&](const HalfPlane& plane) {
    return !plane.cuts() || plane.direction.dot(place - surfel.position) <= plane.distance;
  });
}

/// At a reflex corner at the origin, of any turn and for surfels on any side of it.
TEST(Clips, PartsWithinEitherHalfPlaneAreThereOnce) {
  for (const double turn : {0.3, 0.9, M_PI / 2, 1.7}) {
    const Vec3d a(std::cos(0.4), std::sin(0.4), 0);
    const Vec3d b(std::cos(0.4 + turn), std::sin(0.4 + turn), 0);
    for (int k = 0; k < 12; ++k) {
      const Vec3d centre(0.3 * std::cos(0.1 + k * M_PI / 6), 0.3 * std::sin(0.1 + k * M_PI / 6), 0);
      if (a.dot(centre) > 0 && b.dot(centre) > 0) continue;  // No surface is there.
      const CutSurfel surfel{
          centre, {0, 0, 0}, {HalfPlane{a, -a.dot(centre)}, HalfPlane{b, -b.dot(centre)}}};
      const std::vector<CutSurfel> parts = within_either(surfel, 10);
      EXPECT_TRUE(holds(parts.front(), centre)) << turn << ' ' << k;
      for (int p = 0; p < 400; ++p) {
        const Vec3d place(0.1 * (p % 20) - 0.953, 0.1 * (p / 20) - 0.957, 0);
        const bool surface = a.dot(place) <= 0 || b.dot(place) <= 0;
        int own = 0;
        for (const CutSurfel& part : parts) {
          const bool image = part.position != centre;
          const bool here = holds(part, place);
          if (!image) own += here ? 1 : 0;
          if (!image) continue;
          EXPECT_TRUE(a.dot(part.position) > 0 && b.dot(part.position) > 0);
          EXPECT_TRUE(surface || !here);
        }
        EXPECT_EQ(own, surface ? 1 : 0) << turn << ' ' << k << ' ' << place.transpose();
      }
    }
  }
}

TEST(Clips, PartsThatAKernelHardlyReachesAreLeftOut) {
  const CutSurfel surfel{
      {-0.1, 0.8, 0}, {0, 0, 0}, {HalfPlane{{0, 1, 0}, -0.8}, HalfPlane{{1, 0, 0}, 0.1}}};
  // Its own part, within the second half-plane, and its image there.
  EXPECT_EQ(within_either(surfel, 0.1).size(), 2U);
  EXPECT_EQ(within_either(surfel, 1).size(), 3U);
}

}  // namespace
}  // namespace surfel
