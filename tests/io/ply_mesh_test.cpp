#include <Eigen/Geometry>
#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>

#include <gtest/gtest.h>
#include <surfel/base/color.h>
#include <surfel/base/error.h>
#include <surfel/scene/triangle_mesh.h>

#include "io/mesh_files.h"

namespace surfel {
namespace {

using test::corner;
using test::failure_of_text;
using test::read_text;

constexpr const char* kPlyTriangles = R"(element vertex 4
property float x
property float y
property float z
)";

TEST(ReadPlyMesh, StripsTurnEverySecondTriangleAndRestart) {
  const TriangleMesh mesh = read_text(std::string("ply\nformat ascii 1.0\n") + kPlyTriangles +
                                          "element tristrips 1\n"
                                          "property list int int vertex_indices\nend_header\n"
                                          "0 0 0\n1 0 0\n0 1 0\n1 1 0\n10 0 1 2 3 -1 1 3 2 -1 0\n",
                                      "mesh.ply");
  ASSERT_EQ(mesh.face.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) {
    const Vec3d a = corner(mesh, i, 0);
    EXPECT_EQ((corner(mesh, i, 1) - a).cross(corner(mesh, i, 2) - a), Vec3d(0, 0, 1)) << i;
  }
}

TEST(ReadPlyMesh, UvNormalsAndColorsPerVertex) {
  for (const auto& [u, v] : {std::pair("u", "v"), {"s", "t"}, {"texture_u", "texture_v"}}) {
    const TriangleMesh mesh = read_text(
        std::string("ply\nformat ascii 1.0\ncomment TextureFile a b.png\n") + kPlyTriangles +
            "property float nx\nproperty float ny\nproperty float nz\nproperty float " + u +
            "\nproperty float " + v +
            "\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
            "element face 1\nproperty list uchar int vertex_index\nend_header\n"
            "0 0 0 0 0 2 0 0 255 0 128\n1 0 0 0 0 1 1 0 0 0 0\n1 1 0 0 0 1 1 1 0 0 0\n"
            "0 1 0 0 0 1 0 1 0 0 0\n4 0 1 2 3\n",
        "mesh.ply");
    ASSERT_EQ(mesh.wedge_uv.size(), 2U);
    EXPECT_EQ(mesh.wedge_uv[0][2], Vec2f(1, 1));
    EXPECT_EQ(mesh.wedge_normal.at(0)[0], Vec3f(0, 0, 1));
    EXPECT_EQ(mesh.color.at(0), Vec3f(1, 0, srgb8_to_linear(128)));
    ASSERT_EQ(mesh.material.size(), 1U);
    EXPECT_EQ(std::filesystem::path(mesh.material[0].texture).filename(), "a b.png");
    EXPECT_EQ(mesh.face_material, (Array<std::uint16_t>{0, 0}));
  }
}

TEST(ReadPlyMesh, FacesWithoutTextureShareAMaterial) {
  const TriangleMesh mesh =
      read_text(std::string("ply\nformat ascii 1.0\ncomment TextureFile a.png\n") + kPlyTriangles +
                    "element face 2\nproperty list uchar int vertex_indices\n"
                    "property list uchar float texcoord\nproperty int texnumber\nend_header\n"
                    "0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2 0 -1\n3 0 2 3 6 0 0 1 1 0 1 0\n",
                "mesh.ply");
  EXPECT_EQ(mesh.face_material, (Array<std::uint16_t>{1, 0}));
  ASSERT_EQ(mesh.material.size(), 2U);
  EXPECT_EQ(mesh.material[1].texture, "");
  EXPECT_EQ(mesh.wedge_uv[1][1], Vec2f(1, 1));
}

TEST(ReadPlyMesh, ErrorsNameTheElement) {
  const auto with_face = [](const std::string& properties, const std::string& face,
                            const std::string& last = "0 1 0") {
    return failure_of_text(std::string("ply\nformat ascii 1.0\n") + kPlyTriangles +
                               "element face 1\nproperty list uchar int vertex_indices\n" +
                               properties + "end_header\n0 0 0\n1 0 0\n1 1 0\n" + last + "\n" +
                               face + "\n",
                           "mesh.ply");
  };
  const auto expect = [](const std::string& found, const char* message) {
    EXPECT_NE(found.find(message), std::string::npos) << found;
  };
  expect(with_face("", "3 0 1 4"), "face 0 names vertex 4");
  expect(with_face("", "3 0 1 -1"), "-1");
  expect(with_face("", "2 0 1"), "face 0 has 2 corners");
  expect(with_face("", "3 0 1 2", "0 nan 0"), "y of vertex 3 is nan");
  expect(with_face("property list uchar float texcoord\n", "3 0 1 2 4 0 0 1 1"), "4 texcoord");
  expect(with_face("", "3 0 1"), "line");
}

}  // namespace
}  // namespace surfel
