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

/// An L of three tiles; its reflex corner is at (1, 1, 0).
TriangleMesh ell() { return tiles({{0, 0}, {1, 0}, {0, 1}}); }

/// A face of the L's tile that a place lies in.
std::uint32_t face_of_ell(const Vec3d& place) { return place.x() > 1 ? 2 : place.y() > 1 ? 4 : 0; }

/// Neither line of a reflex corner may cut off the surface beside the other one.
TEST(MeshClips, ReflexCornersLeaveWhatLiesWithinEitherLine) {
  const TriangleMesh mesh = ell();
  std::vector<Vec3d> first;
  for (const Vec3d& place :
       {Vec3d(0.95, 0.9, 0), Vec3d(0.9, 1.1, 0), Vec3d(1.1, 0.95, 0), Vec3d(0.9, 0.9, 0)}) {
    const MeshClips::Lines lines = lines_at(mesh, place, 0.3, face_of_ell(place));
    ASSERT_EQ(lines.count, 2) << place.transpose();
    EXPECT_TRUE(lines.either);
    EXPECT_NEAR(lines.line[0].direction.dot(lines.line[1].direction), 0, 1e-6);
    for (const HalfPlane& line : lines.line) {
      EXPECT_NEAR(line.direction.dot(Vec3d(1, 1, 0) - place), line.distance, 1e-6);
    }
    first.push_back(lines.line[0].direction);
  }
  for (const Vec3d& direction : first) EXPECT_LT((direction - first[0]).norm(), 1e-6);
  // The corner is out of reach, and one edge's line bounds the disc.
  EXPECT_EQ(lines_at(mesh, {1.5, 0.95, 0}, 0.3, 2).count, 1);
  EXPECT_FALSE(lines_at(mesh, {1.5, 0.95, 0}, 0.3, 2).either);
}

/// No edge of a tight curve follows a tangent for long, but all of the surface lies within it.
TEST(MeshClips, TightConvexCurvesCut) {
  TriangleMesh disc;
  constexpr int kSides = 24;
  disc.position.emplace_back(0.0F, 0.0F, 0.0F);
  for (int k = 0; k < kSides; ++k) {
    const double angle = 2 * M_PI * k / kSides;
    disc.position.emplace_back(static_cast<float>(std::cos(angle)),
                               static_cast<float>(std::sin(angle)), 0.0F);
  }
  for (std::uint32_t k = 0; k < kSides; ++k) {
    disc.face.push_back({0, 1 + k, 1 + (k + 1) % kSides});
  }
  const MeshClips::Lines lines = lines_at(disc, {0.9, 0.1, 0}, 0.95);
  ASSERT_GE(lines.count, 1);
  EXPECT_FALSE(lines.either);
  EXPECT_NEAR(lines.line[0].distance, 0.1, 0.03);
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

/// The mean sum of a cloud's kernels, with its lines, at places.
double mean_sum(const SurfelCloud& cloud, const std::vector<Vec3d>& places) {
  double sum = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const double v = cloud.variance[i];
    for (const Vec3d& p : places) {
      const Vec3d offset = p - cloud.position[i].cast<double>();
      const double r2 = offset.squaredNorm();
      const auto within = [&](int which) {
        const HalfPlane plane = half_plane(cloud, i, which);
        return plane.direction.dot(offset) <= plane.distance + 1e-9 || !plane.cuts();
      };
      if (r2 >= 4 * v || !within(0) || !within(1)) continue;
      sum += cloud.area[i] / (2 * M_PI * v) * std::exp(-r2 / (2 * v));
    }
  }
  return sum / static_cast<double>(places.size());
}

SurfelCloud clipped_samples(const TriangleMesh& mesh, MeshSampleReport& report) {
  MeshSampleOptions options;
  options.spacing = 0.05;
  options.clip = true;
  return sample_mesh(mesh, options, &report);
}

/// With the mirrored surfels the sums of kernels are the same at the border as inside.
TEST(MeshClips, MirroredSurfelsContinueTheSheet) {
  MeshSampleReport report;
  const SurfelCloud cloud = clipped_samples(tiles({{0, 0}}), report);
  ASSERT_GT(report.mirrored, 0U);
  std::size_t cut_off = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) cut_off += is_cut_off(cloud, i) ? 1 : 0;
  EXPECT_EQ(cut_off, report.mirrored);
  const auto sum_at = [&](double x) {
    std::vector<Vec3d> places;
    for (int k = 0; k < 200; ++k) places.emplace_back(x, 0.2 + 0.6 * k / 200, 0);
    return mean_sum(cloud, places);
  };
  EXPECT_NEAR(sum_at(1.0), sum_at(0.5), 0.08 * sum_at(0.5));
}

/// Around a reflex corner they are as inside too, and nothing is beyond it.
TEST(MeshClips, SumsAreEvenAroundAReflexCorner) {
  MeshSampleReport report;
  const SurfelCloud cloud = clipped_samples(ell(), report);
  const auto around = [](double from, double to) {
    std::vector<Vec3d> places;
    for (const double radius : {0.01, 0.02, 0.04, 0.06}) {
      for (int k = 0; k < 100; ++k) {
        const double angle = (from + (to - from) * k / 100) * M_PI / 180;
        places.emplace_back(1 + radius * std::cos(angle), 1 + radius * std::sin(angle), 0);
      }
    }
    return places;
  };
  std::vector<Vec3d> inside;
  for (int k = 0; k < 400; ++k) {
    inside.emplace_back(0.2 + 0.03 * (k % 20), 0.2 + 0.03 * (k / 20), 0);
  }
  EXPECT_NEAR(mean_sum(cloud, around(91, 359)), mean_sum(cloud, inside),
              0.08 * mean_sum(cloud, inside));
  EXPECT_EQ(mean_sum(cloud, around(1, 89)), 0);
}

}  // namespace
}  // namespace surfel
