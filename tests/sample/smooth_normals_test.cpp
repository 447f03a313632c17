#include <Eigen/Geometry>

#include <gtest/gtest.h>
#include <surfel/sample/smooth_normals.h>

#include "sample/test_meshes.h"

namespace surfel {
namespace {

using namespace test;

TEST(SmoothNormals, AreThoseOfTheSphere) {
  const TriangleMesh mesh = surface("sphere", 40);
  const auto normals = smooth_normals(mesh, 1);
  for (std::size_t f = 0; f < mesh.face.size(); ++f) {
    for (int k = 0; k < 3; ++k) {
      EXPECT_GT(normals[f][k].dot(mesh.position[mesh.face[f][k]]), 0.999f);
    }
  }
}

TEST(SmoothNormals, KeepEdgesSharperThanTheCreaseAngle) {
  const TriangleMesh mesh = box(Vec3f(1, 2, 3));
  const auto sharp = smooth_normals(mesh, 0.8);
  const auto round = smooth_normals(mesh, 1.7);
  for (std::size_t f = 0; f < mesh.face.size(); ++f) {
    const Vec3f& a = mesh.position[mesh.face[f][0]];
    const Vec3f face_normal =
        (mesh.position[mesh.face[f][1]] - a).cross(mesh.position[mesh.face[f][2]] - a).normalized();
    for (int k = 0; k < 3; ++k) {
      EXPECT_LT((sharp[f][k] - face_normal).norm(), 1e-6);
      // Each of a corner's three sides spans a right angle there.
      const Vec3f outward = (mesh.position[mesh.face[f][k]] - Vec3f(0.5f, 1, 1.5f)).cwiseSign();
      EXPECT_LT((round[f][k] - outward.normalized()).norm(), 1e-6);
    }
  }
}

TEST(SmoothNormals, FacesWithoutAreaTakeTheirNeighbours) {
  TriangleMesh mesh;
  add_triangle(mesh, Vec3f(0, 0, 0), Vec3f(1, 0, 0), Vec3f(0, 1, 0));
  add_triangle(mesh, Vec3f(0, 0, 0), Vec3f(1, 0, 0), Vec3f(0.5f, 0, 0));
  const auto normals = smooth_normals(mesh, 0.5);
  EXPECT_EQ(normals[1][0], Vec3f(0, 0, 1));
  EXPECT_EQ(normals[1][2], Vec3f(0, 0, 0));
}

}  // namespace
}  // namespace surfel
