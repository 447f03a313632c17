// Meshes by their half-edges: closed forms, real files, and a mesh that is cut and put together.

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <set>

#include <gtest/gtest.h>
#include <surfel/io/mesh_io.h>
#include <surfel/measure/mesh_statistics.h>
#include <surfel/measure/mesh_topology.h>
#include <surfel/sample/mesh_clips.h>
#include <surfel/sample/mesh_edges.h>

#include "sample/test_meshes.h"
#include "support/test_data.h"

namespace surfel {
namespace {

using namespace test;

TriangleMesh cube() { return box(Vec3f(1, 1, 1)); }

/// A strip of quads around the z axis, twisted by half turns on its way.
TriangleMesh band(int quads, int half_turns) {
  TriangleMesh mesh;
  const auto corner = [&](int i, float side) {
    const float turn = static_cast<float>(i) / static_cast<float>(quads);
    // The last corners are the first ones, exchanged by an odd number of half turns.
    if (i == quads) side = half_turns % 2 == 0 ? side : -side;
    const float around = 2 * std::numbers::pi_v<float> * (i == quads ? 0 : turn);
    const float twist = std::numbers::pi_v<float> * static_cast<float>(half_turns) * turn;
    const Vec3f out(std::cos(around), std::sin(around), 0);
    if (i == quads) return Vec3f(out + side * Vec3f(0, 0, 0.25f));
    return Vec3f(out + side * 0.25f * (std::cos(twist) * Vec3f(0, 0, 1) + std::sin(twist) * out));
  };
  for (int i = 0; i < quads; ++i) {
    add_quad(mesh, corner(i, -1), corner(i + 1, -1), corner(i + 1, 1), corner(i, 1));
  }
  return mesh;
}

TEST(MeshTopology, CubeHasTwelveCreases) {
  TriangleMesh mesh = cube();
  mesh.origin = Vec3d(1e7, -1e7, 0);
  const MeshTopology t = mesh_topology(mesh);
  EXPECT_EQ(t.crease_edges, 12U);
  EXPECT_NEAR(t.crease_length, 12, 1e-12);
  EXPECT_EQ(t.components, 1U);
  EXPECT_EQ(t.border_loops, 0U);
  EXPECT_EQ(t.euler_characteristic, 2);
  EXPECT_EQ(t.genus, 0);
  EXPECT_EQ(t.turned_faces + t.split_vertices + t.left_out_faces, 0U);
  EXPECT_EQ(mesh_topology(mesh, 1.6).crease_edges, 0U);
}

TEST(MeshTopology, OpenCylinderHasTwoBorders) {
  const TriangleMesh mesh = band(16, 0);
  const MeshTopology t = mesh_topology(mesh);
  const double side = 2 * std::sin(std::numbers::pi / 16);
  EXPECT_EQ(t.border_loops, 2U);
  EXPECT_NEAR(t.longest_border, 16 * side, 1e-5);
  EXPECT_NEAR(mesh_statistics(mesh).edges.border_length, 32 * side, 1e-5);
  EXPECT_EQ(t.crease_edges, 0U);
  EXPECT_EQ(mesh_topology(mesh, 0.38).crease_edges, 16U);  // 2 pi / 16 is 0.3927.
  EXPECT_EQ(t.euler_characteristic, 0);
  EXPECT_FALSE(t.genus);
}

TEST(MeshTopology, MoebiusStripHasOneBorderAndNoOrientation) {
  const TriangleMesh mesh = band(24, 1);
  const MeshTopology t = mesh_topology(mesh);
  EXPECT_EQ(t.non_orientable_components, 1U);
  EXPECT_EQ(t.border_loops, 1U);
  EXPECT_NEAR(t.longest_border, mesh_statistics(mesh).edges.border_length, 1e-5);
  EXPECT_EQ(mesh_statistics(mesh).edges.inconsistent, 1U);
  EXPECT_EQ(t.turned_faces, 0U);
  EXPECT_EQ(t.split_vertices, 2U);
  EXPECT_EQ(mesh_topology(band(24, 2)).non_orientable_components, 0U);
}

TEST(MeshTopology, CubesThatShareAnEdgeBecomeTwo) {
  TriangleMesh mesh = cube();
  mesh.origin = Vec3d(10, 0, 0);
  test::append(mesh, cube(), 1, Vec3f(1, 1, 0));
  const MeshStatistics s = mesh_statistics(mesh);
  EXPECT_EQ(s.edges.non_manifold, 1U);
  EXPECT_EQ(s.edges.border, 0U);
  EXPECT_EQ(s.components, 1U);
  const MeshTopology t = mesh_topology(mesh);
  ASSERT_EQ(t.non_manifold_places.size(), 1U);
  EXPECT_EQ(t.non_manifold_places[0], Vec3d(11, 1, 0.5));
  EXPECT_EQ(t.non_manifold_vertices, 0U);
  EXPECT_EQ(t.split_vertices, 2U);
  EXPECT_EQ(t.components, 2U);
  EXPECT_EQ(t.genus, 0);
  EXPECT_EQ(t.crease_edges, 24U);
}

TEST(MeshTopology, FinLeavesTheCubeClosed) {
  TriangleMesh mesh = cube();
  add_triangle(mesh, Vec3f(0, 0, 0), Vec3f(1, 0, 0), Vec3f(0.5f, -1, -1));
  const MeshTopology t = mesh_topology(mesh);
  EXPECT_EQ(mesh_statistics(mesh).edges.non_manifold, 1U);
  EXPECT_EQ(t.components, 2U);
  EXPECT_EQ(t.border_loops, 1U);
  EXPECT_NEAR(t.longest_border, 2 * std::sqrt(2.25), 1e-6);  // Without the edge on the cube.
  EXPECT_EQ(t.crease_edges, 12U);
}

TEST(MeshTopology, BowTieHasOneVertexTooFew) {
  TriangleMesh mesh;
  add_triangle(mesh, Vec3f(0, 0, 0), Vec3f(1, 0, 0), Vec3f(1, 1, 0));
  add_triangle(mesh, Vec3f(0, 0, 0), Vec3f(-1, 0, 0), Vec3f(-1, -1, 0));
  const MeshTopology t = mesh_topology(mesh);
  EXPECT_EQ(t.non_manifold_vertices, 1U);
  ASSERT_EQ(t.non_manifold_places.size(), 1U);
  EXPECT_EQ(t.non_manifold_places[0], Vec3d(0, 0, 0));
  EXPECT_EQ(t.split_vertices, 1U);
  EXPECT_EQ(t.border_loops, 2U);
  // Closed sheets that touch.
  TriangleMesh cubes = cube();
  test::append(cubes, cube(), 1, Vec3f(1, 1, 1));
  EXPECT_EQ(mesh_topology(cubes).non_manifold_vertices, 1U);
  EXPECT_EQ(mesh_topology(cubes).euler_characteristic, 4);
}

TEST(MeshTopology, TurnsTheLesserNumberOfFaces) {
  TriangleMesh mesh = cube();
  std::swap(mesh.face[5][0], mesh.face[5][1]);
  EXPECT_EQ(mesh_statistics(mesh).edges.inconsistent, 3U);
  EXPECT_EQ(mesh_topology(mesh).turned_faces, 1U);
  EXPECT_EQ(mesh_topology(mesh).genus, 0);
  EXPECT_EQ(mesh_topology(mesh).crease_edges, 12U);
  for (auto& face : mesh.face) std::swap(face[0], face[1]);
  EXPECT_EQ(mesh_topology(mesh).turned_faces, 1U);
}

TEST(MeshTopology, LeavesOutFacesWithoutThreePlaces) {
  TriangleMesh mesh = cube();
  mesh.face.push_back({mesh.face[0][0], mesh.face[0][1], mesh.face[0][0]});
  const float nan = std::numeric_limits<float>::quiet_NaN();
  add_triangle(mesh, Vec3f(nan, nan, nan), Vec3f(1, 0, 0), Vec3f(0, 1, 0));
  const MeshTopology t = mesh_topology(mesh);
  EXPECT_EQ(t.left_out_faces, 2U);
  EXPECT_EQ(t.genus, 0);
  EXPECT_EQ(mesh_topology(TriangleMesh{}).components, 0U);
  EXPECT_FALSE(mesh_topology(TriangleMesh{}).genus);
  // A face on a line lies between two others without making a crease.
  TriangleMesh line;
  add_triangle(line, Vec3f(0, 0, 0), Vec3f(2, 0, 0), Vec3f(1, 1, 0));
  add_triangle(line, Vec3f(0, 0, 0), Vec3f(1, 0, 0), Vec3f(2, 0, 0));
  EXPECT_EQ(mesh_topology(line).crease_edges, 0U);
  EXPECT_EQ(mesh_topology(line).components, 1U);
}

TEST(MeshTopology, CountsHandles) {
  // A ring of eight cubes without the faces between them, of square cross-section: a torus.
  TriangleMesh mesh;
  const auto at = [&](int i, float radius, float height) {
    const float a = 2 * std::numbers::pi_v<float> * static_cast<float>(i % 8) / 8;
    return Vec3f(radius * std::cos(a), radius * std::sin(a), height);
  };
  const float section[4][2] = {{2, 0}, {2, 1}, {1, 1}, {1, 0}};
  for (int i = 0; i < 8; ++i) {
    for (int k = 0; k < 4; ++k) {
      const auto& a = section[k];
      const auto& b = section[(k + 1) % 4];
      add_quad(mesh, at(i, a[0], a[1]), at(i + 1, a[0], a[1]), at(i + 1, b[0], b[1]),
               at(i, b[0], b[1]));
    }
  }
  EXPECT_EQ(mesh_topology(mesh).genus, 1);
  test::append(mesh, TriangleMesh(mesh), 1, Vec3f(10, 0, 0));
  EXPECT_EQ(mesh_topology(mesh).genus, 2);
  EXPECT_EQ(mesh_topology(mesh).components, 2U);
}

TEST(MeshTopology, OfRealMeshes) {
  SURFEL_REQUIRE_TEST_DATA();
  const auto load = [](const char* file) { return read_mesh(data_folder() / file); };
  for (const char* file :
       {"meshes/stanford_bunny.obj", "meshes/fandisk.obj", "textured/scissors/scissors.obj"}) {
    const TriangleMesh mesh = load(file);
    const MeshStatistics s = mesh_statistics(mesh);
    const MeshTopology t = mesh_topology(mesh);
    EXPECT_EQ(t.components, 1U) << file;
    EXPECT_EQ(t.left_out_faces + t.turned_faces + t.split_vertices, 0U) << file;
    EXPECT_TRUE(t.non_manifold_places.empty()) << file;
    const Array<std::uint32_t> welded = welded_vertices(mesh.position);
    std::set<std::uint32_t> places;  // Some vertices of the bunny have no face.
    for (const auto& face : mesh.face) {
      for (const std::uint32_t v : face) places.insert(welded[v]);
    }
    const std::size_t edges = (3 * s.faces + s.edges.border) / 2;
    EXPECT_EQ(t.euler_characteristic,
              static_cast<std::int64_t>(places.size() + s.faces) - static_cast<std::int64_t>(edges))
        << file;
  }
  EXPECT_EQ(mesh_topology(load("meshes/stanford_bunny.obj")).border_loops, 5U);
  EXPECT_EQ(mesh_topology(load("meshes/fandisk.obj")).genus, 0);
}

/// Samples end at creases that the mesh's own edge rings tell; half-edges tell the same ones.
TEST(MeshTopology, HasTheCreasesThatSamplesEndAt) {
  SURFEL_REQUIRE_TEST_DATA();
  for (const char* file :
       {"meshes/stanford_bunny.obj", "meshes/fandisk.obj", "textured/scissors/scissors.obj",
        "textured/spot/spot_triangulated.obj", "meshes/armadillo.ply"}) {
    const TriangleMesh mesh = read_mesh(data_folder() / file);
    const Array<std::uint32_t> rings = edge_rings(mesh);
    for (const double degrees : {20.0, 44.5}) {
      const double angle = degrees * std::numbers::pi / 180;
      const MeshTopology t = mesh_topology(mesh, angle);
      EXPECT_EQ(MeshClips(mesh, rings, angle).creases(), t.crease_edges) << file << ' ' << degrees;
      EXPECT_EQ(count_edges(mesh, rings).border > 0, t.border_loops > 0) << file;
    }
  }
}

/// Both scans touch themselves along many edges, and OpenMesh refuses thousands of their faces.
TEST(MeshTopology, CutsScansSoThatNoFaceIsRefused) {
  SURFEL_REQUIRE_TEST_DATA();
  for (const char* file : {"meshes/dragon_vrip_res2.ply", "meshes/mri_head_surface.ply"}) {
    const TriangleMesh mesh = read_mesh(data_folder() / file);
    const MeshStatistics s = mesh_statistics(mesh);
    const MeshTopology t = mesh_topology(mesh);
    EXPECT_GT(s.edges.non_manifold, 1000U) << file;
    EXPECT_EQ(t.non_manifold_places.size(), 5U) << file;
    EXPECT_EQ(t.left_out_faces, 0U) << file;
    EXPECT_GT(t.split_vertices, s.edges.non_manifold / 2) << file;
    EXPECT_GT(t.components, s.components) << file;
    EXPECT_EQ(t.border_loops == 0, s.edges.border == 0) << file;
    EXPECT_LE(t.longest_border, s.edges.border_length * (1 + 1e-12)) << file;
  }
}

}  // namespace
}  // namespace surfel
