// Simplification of surfels that end at lines.

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/parallel.h>
#include <surfel/sample/mesh_sampler.h>
#include <surfel/scene/clips.h>
#include <surfel/simplify/edges.h>
#include <surfel/simplify/simplify.h>

namespace surfel {
namespace {

/// The surface of [-1, 1]^3.
TriangleMesh cube() {
  TriangleMesh mesh;
  for (int i = 0; i < 8; ++i) {
    mesh.position.emplace_back(i & 1 ? 1.0F : -1.0F, i & 2 ? 1.0F : -1.0F, i & 4 ? 1.0F : -1.0F);
  }
  const std::uint32_t quads[][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4},
                                    {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
  for (const auto& q : quads) {
    mesh.face.push_back({q[0], q[1], q[2]});
    mesh.face.push_back({q[0], q[2], q[3]});
  }
  return mesh;
}

/// A plate of 3 x 3 without the square beyond (1, 1): a reflex corner.
TriangleMesh corner_plate() {
  TriangleMesh mesh;
  mesh.position = {{0, 0, 0}, {1, 0, 0}, {3, 0, 0}, {0, 1, 0},
                   {1, 1, 0}, {3, 1, 0}, {0, 3, 0}, {1, 3, 0}};
  mesh.face = {{0, 1, 4}, {0, 4, 3}, {1, 2, 5}, {1, 5, 4}, {3, 4, 7}, {3, 7, 6}};
  return mesh;
}

SurfelCloud sampled(const TriangleMesh& mesh, double spacing, bool clip = true) {
  MeshSampleOptions options;
  options.spacing = spacing;
  options.clip = clip;
  return sample_mesh(mesh, options);
}

SurfelCloud simplified(const SurfelCloud& cloud, std::size_t count,
                       SimplifyReport* report = nullptr) {
  SimplifyOptions options;
  options.count = count;
  return simplify_surfels(cloud, options, report);
}

std::size_t without_images(const SurfelCloud& cloud) {
  std::size_t count = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) count += is_cut_off(cloud, i) ? 0 : 1;
  return count;
}

/// Calls visit(place) at places of a surfel, as far as twice its deviation, that its half-planes
/// leave.
template <class Visit>
void visit_places(const SurfelCloud& cloud, std::size_t i, const Visit& visit) {
  const Vec3d n = cloud.normal[i].cast<double>();
  const Vec3d t = n.unitOrthogonal();
  const double reach = 2 * std::sqrt(cloud.variance[i]);
  for (int a = 0; a < 16; ++a) {
    for (const double r : {0.3, 0.6, 1.0}) {
      const double angle = 2 * M_PI * a / 16;
      const Vec3d d = r * reach * (std::cos(angle) * t + std::sin(angle) * n.cross(t));
      bool left = true;
      for (int k = 0; k < 2; ++k) {
        const HalfPlane plane = half_plane(cloud, i, k);
        left = left && !(plane.cuts() && plane.direction.dot(d) > plane.distance);
      }
      if (left) visit(cloud.position[i].cast<double>() + d);
    }
  }
}

/// How far a cube's surfels stick out of it at most.
double overhang(const SurfelCloud& cloud) {
  double most = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    visit_places(cloud, i,
                 [&](const Vec3d& p) { most = std::max(most, p.cwiseAbs().maxCoeff() - 1); });
  }
  return most;
}

/// Does a surfel of the face across `normal` reach a place with its kernel, cut off at beta = 1?
bool covered(const SurfelCloud& cloud, const Vec3f& normal, const Vec3d& place) {
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (cloud.normal[i].dot(normal) < 0.9F) continue;
    const Vec3d d = place - cloud.position[i].cast<double>();
    if (d.squaredNorm() > 2 * static_cast<double>(cloud.variance[i])) continue;
    bool left = true;
    for (int k = 0; k < 2; ++k) {
      const HalfPlane plane = half_plane(cloud, i, k);
      left = left && !(plane.cuts() && plane.direction.dot(d) > plane.distance + 1e-4);
    }
    if (left) return true;
  }
  return false;
}

