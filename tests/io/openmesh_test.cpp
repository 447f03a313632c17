// Meshes as OpenMesh reads them: an independent check of our readers on real files. (Why Surfelkit
// does not read through it is in lib/README.md, "Decisions".)

#include <algorithm>
#include <array>
#include <filesystem>

#include <gtest/gtest.h>
#include <surfel/io/mesh_io.h>
#include <surfel/scene/triangle_mesh.h>

#include "support/test_data.h"

// OpenMesh's headers are not clean under our warnings.
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wall"
#pragma GCC diagnostic ignored "-Wextra"
#pragma GCC diagnostic ignored "-Wdeprecated-declarations"
#include <OpenMesh/Core/IO/MeshIO.hh>
#include <OpenMesh/Core/Mesh/PolyMesh_ArrayKernelT.hh>
#pragma GCC diagnostic pop

namespace surfel::test {
namespace {

/// Position and texture coordinates of a corner.
using Corner = std::array<float, 5>;
using Face = std::array<Corner, 3>;

/// Faces in an order of their own: OpenMesh moves non-manifold ones to the end and may begin a face
/// at another corner.
std::vector<Face> sorted(std::vector<Face> faces) {
  for (Face& face : faces) {
    std::rotate(face.begin(), std::min_element(face.begin(), face.end()), face.end());
  }
  std::sort(faces.begin(), faces.end());
  return faces;
}

std::vector<Face> faces_of(const TriangleMesh& mesh, bool with_uv) {
  std::vector<Face> faces(mesh.face.size());
  for (std::size_t f = 0; f < faces.size(); ++f) {
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec3f p = (mesh.origin + mesh.position[mesh.face[f][k]].cast<double>()).cast<float>();
      const Vec2f uv = with_uv ? mesh.wedge_uv[f][k] : Vec2f(0, 0);
      faces[f][k] = {p.x(), p.y(), p.z(), uv.x(), uv.y()};
    }
  }
  return sorted(std::move(faces));
}

std::vector<Face> faces_of_openmesh(const std::string& path, bool with_uv) {
  OpenMesh::PolyMesh_ArrayKernelT<> mesh;
  mesh.request_halfedge_texcoords2D();
  OpenMesh::IO::Options options = OpenMesh::IO::Options::FaceTexCoord;
  EXPECT_TRUE(OpenMesh::IO::read_mesh(mesh, path, options)) << path;
  std::vector<Face> faces;
  for (const auto f : mesh.faces()) {
    EXPECT_EQ(mesh.valence(f), 3U);
    Face face{};
    std::size_t k = 0;
    for (auto h = mesh.cfh_iter(f); h.is_valid() && k < 3; ++h, ++k) {
      const auto p = mesh.point(mesh.to_vertex_handle(*h));
      const auto uv = mesh.texcoord2D(*h);
      face[k] = {p[0], p[1], p[2], with_uv ? uv[0] : 0, with_uv ? uv[1] : 0};
    }
    faces.push_back(face);
  }
  return sorted(std::move(faces));
}

TEST(OpenMesh, ReadsTheSameTriangles) {
  SURFEL_REQUIRE_TEST_DATA();
  struct Case {
    const char* file;
    bool uv;
  };
  for (const Case& c :
       {Case{"meshes/fandisk.obj", false}, Case{"meshes/stanford_bunny.obj", false},
        Case{"meshes/armadillo.ply", false}, Case{"meshes/dragon_vrip_res2.ply", false},
        Case{"textured/spot/spot_triangulated.obj", true},
        Case{"textured/scissors/scissors.obj", true},
        Case{"textured/head_scan/lee_perry_smith.obj", true}}) {
    const std::string path = (data_folder() / c.file).string();
    EXPECT_EQ(faces_of(read_mesh(path), c.uv), faces_of_openmesh(path, c.uv)) << c.file;
  }
}

}  // namespace
}  // namespace surfel::test
