#include <Eigen/Geometry>
#include <numeric>

#include <gtest/gtest.h>
#include <surfel/base/random.h>
#include <surfel/lod/surfel_merge.h>

#include "lod/merge_surfels.h"

namespace surfel::test {
namespace {

double uniform(std::uint64_t i, std::uint64_t dimension) { return random_uniform(3, i, dimension); }

/// Surfels of random size, colour and opacity in a plane, far from the origin.
SurfelCloud random_plane(int count, const Vec3f& normal, const Vec3f& at) {
  SurfelCloud cloud;
  const Vec3f n = normal.normalized();
  const Vec3f t = n.unitOrthogonal();
  const Vec3f b = n.cross(t);
  for (int i = 0; i < count; ++i) {
    const auto r = [&](int k) { return static_cast<float>(uniform(i, k)); };
    cloud.position.push_back(at + r(0) * t + r(1) * b);
    cloud.normal.push_back(n);
    cloud.tangent.push_back((std::cos(6 * r(2)) * t + std::sin(6 * r(2)) * b));
    cloud.variance_u.push_back(0.01F + r(3));
    cloud.variance_v.push_back(0.01F + r(4));
    cloud.area.push_back(0.1F + r(5));
    cloud.coefficient.push_back({r(6), r(7), r(8)});
    cloud.color.push_back({r(8), r(6), r(7)});
    cloud.alpha.push_back(r(9));
  }
  return cloud;
}

MergeSurfel merged_all(const std::vector<MergeSurfel>& surfels) {
  std::vector<std::uint32_t> members(surfels.size());
  std::iota(members.begin(), members.end(), 0U);
  return merged(surfels, members);
}

TEST(SurfelMerge, KeepsAreaColourAndOpacity) {
  const SurfelCloud cloud = random_plane(7, {1, 2, -3}, {5, -4, 2});
  const MergeSurfel m = merged_all(merge_surfels(cloud));
  double area = 0;
  double opacity = 0;
  Vec3d light(0, 0, 0);
  Vec3d other(0, 0, 0);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const double w = static_cast<double>(cloud.area[i]) * cloud.alpha[i];
    area += cloud.area[i];
    opacity += w;
    light += w * cloud.coefficient[i].cast<double>();
    other += w * cloud.color[i].cast<double>();
  }
  EXPECT_NEAR(m.area, area, 1e-5);
  EXPECT_NEAR(m.area * m.alpha, opacity, 1e-5);
  EXPECT_LT((m.area * m.alpha * m.coefficient.cast<double>() - light).norm(), 1e-5);
  EXPECT_LT((m.area * m.alpha * m.color.cast<double>() - other).norm(), 1e-5);
  EXPECT_LT((m.normal - cloud.normal[0]).norm(), 1e-6F);
}

/// Mean and covariance of a mixture of Gaussians, by its definition: E[x x^T] - mean mean^T.
TEST(SurfelMerge, HasTheMomentsOfTheMixture) {
  const SurfelCloud cloud = random_plane(9, {0, 0, 1}, {0, 0, 0});
  const MergeSurfel m = merged_all(merge_surfels(cloud));
  double area = 0;
  Vec3d mean(0, 0, 0);
  Eigen::Matrix3d second = Eigen::Matrix3d::Zero();
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const double w = cloud.area[i];
    const Vec3d p = cloud.position[i].cast<double>();
    const Vec3d t = cloud.tangent[i].cast<double>();
    const Vec3d b = cloud.normal[i].cast<double>().cross(t);
    area += w;
    mean += w * p;
    second += w * (cloud.variance_u[i] * t * t.transpose() +
                   cloud.variance_v[i] * b * b.transpose() + p * p.transpose());
  }
  mean /= area;
  const Eigen::Matrix3d covariance = second / area - mean * mean.transpose();
  EXPECT_LT((m.position.cast<double>() - mean).norm(), 1e-6);
  EXPECT_NEAR(m.covariance[0], covariance(0, 0), 1e-5);
  EXPECT_NEAR(m.covariance[1], covariance(0, 1), 1e-5);
  EXPECT_NEAR(m.covariance[3], covariance(1, 1), 1e-5);

  const TangentGaussian g = tangent_gaussian(m.covariance, m.normal);
  const Vec3d t = g.tangent.cast<double>();
  const Vec3d b = m.normal.cast<double>().cross(t);
  EXPECT_GE(g.variance_u, g.variance_v);
  EXPECT_NEAR(g.variance_u, t.dot(covariance * t), 1e-5);
  EXPECT_NEAR(g.variance_v, b.dot(covariance * b), 1e-5);
  EXPECT_NEAR(t.dot(covariance * b), 0, 1e-5);  // principal axes
  EXPECT_NEAR(t.dot(m.normal.cast<double>()), 0, 1e-6);
}

TEST(SurfelMerge, ShadingNormalsKeepTheirMeanAndLoseLength) {
  SurfelCloud cloud = random_plane(3, {0, 0, 1}, {0, 0, 0});
  cloud.area = {1, 2, 1};
  // The last surfel has none: its normal counts.
  cloud.shading_normal = {Vec3f(0.6F, 0, 0.8F), Vec3f(-0.3F, 0, 0.4F), Vec3f(0, 0, 0)};
  const MergeSurfel m = merged_all(merge_surfels(cloud));
  EXPECT_LT((m.shading_normal - Vec3f(0, 0, 0.65F)).norm(), 1e-6F);
  SurfelCloud out = cloud;
  write_attributes(out, 1, m);
  EXPECT_EQ(out.shading_normal[1], m.shading_normal);
}