TEST(SimplifyEdges, OfACubeStayWhereTheyAre) {
  const SurfelCloud cloud = sampled(cube(), 0.07);
  ASSERT_LT(overhang(cloud), 1e-5);
  const std::size_t count = without_images(cloud);
  for (const std::size_t fewer : {4U, 10U}) {
    SimplifyReport report;
    const SurfelCloud out = simplified(cloud, count / fewer, &report);
    EXPECT_EQ(report.result, count / fewer);
    EXPECT_EQ(report.result, without_images(out));
    EXPECT_EQ(report.result + report.mirrored, out.size());
    EXPECT_GT(report.mirrored, 0U);
    EXPECT_LT(overhang(out), 1e-5) << fewer;
    // Up to the edges there are no holes.
    for (int i = 0; i <= 20; ++i) {
      for (const double y : {-1.0, -0.95, 0.0, 1.0}) {
        EXPECT_TRUE(covered(out, Vec3f(0, 0, 1), Vec3d(i / 10.0 - 1, y, 1))) << i << ' ' << y;
      }
    }
  }
  // The lines do it: without them large discs stick out.
  SurfelCloud without = sampled(cube(), 0.07, false);
  EXPECT_GT(overhang(simplified(without, count / 10)), 0.1);
}

TEST(SimplifyEdges, OfScansWithoutMirrorImagesStayToo) {
  SurfelCloud cloud = sampled(cube(), 0.07);
  Array<std::uint32_t> order;
  for (std::uint32_t i = 0; i < cloud.size(); ++i) {
    if (!is_cut_off(cloud, i)) order.push_back(i);
  }
  SimplifyReport report;
  const SurfelCloud out = simplified(cloud.gathered(order), order.size() / 8, &report);
  EXPECT_EQ(report.mirrored, 0U);
  EXPECT_EQ(out.size(), order.size() / 8);
  EXPECT_LT(overhang(out), 1e-5);
}

TEST(SimplifyEdges, AtAReflexCornerNothingSticksOutFurtherThanBefore) {
  const SurfelCloud cloud = sampled(corner_plate(), 0.05);
  const auto beyond = [](const SurfelCloud& c) {
    double most = 0;
    for (std::size_t i = 0; i < c.size(); ++i) {
      visit_places(c, i, [&](const Vec3d& p) {
        most = std::max({most, std::min(p.x(), p.y()) - 1, -p.x(), -p.y(), p.maxCoeff() - 3});
      });
    }
    return most;
  };
  const std::size_t count = without_images(cloud);
  EXPECT_LT(beyond(cloud), 0.1);
  EXPECT_LT(beyond(simplified(cloud, count / 4)), 0.1);
  EXPECT_LT(beyond(simplified(cloud, count / 10)), 0.15);
}

TEST(SimplifyEdges, UnmergedSurfelsKeepTheirLines) {
  const SurfelCloud cloud = sampled(cube(), 0.1);
  SimplifyReport report;
  const SurfelCloud out = simplified(cloud, without_images(cloud) - 60, &report);
  std::size_t same = 0;
  for (std::size_t i = 0; i < out.size(); ++i) {
    const auto at = std::find(cloud.position.begin(), cloud.position.end(), out.position[i]);
    if (at == cloud.position.end()) continue;
    const auto k = static_cast<std::size_t>(at - cloud.position.begin());
    if (out.variance[i] != cloud.variance[k]) continue;
    ++same;
    EXPECT_EQ(out.normal[i], cloud.normal[k]);
    EXPECT_LT((out.clip1[i] - cloud.clip1[k]).norm(), 1e-6F);
    EXPECT_NEAR(out.clip1_distance[i], cloud.clip1_distance[k], 1e-6F);
    EXPECT_LT((out.clip2[i] - cloud.clip2[k]).norm(), 1e-6F);
    EXPECT_NEAR(out.clip2_distance[i], cloud.clip2_distance[k], 1e-6F);
  }
  EXPECT_GT(same, out.size() / 2);
}

