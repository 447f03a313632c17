#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>
#include <support/test_data.h>
#include <surfel/base/error.h>
#include <surfel/io/mesh_io.h>
#include <surfel/scene/triangle_mesh.h>

#include "io/mesh_files.h"
#include "support/cases.h"

namespace surfel {
namespace {

using test::area;
using test::binary_stl;
using test::corner;
using test::failure;
using test::failure_of_text;
using test::kCube;
using test::kOffTetrahedron;
using test::kTetrahedron;
using test::make_mesh;
using test::read_file;
using test::read_text;
using test::replaced;
using test::TemporaryFolder;
using test::volume;
using test::write_file;

TEST(ReadMesh, FilesThatAreNoMeshesAreRefused) {
  const TemporaryFolder folder;
  EXPECT_NE(failure(folder / "missing.obj").find("cannot be opened"), std::string::npos);
  std::filesystem::create_directory(folder / "folder.obj");
  EXPECT_NE(failure(folder / "folder.obj").find("directory"), std::string::npos);
  EXPECT_NE(failure(write_file(folder / "empty.ply", "")).find("empty"), std::string::npos);
  const std::string unknown = failure(write_file(folder / "mesh.fbx", "x"));
  for (const char* known : {".obj", ".ply", ".stl", ".off"}) {
    EXPECT_NE(unknown.find(known), std::string::npos) << unknown;
  }
}

TEST(ReadMesh, FacesWithoutAreaAreDroppedAndCounted) {
  const TriangleMesh mesh = read_text(
      "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 2 0 0\nv 0 0 0\nvt 0 1\nusemtl a\n"
      "f 1 1 2\nf 1/1 2/1 3/1\nf 1 2 4\nusemtl b\nf 1 5 2\nf 3 2 4\n");
  EXPECT_EQ(mesh.degenerate_faces, 3U);
  EXPECT_EQ(mesh.face.size(), 2U);
  EXPECT_EQ(mesh.wedge_uv.size(), 2U);
  EXPECT_EQ(mesh.face_material, (Array<std::uint16_t>{0, 1}));
}

TEST(ReadMesh, FarAwayMeshesKeepTheirPrecision) {
  const TriangleMesh near = read_text(kCube);
  EXPECT_EQ(near.origin, Vec3d::Zero());
  std::ostringstream text;
  text.precision(17);
  for (std::size_t i = 0; i < near.position.size(); ++i) {
    const Vec3d p = near.position[i].cast<double>() / 8 + Vec3d(1e7, -3e7, 0.5);
    text << "v " << p.x() << ' ' << p.y() << ' ' << p.z() << '\n';
  }
  const std::string cube = kCube;
  const TriangleMesh far = read_text(text.str() + cube.substr(cube.find("f 4")));
  EXPECT_NEAR(volume(far), 1.0 / 512, 1e-9);
  EXPECT_NEAR(corner(far, 0, 0).x(), 1e7, 1e-8);
  EXPECT_NEAR(corner(far, 0, 0).y(), -3e7 + 0.125, 1e-8);
}

TEST(ReadMesh, ScaleDoesNotMatter) {
  for (const char* scale : {"e-30", "e-6", "e6", "e15"}) {
    const std::string number = std::string("1") + scale;
    std::string cube = kCube;
    const std::size_t faces = cube.find("f 4");
    cube = replaced(cube.substr(0, faces), " 1", " " + number) + cube.substr(faces);
    const TriangleMesh scaled = read_text(cube);
    EXPECT_EQ(scaled.face.size(), 12U);
    EXPECT_NEAR(volume(scaled) / std::pow(std::stod(number), 3), 1, 1e-5) << scale;
  }
  EXPECT_NE(failure_of_text("v 0 0 0\nv 1e39 0 0\nv 0 1 0\nf 1 2 3\n").find("scale"),
            std::string::npos);
}

TEST(ReadMesh, CountsThatTheFileCannotHoldAreRefusedByName) {
  const std::string faces =
      "property float x\nproperty float y\nproperty float z\nelement face 1\n"
      "property list uint int vertex_indices\nend_header\n";
  for (const char* count : {"1000000000000", "18446744073709551615"}) {
    const std::string header =
        std::string("ply\nformat binary_little_endian 1.0\nelement vertex ") + count + "\n";
    EXPECT_NE(
        failure_of_text(header + faces + std::string(100, '\0'), "mesh.ply")
            .find(std::string("mesh.ply: the header promises ") + count + " of element vertex"),
        std::string::npos);
    // An element without properties takes no bytes of the file.
    EXPECT_NE(failure_of_text(header + "element face 0\nproperty list uint int vertex_indices\n"
                                       "end_header\n",
                              "mesh.ply")
                  .find("element vertex has no scalar property 'x'"),
              std::string::npos);
  }
  EXPECT_NE(failure_of_text("ply\nformat binary_little_endian 1.0\nelement vertex 1\n" + faces +
                                std::string(12, '\0') + std::string("\x10\0\0\0", 4) +
                                std::string(60, '\0'),
                            "mesh.ply")
                .find("face 0 (vertex_indices) promises 16 items, the file has room for"),
            std::string::npos);
  const std::string stl = std::string(80, ' ') + "\xff\xff\xff\xff" + std::string(60, '\0');
  EXPECT_NE(failure_of_text(stl, "mesh.stl").find("the header promises 4294967295 triangles"),
            std::string::npos);
}

TEST(MalformedMeshes, InvalidOnesAreRefused) {
  SURFEL_REQUIRE_TEST_DATA();
  const std::filesystem::path folder = test::data_folder() / "malformed/invalid";
  const std::vector<std::pair<const char*, const char*>> files{
      {"assimp_malformed.obj", "line 28: index 0"},
      {"assimp_outofmemory.off", "line 2: the header promises 353535235358 vertices"},
      {"draco_degenerate_mesh.obj", "none of the 1 faces has an area"},
      {"draco_inf_nan.obj", "line 1: x of a vertex is 'inf'"},
      {"tinyobj_invalid_face.obj", "line 15: a face with 1 corners"},
      {"tinyobj_test_nan.obj", "line 12: x of a vertex is 'nan'"},
      {"tinyobj_zero_index.obj", "line 16: index 0"},
      {"trimesh_not_enough_indices.obj", "line 9: a face with 2 corners"},
      {"trimesh_empty.ply", "neither vertices nor faces"},
      {"pdal_no_vertex.ply", "no element 'vertex'"}};
  for (const auto& [file, message] : files) {
    const std::string found = failure((folder / file).string());
    EXPECT_NE(found.find(message), std::string::npos) << file << ": " << found;
  }
  // Listed among the invalid, but a legal triangle after comments that look like faces.
  EXPECT_EQ(read_mesh((folder / "trimesh_no_faces_in_chunk.obj").string()).face.size(), 1U);
}

struct Expected {
  const char* file;
  std::size_t vertices;
  std::size_t faces;
  double area;
};

TEST(MalformedMeshes, TrickyOnesAreReadRight) {
  SURFEL_REQUIRE_TEST_DATA();
  const std::filesystem::path folder = test::data_folder() / "malformed/tricky";
  const std::vector<Expected> files{{"assimp_concave_polygon.obj", 64, 64, 0},
                                    {"assimp_multiple_spaces.obj", 4, 1, std::sqrt(27.0) / 2},
                                    {"assimp_no_final_newline.obj", 8, 12, 6},
                                    {"tinyobj_leading_dot.obj", 3, 1, 0},
                                    {"tinyobj_texture_name_blank.obj", 8, 12, 24},
                                    {"tinyobj_vertex_w.obj", 8, 12, 24},
                                    {"trimesh_nan_colour.obj", 8, 12, 6},
                                    {"trimesh_negative_indices.obj", 8, 12, 24},
                                    {"assimp_crlf_after_end_header.ply", 8, 12, 6},
                                    {"assimp_float_colour.ply", 3, 1, 10000},
                                    {"draco_whitespace.ply", 3, 1, 0},
                                    {"happly_faces_first.ply", 50, 80, 0},
                                    {"meshlab_many_small_holes.ply", 2004, 3524, 0},
                                    {"meshlab_two_textures.ply", 8, 4, 2},
                                    {"trimesh_uv_s_t.ply", 24, 12, 6},
                                    {"trimesh_comments.off", 8, 12, 32}};
  for (const Expected& expected : files) {
    const TriangleMesh mesh = read_mesh((folder / expected.file).string());
    EXPECT_EQ(mesh.position.size(), expected.vertices) << expected.file;
    EXPECT_EQ(mesh.face.size(), expected.faces) << expected.file;
    if (expected.area > 0) {
      EXPECT_NEAR(area(mesh) / expected.area, 1, 1e-6) << expected.file;
    }
    for (const Vec3f& color : mesh.color) EXPECT_TRUE(color.allFinite()) << expected.file;
  }
  for (const char* points : {"tinyobj_points.obj", "trimesh_lists_on_points.ply"}) {
    EXPECT_NE(failure((folder / points).string()).find("points and no face"), std::string::npos);
  }
}

TEST(MalformedMeshes, TexturesAndColorsOfTrickyOnes) {
  SURFEL_REQUIRE_TEST_DATA();
  const std::filesystem::path folder = test::data_folder() / "malformed/tricky";
  const TriangleMesh blank = read_mesh((folder / "tinyobj_texture_name_blank.obj").string());
  ASSERT_EQ(blank.material.size(), 3U);
  EXPECT_EQ(blank.material[0].texture,
            std::filesystem::weakly_canonical(folder / "texture 01.png").string());
  EXPECT_EQ(blank.material[1].diffuse, Vec3f(1, 0, 0));
  const TriangleMesh two = read_mesh((folder / "meshlab_two_textures.ply").string());
  EXPECT_EQ(two.face_material, (Array<std::uint16_t>{0, 0, 1, 1}));
  EXPECT_EQ(two.material.size(), 2U);
  EXPECT_EQ(two.wedge_uv.size(), 4U);
  const TriangleMesh floats = read_mesh((folder / "assimp_float_colour.ply").string());
  EXPECT_EQ(floats.color.at(0), Vec3f(0, 0, 1));
}

/// How many triangles the faces of an OBJ file make, counted another way.
std::size_t triangles_in_obj(const std::string& path) {
  std::ifstream in(path);
  std::size_t count = 0;
  for (std::string line; std::getline(in, line);) {
    std::istringstream words(line);
    std::string word;
    words >> word;
    if (word != "f") continue;
    std::size_t corners = 0;
    while (words >> word) ++corners;
    count += corners - 2;
  }
  return count;
}

TEST(RealMeshes, TexturedOnes) {
  SURFEL_REQUIRE_TEST_DATA();
  const std::filesystem::path folder = test::data_folder() / "textured";
  for (const char* file :
       {"spot/spot_triangulated.obj", "head_scan/lee_perry_smith.obj", "scissors/scissors.obj"}) {
    const std::string path = (folder / file).string();
    const TriangleMesh mesh = read_mesh(path);
    EXPECT_EQ(mesh.face.size() + mesh.degenerate_faces, triangles_in_obj(path)) << file;
    ASSERT_EQ(mesh.wedge_uv.size(), mesh.face.size()) << file;
    for (const auto& wedge : mesh.wedge_uv) {
      for (const Vec2f& uv : wedge) {
        // The charts of spot reach 0.0522 past the image's left border.
        ASSERT_TRUE(uv.minCoeff() >= -0.053F && uv.maxCoeff() <= 1.001F)
            << file << ' ' << uv.transpose();
      }
    }
    for (const MeshMaterial& material : mesh.material) {
      EXPECT_TRUE(std::filesystem::exists(material.texture)) << material.texture;
    }
    EXPECT_EQ(mesh.material.empty(), std::string(file).starts_with("spot"));
  }
}

TEST(RealMeshes, PlainOnes) {
  SURFEL_REQUIRE_TEST_DATA();
  const std::filesystem::path folder = test::data_folder() / "meshes";
  const std::vector<Expected> files{
      {"armadillo.ply", 43243, 86482, 0},          {"brain_tristrips.ply", 18844, 36752, 0},
      {"dragon_vrip_res2.ply", 100250, 202520, 0}, {"fandisk.obj", 6475, 12946, 0},
      {"mri_head_surface.ply", 260205, 522780, 0}, {"stanford_bunny.obj", 35947, 69451, 0}};
  for (const Expected& expected : files) {
    const TriangleMesh mesh = read_mesh((folder / expected.file).string());
    EXPECT_EQ(mesh.position.size(), expected.vertices) << expected.file;
    EXPECT_EQ(mesh.face.size() + mesh.degenerate_faces, expected.faces) << expected.file;
    EXPECT_EQ(mesh.origin, Vec3d::Zero()) << expected.file;
  }
}

/// Neighbours in a consistently wound surface walk their common edge in opposite directions.
TEST(RealMeshes, StripsOfTheBrainAreWoundAlike) {
  SURFEL_REQUIRE_TEST_DATA();
  const TriangleMesh mesh =
      read_mesh((test::data_folder() / "meshes/brain_tristrips.ply").string());
  std::set<std::pair<std::uint32_t, std::uint32_t>> edges;
  for (const auto& face : mesh.face) {
    for (std::size_t k = 0; k < 3; ++k) {
      EXPECT_TRUE(edges.emplace(face[k], face[(k + 1) % 3]).second);
    }
  }
}

/// Cuts and damages must end in an Error or a mesh, never anything else.
TEST(MalformedMeshes, DamagedFilesAreReadOrRefused) {
  const TemporaryFolder folder;
  TriangleMesh mesh = make_mesh(folder, Vec3d::Zero());
  write_mesh(mesh, folder / "mesh.obj");
  write_mesh(mesh, folder / "mesh.ply");
  const std::vector<std::pair<std::string, std::string>> originals{
      {"damaged.obj", read_file(folder / "mesh.obj")},
      {"damaged.ply", read_file(folder / "mesh.ply")},
      {"damaged.stl", kTetrahedron},
      {"damaged.stl", binary_stl(mesh, "")},
      {"damaged.off", std::string("OFF\n") + kOffTetrahedron}};
  std::uint32_t random = 1;
  const auto next = [&](std::size_t below) {
    random = random * 1664525U + 1013904223U;
    return (random >> 8) % below;
  };
  for (int round = 0; round < test::cases(100); ++round) {
    for (const auto& [name, original] : originals) {
      std::string damaged = original;
      for (std::size_t k = next(4); k > 0; --k) {
        damaged[next(damaged.size())] = "0 9-/\n\xff\0v.e#"[next(12)];
      }
      if (next(3) == 0) damaged.resize(next(damaged.size()));
      try {
        const TriangleMesh found = read_mesh(write_file(folder / name, damaged));
        for (const auto& face : found.face) {
          for (const std::uint32_t vertex : face) ASSERT_LT(vertex, found.position.size());
        }
      } catch (const Error&) {
        continue;
      }
    }
  }
}

}  // namespace
}  // namespace surfel
