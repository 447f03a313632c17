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

}  // namespace
}  // namespace surfel
