#include <gtest/gtest.h>
#include <surfel/measure/mesh_statistics.h>

namespace surfel {
namespace {

TriangleMesh tetrahedron() {
  TriangleMesh mesh;
  mesh.origin = Vec3d(100, 0, 0);
  mesh.position = {Vec3f(0, 0, 0), Vec3f(1, 0, 0), Vec3f(0, 1, 0), Vec3f(0, 0, 1)};
  mesh.face = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
  return mesh;
}

TEST(MeshStatistics, OfATetrahedron) {
  const MeshStatistics s = mesh_statistics(tetrahedron());
  EXPECT_EQ(s.vertices, 4U);
  EXPECT_EQ(s.faces, 4U);
  EXPECT_EQ(s.components, 1U);
  EXPECT_EQ(s.edges.border, 0U);
  EXPECT_EQ(s.edges.non_manifold, 0U);
  EXPECT_NEAR(s.area, 1.5 + std::sqrt(3.0) / 2, 1e-12);
  EXPECT_EQ(s.bounds.min, Vec3d(100, 0, 0));
  EXPECT_EQ(s.bounds.max, Vec3d(101, 1, 1));
}

TEST(MeshStatistics, CountsComponentsBordersAndNonManifoldEdges) {
  TriangleMesh mesh = tetrahedron();
  // A fin on edge 0-1, a triangle apart, and a vertex that no face uses.
  for (float y = 0; y < 5; ++y) mesh.position.emplace_back(5.0F, y, y * y);
  mesh.face.push_back({0, 1, 4});
  mesh.face.push_back({5, 6, 7});
  const MeshStatistics s = mesh_statistics(mesh);
  EXPECT_EQ(s.components, 2U);
  EXPECT_EQ(s.edges.border, 2U + 3U);
  EXPECT_EQ(s.edges.non_manifold, 1U);
}

}  // namespace
}  // namespace surfel
