#include <cmath>
#include <limits>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/sample/mesh_clips.h>
#include <surfel/sample/mesh_edges.h>
#include <surfel/sample/mesh_sampler.h>
#include <surfel/scene/clips.h>

namespace surfel {
namespace {

constexpr double kCrease = 0.7;

/// Squares in z = 0, named by their lower left corners, as one mesh.
TriangleMesh tiles(const std::vector<Vec2f>& corners) {
  TriangleMesh mesh;
  for (const Vec2f& c : corners) {
    const auto first = static_cast<std::uint32_t>(mesh.position.size());
    for (const Vec2f& step : {Vec2f(0, 0), Vec2f(1, 0), Vec2f(1, 1), Vec2f(0, 1)}) {
      mesh.position.emplace_back(c.x() + step.x(), c.y() + step.y(), 0.0F);
    }
    mesh.face.push_back({first, first + 1, first + 2});
    mesh.face.push_back({first, first + 2, first + 3});
  }
  return mesh;
}

MeshClips::Lines lines_at(const TriangleMesh& mesh, const Vec3d& place, double reach,
                          std::uint32_t face = 0) {
  return MeshClips(mesh, edge_rings(mesh), kCrease).around(face, place, Vec3d(0, 0, 1), reach);
}

TEST(MeshClips, BordersWithinReachCut) {
  const TriangleMesh square = tiles({{0, 0}});
  EXPECT_EQ(lines_at(square, {0.5, 0.5, 0}, 0.4).count, 0);
  const MeshClips::Lines one = lines_at(square, {0.9, 0.5, 0}, 0.3);
  ASSERT_EQ(one.count, 1);
  EXPECT_LT((one.line[0].direction - Vec3d(1, 0, 0)).norm(), 1e-6);
  EXPECT_NEAR(one.line[0].distance, 0.1, 1e-6);
  const MeshClips::Lines corner = lines_at(square, {0.9, 0.2, 0}, 0.3);
  ASSERT_EQ(corner.count, 2);
  EXPECT_NEAR(corner.line[0].distance, 0.1, 1e-6);
  EXPECT_LT((corner.line[1].direction - Vec3d(0, -1, 0)).norm(), 1e-6);
}

/// Coordinates of samples are of single precision: at an edge they lie on either side of it.
TEST(MeshClips, SamplesThatRoundingPutsBeyondAnEdgeAreCut) {
  const float x = 16.3F;
  TriangleMesh square = tiles({{x, 0}});
  const double edge = static_cast<double>(square.position[1].x());
  for (const double beyond : {-2e-6, 0.0, 2e-6}) {
    const MeshClips::Lines lines = lines_at(square, {edge + beyond, 0.5, 0}, 0.1);
    ASSERT_EQ(lines.count, 1) << beyond;
    EXPECT_NEAR(lines.line[0].distance, 0, 2.1e-6);
    EXPECT_GE(lines.line[0].distance, 0);
  }
}

/// Neither line of a reflex corner may cut off the surface beside the other one.
TEST(MeshClips, ReflexCornersAreCutByOneLine) {
  const TriangleMesh ell = tiles({{0, 0}, {1, 0}, {0, 1}});
  for (const Vec3d& place : {Vec3d(0.95, 0.9, 0), Vec3d(0.9, 1.1, 0), Vec3d(1.1, 0.95, 0)}) {
    const std::uint32_t face = place.x() > 1 ? 2 : place.y() > 1 ? 4 : 0;
    const MeshClips::Lines lines = lines_at(ell, place, 0.3, face);
    EXPECT_LE(lines.count, 1) << place.transpose();
    for (int i = 0; i < lines.count; ++i) EXPECT_GE(lines.line[0].distance, 0);
  }
}

/// A missing tile that is smaller than the disc is no border of it.
TEST(MeshClips, SmallHolesDoNotCut) {
  std::vector<Vec2f> corners;
  for (int y = -5; y <= 5; ++y) {
    for (int x = -5; x <= 5; ++x) {
      if (x != 0 || y != 0) corners.emplace_back(static_cast<float>(x), static_cast<float>(y));
    }
  }
  const TriangleMesh mesh = tiles(corners);
  std::uint32_t face = 0;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    if (corners[i] == Vec2f(1, 0)) face = static_cast<std::uint32_t>(2 * i);
  }
  EXPECT_EQ(lines_at(mesh, {1.2, 0.5, 0}, 3, face).count, 0);
  EXPECT_EQ(lines_at(mesh, {1.2, 0.5, 0}, 0.4, face).count, 1);
}

/// Two faces in z = 0 and x = 0 meet at a right angle along the y axis.
TEST(MeshClips, CreasesCutBothSides) {
  TriangleMesh mesh = tiles({{0, 0}});
  mesh.position.insert(mesh.position.end(), {{0, 0, 0}, {0, 1, 0}, {0, 1, -1}, {0, 0, -1}});
  mesh.face.push_back({4, 5, 6});
  mesh.face.push_back({4, 6, 7});
  const MeshClips clips(mesh, edge_rings(mesh), kCrease);
  const MeshClips::Lines top = clips.around(0, {0.1, 0.5, 0}, {0, 0, 1}, 0.3);
  ASSERT_EQ(top.count, 1);
  EXPECT_LT((top.line[0].direction - Vec3d(-1, 0, 0)).norm(), 1e-6);
  const MeshClips::Lines side = clips.around(2, {0, 0.5, -0.1}, {-1, 0, 0}, 0.3);
  ASSERT_EQ(side.count, 1);
  EXPECT_LT((side.line[0].direction - Vec3d(0, 0, 1)).norm(), 1e-6);
  // Faces that may meet at this angle go on in each other.
  EXPECT_EQ(MeshClips(mesh, edge_rings(mesh), 1.6).around(0, {0.1, 0.5, 0}, {0, 0, 1}, 0.3).count,
            0);
}

/// With the mirrored surfels the sums of kernels are the same at the border as inside.
TEST(MeshClips, MirroredSurfelsContinueTheSheet) {
  MeshSampleOptions options;
  options.spacing = 0.05;
  options.clip = true;
  MeshSampleReport report;
  const SurfelCloud cloud = sample_mesh(tiles({{0, 0}}), options, &report);
  ASSERT_GT(report.mirrored, 0U);
  std::size_t cut_off = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) cut_off += is_cut_off(cloud, i) ? 1 : 0;
  EXPECT_EQ(cut_off, report.mirrored);
  const auto mean_sum = [&](double x) {
    double sum = 0;
    constexpr int kPlaces = 200;
    for (int k = 0; k < kPlaces; ++k) {
      const Vec3d p(x, 0.2 + 0.6 * k / kPlaces, 0);
      for (std::size_t i = 0; i < cloud.size(); ++i) {
        const double r2 = (cloud.position[i].cast<double>() - p).squaredNorm();
        const double v = cloud.variance[i];
        if (r2 < 4 * v) sum += cloud.area[i] / (2 * M_PI * v) * std::exp(-r2 / (2 * v)) / kPlaces;
      }
    }
    return sum;
  };
  EXPECT_NEAR(mean_sum(1.0), mean_sum(0.5), 0.08 * mean_sum(0.5));
}

}  // namespace
}  // namespace surfel