TEST(SurfelMerge, InStepsIsTheSameAsAtOnce) {
  const std::vector<MergeSurfel> all = merge_surfels(random_plane(12, {3, -1, 2}, {9, 9, 9}));
  std::vector<MergeSurfel> parts;
  for (std::uint32_t first = 0; first < all.size(); first += 4) {
    const std::uint32_t members[] = {first, first + 1, first + 2, first + 3};
    parts.push_back(merged(all, members));
  }
  const MergeSurfel once = merged_all(all);
  const MergeSurfel twice = merged_all(parts);
  EXPECT_LT((once.position - twice.position).norm(), 1e-5F);
  EXPECT_NEAR(once.area, twice.area, 1e-5);
  EXPECT_NEAR(once.alpha, twice.alpha, 1e-5);
  EXPECT_LT((once.coefficient - twice.coefficient).norm(), 1e-5F);
  for (std::size_t k = 0; k < once.covariance.size(); ++k) {
    EXPECT_NEAR(once.covariance[k], twice.covariance[k], 1e-5) << k;
  }
}

TEST(SurfelMerge, RoughSurfaceKeepsItsAreaInProjection) {
  // Two slopes of 45 degrees: seen from above they cover cos 45 of their area.
  SurfelCloud cloud;
  for (const float side : {-1.0F, 1.0F}) {
    cloud.position.push_back({side, 0, 0});
    cloud.normal.push_back(Vec3f(side, 0, 1).normalized());
    cloud.variance.push_back(1);
    cloud.area.push_back(2);
  }
  const MergeSurfel m = merged_all(merge_surfels(cloud));
  EXPECT_LT((m.normal - Vec3f::UnitZ()).norm(), 1e-6F);
  EXPECT_NEAR(m.area, 4 * std::sqrt(0.5), 1e-5);
  // No more than half is lost, and where normals cancel there is a normal still.
  cloud.normal = {Vec3f(0, 0, 1), Vec3f(0, 0, -1)};
  const MergeSurfel cancelled = merged_all(merge_surfels(cloud));
  EXPECT_EQ(cancelled.normal, Vec3f::UnitZ());
  EXPECT_NEAR(cancelled.area, 2, 1e-5);
}

TEST(SurfelMerge, KeepsLinesThatCutAllMembers) {
  SurfelCloud cloud = random_plane(3, {0, 0, 1}, {0, 0, 0});
  cloud.position = {{0, 0, 0}, {0.3F, 0.2F, 0}, {1.5F, 0, 0}};
  // The line x = 1 cuts all, y = 0.5 the first alone; the last one continues the others.
  cloud.clip1 = {{1, 0, 0}, {0, 1, 0}, {1, 0, 0}};
  cloud.clip1_distance = {1, 5, -0.5F};
  cloud.clip2 = {{0, 1, 0}, {1, 0, 0}, {0, 0, 0}};
  cloud.clip2_distance = {0.5F, 0.7F, 0};
  const MergeSurfel m = merged_all(merge_surfels(cloud));
  EXPECT_LT(m.position.x(), 0.3F);
  EXPECT_NEAR(m.area, cloud.area[0] + cloud.area[1], 1e-5);
  SurfelCloud out = cloud;
  write_attributes(out, 0, m);
  int lines = 0;
  for (const auto& [direction, distance] : {std::pair(out.clip1[0], out.clip1_distance[0]),
                                            std::pair(out.clip2[0], out.clip2_distance[0])}) {
    if (direction.isZero()) continue;
    ++lines;
    EXPECT_EQ(direction, Vec3f(1, 0, 0));
    EXPECT_NEAR(out.position[0].x() + distance, 1, 1e-6);
  }
  EXPECT_EQ(lines, 1);
}

TEST(SurfelMerge, UnknownNormalsStayUnknown) {
  SurfelCloud cloud;
  for (int i = 0; i < 4; ++i) {
    cloud.position.push_back({static_cast<float>(i % 2), static_cast<float>(i / 2), 0});
    cloud.variance.push_back(0.25F);
  }
  const MergeSurfel m = merged_all(merge_surfels(cloud));
  EXPECT_TRUE(m.normal.isZero());
  EXPECT_EQ(m.area, 1);
  const TangentGaussian g = tangent_gaussian(m.covariance, m.normal);
  EXPECT_NEAR(g.variance_u, 0.5, 1e-6);  // 1/4 within, 1/4 between
  EXPECT_EQ(g.variance_u, g.variance_v);
}

TEST(SurfelMerge, MaterialIsThatOfMostArea) {
  SurfelCloud cloud = random_plane(5, {0, 0, 1}, {0, 0, 0});
  cloud.area = {1, 1, 1, 1, 5};
  cloud.material = {7, 7, 7, 7, 2};
  EXPECT_EQ(merged_all(merge_surfels(cloud)).material, 2);
  cloud.area[4] = 4;
  EXPECT_EQ(merged_all(merge_surfels(cloud)).material, 2);  // a tie: the smaller number
  cloud.area[4] = 3.5F;
  EXPECT_EQ(merged_all(merge_surfels(cloud)).material, 7);
}

TEST(SurfelMerge, SurfelsWithoutAreaOrOpacityGiveNumbers) {
  SurfelCloud cloud = random_plane(3, {0, 1, 0}, {0, 0, 0});
  cloud.area = {0, 0, 0};
  cloud.alpha = {0, 0, 0};
  const MergeSurfel m = merged_all(merge_surfels(cloud));
  EXPECT_EQ(m.area, 0);
  EXPECT_EQ(m.alpha, 0);
  const Vec3f mean = (cloud.position[0] + cloud.position[1] + cloud.position[2]) / 3;
  EXPECT_LT((m.position - mean).norm(), 1e-6F);
  EXPECT_TRUE(m.color.allFinite());
}

}  // namespace
}  // namespace surfel::test