TEST(SimplifyEdges, WhatIsNotSimplifiedKeepsItsImages) {
  const SurfelCloud cloud = sampled(cube(), 0.1);
  SimplifyReport report;
  const std::size_t count = without_images(cloud);
  EXPECT_EQ(simplified(cloud, count, &report).size(), cloud.size());
  EXPECT_EQ(report.result, count);
  EXPECT_EQ(report.mirrored, cloud.size() - count);
}

TEST(SimplifyEdges, DoNotDependOnThreads) {
  SurfelCloud cloud = sampled(cube(), 0.08);
  for (const Vec3f& p : cloud.position) {
    cloud.color.push_back(Vec3f::Constant(p.x() > 0.2F ? 0.9F : 0.1F));
  }
  set_thread_count(1);
  const SurfelCloud one = simplified(cloud, 500);
  set_thread_count(3);
  const SurfelCloud three = simplified(cloud, 500);
  set_thread_count(0);
  EXPECT_EQ(one.position, three.position);
  EXPECT_EQ(one.clip1, three.clip1);
  EXPECT_EQ(one.clip1_distance, three.clip1_distance);
  EXPECT_EQ(one.clip2, three.clip2);
  EXPECT_EQ(one.clip2_distance, three.clip2_distance);
  EXPECT_EQ(one.coefficient, three.coefficient);
  EXPECT_EQ(one.area, three.area);
}

/// Surfels along the x axis, 1 apart, in z = 0, that no line cuts.
std::vector<LinedSurfel> row(int count) {
  std::vector<LinedSurfel> surfels;
  for (int i = 0; i < count; ++i) {
    surfels.push_back(
        {{static_cast<float>(i), 0, 0}, 1, {CutLine{{0, 0, 0}, 0}, CutLine{{0, 0, 0}, 0}}, false});
  }
  return surfels;
}

TEST(ClusterEdges, NeitherALineOfAMemberNorAWallIsPassed) {
  std::vector<LinedSurfel> surfels = row(6);
  surfels[2].lines[0] = {{1, 0, 0}, 2.4F};
  ClusterEdges edges;
  edges.start(surfels, 0, {0, 0, 1});
  EXPECT_TRUE(edges.admits(1));
  EXPECT_TRUE(edges.admits(3)) << "its line is not known yet";
  EXPECT_TRUE(edges.admits(2));
  edges.add_member(2);
  EXPECT_FALSE(edges.admits(3));
  edges.start(surfels, 0, {0, 0, 1});
  edges.add_wall(2);
  EXPECT_FALSE(edges.admits(3));
  // A wall ends, where a line does not.
  surfels[3].position.y() = 40;
  EXPECT_TRUE(edges.admits(3));
  edges.start(surfels, 2, {0, 0, 1});
  EXPECT_FALSE(edges.admits(3));
}

TEST(ClusterEdges, MembersEndAtTwoLinesAtMostWhichLeaveAllMembers) {
  std::vector<LinedSurfel> surfels = row(6);
  surfels[1].lines[0] = {{0, 1, 0}, 1};
  surfels[2].lines[0] = {{0, -1, 0}, 1};
  surfels[3].lines[0] = {{1, 0, 0}, 3.5F};
  surfels[4].lines[0] = {{-1, 0, 0}, -3.5F};  // Nothing is left at x < 3.5.
  ClusterEdges edges;
  edges.start(surfels, 0, {0, 0, 1});
  EXPECT_FALSE(edges.admits(4));
  for (const std::uint32_t i : {1U, 2U}) {
    EXPECT_TRUE(edges.admits(i));
    edges.add_member(i);
  }
  EXPECT_FALSE(edges.admits(3));
  surfels[5].lines[0] = {{0, 1, 0}, 1.1F};
  EXPECT_TRUE(edges.admits(5)) << "nearly the line of surfel 1";
}

}  // namespace
}  // namespace surfel
