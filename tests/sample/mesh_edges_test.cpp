#include <cmath>

#include <gtest/gtest.h>
#include <surfel/sample/mesh_edges.h>

#include "sample/test_meshes.h"

namespace surfel {
namespace {

using namespace test;

TEST(EdgeRings, LinkFacesOfWeldedVertices) {
  const Array<std::uint32_t> rings = edge_rings(box(Vec3f(1, 1, 1)));
  for (std::uint32_t e = 0; e < rings.size(); ++e) {
    ASSERT_NE(rings[e], kBorderEdge);
    EXPECT_EQ(rings[rings[e]], e);
    EXPECT_NE(rings[e], e);
  }
  TriangleMesh fan;
  for (const float angle : {0.0f, 2.0f, 4.0f}) {
    add_triangle(fan, Vec3f(0, -0.0f, 0), Vec3f(0, 0, 1),
                 Vec3f(std::cos(angle), std::sin(angle), 0));
  }
  const Array<std::uint32_t> ring = edge_rings(fan);
  EXPECT_EQ(ring[0], 3u);
  EXPECT_EQ(ring[3], 6u);
  EXPECT_EQ(ring[6], 0u);
  EXPECT_EQ(ring[1], kBorderEdge);
  const Array<std::uint32_t> parts = face_components(ring);
  EXPECT_EQ(parts[2], 0u);
}

TEST(EdgeRings, OfTooManyFacesAreCutIntoBorders) {
  TriangleMesh fan = box(Vec3f(1, 1, 1));
  const std::size_t of_box = 3 * fan.face.size();
  for (int k = 0; k < 5; ++k) {
    const float angle = 1.2F * static_cast<float>(k);
    add_triangle(fan, Vec3f(9, 0, 0), Vec3f(9, 0, 1),
                 Vec3f(9 + std::cos(angle), std::sin(angle), 0));
  }
  const Array<std::uint32_t> rings = edge_rings(fan);
  Array<std::uint32_t> cut = rings;
  cut_crowded_edges(cut, 5);
  EXPECT_TRUE(cut == rings);
  cut_crowded_edges(cut, 4);
  for (std::size_t e = 0; e < cut.size(); ++e) {
    EXPECT_EQ(cut[e], e < of_box ? rings[e] : kBorderEdge) << e;
  }
}

TEST(RepeatedFaces, HaveTheSameCornersInTheSameDirection) {
  const Vec3f a(0, 0, 0), b(1, 0, 0), c(0, 1, 0), d(0, 0, 1);
  TriangleMesh mesh;
  add_triangle(mesh, a, b, c);
  add_triangle(mesh, b, c, a);  // Repeats face 0.
  add_triangle(mesh, c, b, a);  // Its other side.
  add_triangle(mesh, a, b, d);
  add_triangle(mesh, c, a, b);  // Repeats face 0.
  add_triangle(mesh, b, a, c);  // Repeats face 2.
  add_triangle(mesh, a, a, d);
  add_triangle(mesh, a, a, d);
  EXPECT_TRUE(repeated_faces(welded_faces(mesh)) == (Array<std::uint32_t>{1, 4, 5}));
}

TEST(EdgeCounts, OfAnOpenBoxWithAFinAndATurnedFace) {
  TriangleMesh mesh = box(Vec3f(1, 1, 2));
  const EdgeCounts closed = count_edges(mesh, edge_rings(mesh));
  EXPECT_EQ(closed.border + closed.non_manifold + closed.inconsistent, 0U);
  mesh.face.erase(mesh.face.begin(), mesh.face.begin() + 2);  // The face z = 0.
  std::swap(mesh.face[0][1], mesh.face[0][2]);                // Half of the face z = 2.
  add_triangle(mesh, Vec3f(0, 0, 0), Vec3f(0, 0, 2), Vec3f(-3, 0, 2));
  const EdgeCounts counts = count_edges(mesh, edge_rings(mesh));
  EXPECT_EQ(counts.border, 4U + 2U);
  EXPECT_NEAR(counts.border_length, 4 + 3 + std::sqrt(13.0), 1e-6);
  EXPECT_EQ(counts.non_manifold, 1U);
  EXPECT_EQ(counts.inconsistent, 3U);
}

}  // namespace
}  // namespace surfel
