#include <Eigen/Geometry>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <random>
#include <set>
#include <sstream>

#include <gtest/gtest.h>
#include <support/test_data.h>
#include <surfel/base/color.h>
#include <surfel/base/error.h>
#include <surfel/io/mesh_io.h>
#include <surfel/io/triangulate.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {
namespace {

using test::TemporaryFolder;

std::string write_file(const std::string& path, std::string_view content) {
  std::ofstream(path, std::ios::binary) << content;
  return path;
}

std::string read_file(const std::string& path) {
  std::ostringstream out;
  out << std::ifstream(path, std::ios::binary).rdbuf();
  return out.str();
}

/// A mesh of that content in a file of its own.
TriangleMesh read_text(std::string_view content, const std::string& name = "mesh.obj") {
  const TemporaryFolder folder;
  return read_mesh(write_file(folder / name, content));
}

/// The message with which reading fails; empty if it does not.
std::string failure(const std::string& path) {
  try {
    read_mesh(path);
  } catch (const Error& error) {
    EXPECT_TRUE(error.kind() == ErrorKind::kInput || error.kind() == ErrorKind::kIo);
    EXPECT_EQ(std::string(error.what()).find(path), 0U) << error.what();
    return error.what();
  }
  return {};
}

std::string failure_of_text(std::string_view content, const std::string& name = "mesh.obj") {
  const TemporaryFolder folder;
  return failure(write_file(folder / name, content));
}

Vec3d corner(const TriangleMesh& mesh, std::size_t face, std::size_t k) {
  return mesh.origin + mesh.position[mesh.face[face][k]].cast<double>();
}

double area(const TriangleMesh& mesh) {
  double sum = 0;
  for (std::size_t i = 0; i < mesh.face.size(); ++i) {
    const Vec3d a = corner(mesh, i, 0);
    sum += (corner(mesh, i, 1) - a).cross(corner(mesh, i, 2) - a).norm() / 2;
  }
  return sum;
}

/// Of a closed mesh whose faces are counter-clockwise from outside.
double volume(const TriangleMesh& mesh) {
  double sum = 0;
  const Vec3d base = mesh.origin;
  for (std::size_t i = 0; i < mesh.face.size(); ++i) {
    sum += (corner(mesh, i, 0) - base)
               .dot((corner(mesh, i, 1) - base).cross(corner(mesh, i, 2) - base)) /
           6;
  }
  return sum;
}

constexpr const char* kCube = R"(# unit cube of quads
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 0 0 1
v 1 0 1
v 1 1 1
v 0 1 1
f 4 3 2 1
f 5 6 7 8
f 1 2 6 5
f 2 3 7 6
f 3 4 8 7
f 4 1 5 8
)";

void expect_unit_cube(const TriangleMesh& mesh) {
  EXPECT_EQ(mesh.position.size(), 8U);
  EXPECT_EQ(mesh.face.size(), 12U);
  EXPECT_EQ(mesh.degenerate_faces, 0U);
  EXPECT_NEAR(area(mesh), 6, 1e-6);
  EXPECT_NEAR(volume(mesh), 1, 1e-6);
}

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  for (std::size_t at = 0; (at = text.find(from, at)) != std::string::npos; at += to.size()) {
    text.replace(at, from.size(), to);
  }
  return text;
}

TEST(ReadObj, CubeHasItsAreaAndVolume) { expect_unit_cube(read_text(kCube)); }

TEST(ReadObj, LayoutOfTheTextDoesNotMatter) {
  const std::string cube = kCube;
  expect_unit_cube(read_text(replaced(cube, "\n", "\r\n")));
  expect_unit_cube(read_text(replaced(cube, "\n", "\r")));
  expect_unit_cube(read_text(cube.substr(0, cube.size() - 1)));
  expect_unit_cube(read_text(replaced(cube, " ", " \t  ")));
  expect_unit_cube(read_text(replaced(cube, "\n", "  # why not\n")));
  expect_unit_cube(read_text(replaced(cube, "f 5 6 7 8", "f 5 6\\\n 7 \\\r\n8")));
  expect_unit_cube(read_text("\xEF\xBB\xBF" + cube));
  const std::size_t faces = cube.find("f 4");
  const std::string vertices = replaced(cube.substr(0, faces), " 1", " +.1e1");
  expect_unit_cube(read_text(vertices + replaced(cube.substr(faces), "f 1 2", "f +1 +2")));
}

TEST(ReadObj, IndicesCountBackwardsAndMayPointAhead) {
  expect_unit_cube(read_text(replaced(kCube, "f 5 6 7 8", "f -4 -3 -2 -1")));
  const std::string cube = kCube;
  const std::size_t faces = cube.find("f 4");
  expect_unit_cube(read_text(cube.substr(faces) + cube.substr(0, faces)));
}

TEST(ReadObj, WedgesKeepTheirOwnTextureCoordinatesAndNormals) {
  const TriangleMesh mesh = read_text(
      "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
      "vt 0 0\nvt 0.5 0\nvt .5 1 0\nvt 0.25\nvn 0 0 2\nvn 0 3 4\n"
      "f 1/1/1 2/2/1 3/3/2\nf 1/4/-2 3/2/-1 4/-4/1\n");
  ASSERT_EQ(mesh.wedge_uv.size(), 2U);
  ASSERT_EQ(mesh.wedge_normal.size(), 2U);
  EXPECT_EQ(mesh.wedge_uv[0][2], Vec2f(0.5F, 1));
  EXPECT_EQ(mesh.wedge_uv[1][0], Vec2f(0.25F, 0));
  EXPECT_EQ(mesh.wedge_uv[1][1], Vec2f(0.5F, 0));
  EXPECT_EQ(mesh.wedge_uv[1][2], Vec2f(0, 0));
  EXPECT_EQ(mesh.wedge_normal[0][0], Vec3f(0, 0, 1));
  EXPECT_EQ(mesh.wedge_normal[1][1], Vec3f(0, 0.6F, 0.8F));
}

TEST(ReadObj, UvOfSomeFacesIsKeptNormalsOfSomeAreNot) {
  const TriangleMesh mesh = read_text(
      "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0.5 1\nvn 0 0 1\n"
      "f 1//1 3//1 4//1\nf 1/1 2/1 3/1\n");
  ASSERT_EQ(mesh.wedge_uv.size(), 2U);
  EXPECT_EQ(mesh.wedge_uv[0][1], Vec2f(0, 0));
  EXPECT_EQ(mesh.wedge_uv[1][1], Vec2f(0.5F, 1));
  EXPECT_TRUE(mesh.wedge_normal.empty());
}

TEST(ReadObj, ColorsAreDecodedAndAWeightIsNoColor) {
  const TriangleMesh mesh =
      read_text("v 0 0 0 1 0.5 0\nv 1 0 0 0.25\nv 0 1 0 nan 0 0 1\nf 1 2 3\n");
  ASSERT_EQ(mesh.color.size(), 3U);
  EXPECT_EQ(mesh.color[0], Vec3f(1, srgb_to_linear(0.5F), 0));
  EXPECT_EQ(mesh.color[1], Vec3f(1, 1, 1));
  EXPECT_EQ(mesh.color[2], Vec3f(1, 0, 0));
  EXPECT_TRUE(read_text("v 0 0 0 .5\nv 1 0 0 .5\nv 0 1 0 2\nf 1 2 3\n").color.empty());
}

TEST(ReadObj, MaterialsAndTheirTexturesAreFound) {
  const TemporaryFolder folder;
  std::filesystem::create_directory(folder / "maps");
  write_file(folder / "maps/wood 1.png", "");
  write_file(folder / "plain.png", "");
  write_file(folder / "two words.mtl",
             "Kd 9 9 9\nnewmtl red paint\nKd 1 0.5 .25\n"
             "map_Kd -s 1 1 1 -o 0.5 0 -bm 2 -clamp on -mm 0 1 maps/wood 1.png\n"
             "newmtl moved\r\n\tmap_Kd C:\\artist\\plain.png\r\n"
             "newmtl gone\nKd 0.5\nmap_Kd not there.png\n");
  const std::string path = write_file(
      folder / "mesh.obj",
      "mtllib two words.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nusemtl red paint \nf 1 2 "
      "3\nusemtl moved\nf 1 2 3\nusemtl gone\nf 1 2 3\nusemtl unheard of\nf 1 2 3\n"
      "usemtl red paint\nf 1 2 3\n");
  const TriangleMesh mesh = read_mesh(path);
  const Array<std::uint16_t> expected{0, 1, 2, 3, 4, 1};
  EXPECT_EQ(mesh.face_material, expected);
  ASSERT_EQ(mesh.material.size(), 5U);
  EXPECT_EQ(mesh.material[0].name, "");
  EXPECT_EQ(mesh.material[1].name, "red paint");
  EXPECT_EQ(mesh.material[1].diffuse, Vec3f(1, 0.5F, 0.25F));
  EXPECT_EQ(mesh.material[1].texture, folder / "maps/wood 1.png");
  EXPECT_EQ(mesh.material[2].texture, folder / "plain.png");
  EXPECT_EQ(mesh.material[3].diffuse, Vec3f::Constant(0.5F));
  EXPECT_EQ(mesh.material[3].texture, folder / "not there.png");
  EXPECT_EQ(mesh.material[4].texture, "");
  EXPECT_EQ(mesh.material[1].wrap, WrapMode::kClamp);
  EXPECT_FALSE(mesh.material[2].wrap);
  EXPECT_EQ(mesh.material[1].named_by, folder / "two words.mtl");
}

TEST(ReadObj, MissingMaterialFilesAreToldAndTheirMaterialsGrey) {
  const std::string corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
  const TriangleMesh missing = read_text("mtllib some paint.mtl\n" + corners +
                                         "usemtl red\nf 1 2 3\nusemtl blue\nf 1 2 3\n");
  EXPECT_EQ(missing.notes,
            (std::vector<std::string>{
                "names the material file 'some paint.mtl', which is not there; put it beside "
                "this file",
                "the material 'red', like 1 others, is in no material file; its faces are grey"}));
  EXPECT_EQ(missing.material.at(0).diffuse, SurfelCloud::colorless());
  EXPECT_TRUE(read_text(corners + "f 1 2 3\n").notes.empty());
}

TEST(ReadObj, FilesAreFoundInOtherCase) {
  const TemporaryFolder folder;
  std::filesystem::create_directory(folder / "maps");
  write_file(folder / "Paint.MTL",
             "newmtl a\nmap_Kd D:\\work\\MAPS\\wood.png\n"
             "newmtl b\nmap_Kd maps\\BARK.png\n");
  write_file(folder / "Wood.PNG", "");
  write_file(folder / "maps/bark.PNG", "");
  const TriangleMesh mesh = read_mesh(write_file(folder / "mesh.obj",
                                                 "mtllib paint.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\n"
                                                 "usemtl a\nf 1 2 3\nusemtl b\nf 1 2 3\n"));
  ASSERT_EQ(mesh.material.size(), 2U);
  EXPECT_EQ(mesh.material[0].texture, folder / "Wood.PNG");
  EXPECT_EQ(mesh.material[1].texture, folder / "maps/bark.PNG");
  EXPECT_TRUE(mesh.notes.empty());
}

TEST(ReadObj, TextureOptionsMoveTheCoordinates) {
  const TemporaryFolder folder;
  write_file(folder / "m.mtl",
             "newmtl a\nmap_Kd -s 2 3 -o 0.5 0.25 a.png\nnewmtl b\n"
             "map_Kd -s nan 1 b.png\n");
  const TriangleMesh mesh =
      read_mesh(write_file(folder / "mesh.obj",
                           "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 1 1\n"
                           "usemtl a\nf 1/1 2/1 3/1\nusemtl b\nf 1/1 2/1 3/1\n"));
  ASSERT_EQ(mesh.wedge_uv.size(), 2U);
  EXPECT_EQ(mesh.wedge_uv[0][0], Vec2f(2.5F, 3.25F));
  EXPECT_EQ(mesh.wedge_uv[1][0], Vec2f(1, 1));
}

TEST(ReadObj, MaterialsHaveNormalAndBumpMaps) {
  const TemporaryFolder folder;
  write_file(folder / "n.png", "");
  write_file(folder / "b.png", "");
  write_file(folder / "m.mtl",
             "norm n.png\nnewmtl a\nnorm -bm 3 n.png\nnewmtl b\nbump -bm 0.25 -imfchan r b.png\n"
             "newmtl c\nmap_bump b.png -bm\nnewmtl d\nmap_Bump -bm x b.png\n"
             "newmtl e\nbump -bm -2 b.png\nnewmtl f\nbump\n");
  std::string text = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\n";
  for (const char name : std::string("abcdef"))
    text += std::string("usemtl ") + name + "\nf 1 2 3\n";
  const TriangleMesh mesh = read_mesh(write_file(folder / "m.obj", text));
  ASSERT_EQ(mesh.material.size(), 6U);
  EXPECT_EQ(mesh.material[0].normal_map, folder / "n.png");
  EXPECT_EQ(mesh.material[0].bump_map, "");
  EXPECT_EQ(mesh.material[1].bump_map, folder / "b.png");
  EXPECT_EQ(mesh.material[1].bump_scale, 0.25F);
  EXPECT_EQ(mesh.material[1].normal_map, "");
  EXPECT_EQ(mesh.material[1].texture, "");
  EXPECT_EQ(mesh.material[2].bump_map, folder / "b.png -bm");  // Options come first.
  EXPECT_EQ(mesh.material[3].bump_map, folder / "b.png");
  EXPECT_EQ(mesh.material[3].bump_scale, 1);
  EXPECT_EQ(mesh.material[4].bump_scale, -2);
  EXPECT_EQ(mesh.material[5].bump_map, "");
}

TEST(ReadObj, SeveralMaterialFilesOnOneLine) {
  const TemporaryFolder folder;
  write_file(folder / "a.mtl", "newmtl a\nKd 1 0 0\n");
  write_file(folder / "b.mtl", "newmtl b\nKd 0 1 0\n");
  const TriangleMesh mesh =
      read_mesh(write_file(folder / "mesh.obj",
                           "mtllib a.mtl missing.mtl b.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\n"
                           "usemtl b\nf 1 2 3\nusemtl a\nf 1 2 3\n"));
  ASSERT_EQ(mesh.material.size(), 2U);
  EXPECT_EQ(mesh.material[0].diffuse, Vec3f(0, 1, 0));
  EXPECT_EQ(mesh.material[1].diffuse, Vec3f(1, 0, 0));
}

TEST(ReadObj, ErrorsNameTheLine) {
  const std::string triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
  const std::vector<std::pair<std::string, std::string>> cases{
      {"f 1 2 4\nf 1 2 3\n", "line 4: a face names vertex 4"},
      {"f 1 2 0\n", "line 4: index 0"},
      {"f 1 2 -4\n", "line 4: index -4"},
      {"f 1 2 99999999999\n", "line 4: index 99999999999"},
      {"f 1 2 99999999999999999999\n", "line 4: an index of a face is"},
      {"\nf 1 2\n", "line 5: a face with 2 corners"},
      {"f\n", "line 4: a face with 0 corners"},
      {"f 1 2 x\n", "line 4: an index of a face is 'x'"},
      {"f 1 2 3.5\n", "line 4: '.5'"},
      {"f 1/1 2/1 3/1\n", "line 4: a face names texture coordinate 1"},
      {"vn 0 0 1\nf 1//1 2//1 3//2\n", "line 5: a face names normal 2"},
      {"v 1 2\nf 1 2 3\n", "line 4: z of a vertex is missing"},
      {"v 1 2 1e999\nf 1 2 3\n", "line 4: z of a vertex is '1e999', not a finite"},
      {"v 1 2 3x\nf 1 2 3\n", "line 4: z of a vertex is '3x'"},
      {"v 1 2 -1.#IND\nf 1 2 3\n", "line 4: z of a vertex is '-1.#IND'"},
      {"v 1 2 +-3\nf 1 2 3\n", "line 4: z of a vertex is '+-3'"},
      {"vt nan 0\nf 1 2 3\n", "line 4: u of a texture coordinate"},
      {"", "3 points and no face"},
  };
  for (const auto& [text, message] : cases) {
    const std::string found = failure_of_text(triangle + text);
    EXPECT_NE(found.find(message), std::string::npos) << text << found;
  }
  EXPECT_NE(failure_of_text("# nothing\n").find("empty"), std::string::npos);
}

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

double cross(const Vec2d& a, const Vec2d& b) { return a.x() * b.y() - a.y() * b.x(); }

/// Triangles of a polygon in the plane z = 0: their number and winding are right, and as their
/// areas sum to the polygon's they neither overlap nor leave it.
void expect_tiled(const std::vector<Vec2d>& polygon) {
  std::vector<Vec3d> corners;
  double whole = 0;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    corners.emplace_back(polygon[i].x(), polygon[i].y(), 0);
    whole += cross(polygon[i], polygon[(i + 1) % polygon.size()]) / 2;
  }
  std::vector<std::array<std::uint32_t, 3>> triangles;
  triangulate_polygon(corners, triangles);
  EXPECT_EQ(triangles.size(), polygon.size() - 2);
  double sum = 0;
  for (const auto& [a, b, c] : triangles) {
    const double signed_area = cross(polygon[b] - polygon[a], polygon[c] - polygon[a]) / 2;
    EXPECT_GE(signed_area * whole, 0);
    sum += signed_area;
  }
  EXPECT_NEAR(sum, whole, 1e-9 * std::abs(whole));
}

std::vector<Vec2d> reversed(std::vector<Vec2d> polygon) {
  return {polygon.rbegin(), polygon.rend()};
}

TEST(TriangulatePolygon, TilesConcavePolygonsOfEitherWinding) {
  const std::vector<Vec2d> arrow{{0, 0}, {2, 1}, {0, 2}, {0.5, 1}};
  const std::vector<Vec2d> comb{{0, 0}, {6, 0}, {6, 3}, {5, 3}, {5, 1}, {4, 1},
                                {4, 3}, {3, 3}, {3, 1}, {2, 1}, {2, 3}, {0, 3}};
  const std::vector<Vec2d> collinear{{0, 0}, {1, 0}, {2, 0}, {2, 2}, {1, 2}, {0, 2}, {0, 1}};
  // A square with a square hole, joined by a bridge that is walked twice.
  const std::vector<Vec2d> hole{{0, 0}, {4, 0}, {4, 4}, {0, 4}, {0, 0},
                                {1, 1}, {1, 3}, {3, 3}, {3, 1}, {1, 1}};
  for (const auto& polygon : {arrow, comb, collinear, hole}) {
    expect_tiled(polygon);
    expect_tiled(reversed(polygon));
  }
}

TEST(TriangulatePolygon, TilesRandomStars) {
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    std::vector<Vec2d> star;
    const std::size_t corners = 4 + seed % 40;
    for (std::size_t i = 0; i < corners; ++i) {
      const double angle = 2 * M_PI * static_cast<double>(i) / static_cast<double>(corners);
      const double radius = 0.1 + 0.1 * static_cast<double>((seed * 7919 + i * i * 31) % 97);
      star.emplace_back(radius * std::cos(angle), radius * std::sin(angle));
    }
    expect_tiled(star);
  }
}

TEST(TriangulatePolygon, CrossedAndFlatPolygonsEnd) {
  const std::vector<std::vector<Vec3d>> polygons{
      {{0, 0, 0}, {1, 1, 0}, {1, 0, 0}, {0, 1, 0}},
      {{0, 0, 0}, {0, 0, 0}, {0, 0, 0}, {0, 0, 0}},
      {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {3, 0, 0}, {1, 0, 0}}};
  for (const auto& polygon : polygons) {
    std::vector<std::array<std::uint32_t, 3>> triangles;
    triangulate_polygon(polygon, triangles);
    EXPECT_EQ(triangles.size(), polygon.size() - 2);
  }
}

TEST(TriangulatePolygon, TilesLongPolygons) {
  // So many corners that to look at all reflex ones for each ear would take minutes.
  constexpr std::size_t kCorners = 40000;
  constexpr auto kHalf = static_cast<int>(kCorners / 2);
  std::vector<Vec2d> comb;
  std::vector<Vec2d> spiral;
  std::vector<Vec2d> star;
  std::vector<Vec2d> flat_sides;
  std::vector<Vec2d> petals;
  const auto polar = [](double radius, double angle) {
    return Vec2d(radius * std::cos(angle), radius * std::sin(angle));
  };
  for (int i = 0; i < kHalf; ++i) {
    comb.emplace_back(i, 0);
    comb.emplace_back(i + 0.5, 1000);
    spiral.push_back(polar(1 + i, 0.01 * i));
    star.push_back(polar(1 + (i * 7919 % 997), M_PI * 2 * i / kHalf));
    star.push_back(polar(1 + (i * 104729 % 499), M_PI * (2 * i + 1) / kHalf));
    flat_sides.emplace_back(i, 0);
    // All begin at one place.
    petals.emplace_back(0, 0);
    petals.push_back(polar(1, M_PI * 2 * i / kHalf));
    petals.push_back(polar(1, M_PI * (2 * i + 1) / kHalf));
  }
  comb.emplace_back(kHalf, -1);
  comb.emplace_back(-1, -1);
  for (int i = kHalf; i-- > 0;) {
    spiral.push_back(polar(200 + i, 0.01 * i));
    flat_sides.emplace_back(i, kHalf - 1 - i);
  }
  for (const auto& polygon : {comb, spiral, star, flat_sides, petals}) {
    expect_tiled(polygon);
    expect_tiled(reversed(polygon));
  }
}

TEST(TriangulatePolygon, CrossedPolygonsOfManyCornersEndWithTheirSignedArea) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<Vec3d> scribble;
  std::vector<Vec3d> walk(1, Vec3d::Zero());
  std::vector<Vec3d> grid;
  while (scribble.size() < 40000) {
    scribble.emplace_back(uniform(random), uniform(random), 0);
    walk.emplace_back(walk.back() + Vec3d(uniform(random) - 0.5, uniform(random) - 0.5, 0));
    // Most corners coincide with others.
    grid.emplace_back(std::floor(uniform(random) * 30), std::floor(uniform(random) * 30), 0);
  }
  const std::vector<Vec3d> place(40000, Vec3d(1, 2, 3));
  for (const auto& polygon : {scribble, walk, grid, place}) {
    std::vector<std::array<std::uint32_t, 3>> triangles;
    triangulate_polygon(polygon, triangles);
    ASSERT_EQ(triangles.size(), polygon.size() - 2);
    Vec3d area = Vec3d::Zero();
    for (std::size_t i = 0; i < polygon.size(); ++i) {
      area += polygon[i].cross(polygon[(i + 1) % polygon.size()]) / 2;
    }
    std::vector<bool> used(polygon.size());
    for (const auto& [a, b, c] : triangles) {
      area -= (polygon[b] - polygon[a]).cross(polygon[c] - polygon[a]) / 2;
      used[a] = used[b] = used[c] = true;
    }
    EXPECT_NEAR(area.norm(), 0, 1e-6);
    EXPECT_EQ(std::count(used.begin(), used.end(), false), 0);
  }
}

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

constexpr const char* kTetrahedron = R"(solid tetrahedron
facet normal 0 0 0
 outer loop
  vertex 0 0 0
  vertex 0 1 0
  vertex 1 0 0
 endloop
endfacet
facet normal 0 0 0
 outer loop
  vertex -0 0 0
  vertex 1 0 0
  vertex 0 0 1
 endloop
endfacet
facet normal 0 0 0
 outer loop
  vertex 0 0 0
  vertex 0 0 1
  vertex 0 1 0
 endloop
endfacet
facet normal 0 0 0
 outer loop
  vertex 1 0 0
  vertex 0 1 0
  vertex 0 0 1
 endloop
endfacet
endsolid tetrahedron
)";

/// The same faces as a binary file.
std::string binary_stl(const TriangleMesh& mesh, const std::string& title) {
  std::string bytes = title;
  bytes.resize(80);
  const auto add = [&](auto value) {
    bytes.append(reinterpret_cast<const char*>(&value), sizeof(value));
  };
  add(static_cast<std::uint32_t>(mesh.face.size()));
  for (const auto& face : mesh.face) {
    bytes.append(12, '\0');
    for (const std::uint32_t vertex : face) {
      for (const float x : mesh.position[vertex]) add(x);
    }
    bytes.append(2, '\0');
  }
  return bytes;
}

TEST(ReadStl, TextAndBinaryAreWelded) {
  const TriangleMesh text = read_text(kTetrahedron, "mesh.stl");
  for (const TriangleMesh& mesh :
       {text, read_text(binary_stl(text, "made by a test"), "mesh.STL"),
        read_text(binary_stl(text, "solid, says a binary file"), "mesh.stl"),
        read_text(replaced(kTetrahedron, "\n", "\r\n"), "mesh.stl")}) {
    EXPECT_EQ(mesh.position.size(), 4U);
    EXPECT_EQ(mesh.face.size(), 4U);
    EXPECT_NEAR(volume(mesh), 1.0 / 6, 1e-7);
  }
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

TEST(ReadStl, BrokenFilesAreRefused) {
  const std::string text = kTetrahedron;
  EXPECT_NE(failure_of_text(text.substr(0, text.size() / 2), "mesh.stl").find("truncated"),
            std::string::npos);
  EXPECT_NE(
      failure_of_text(replaced(text, "vertex 1 0 0", "vertex 1 0"), "mesh.stl").find("line 6"),
      std::string::npos);
  const std::string bytes = binary_stl(read_text(text, "mesh.stl"), "");
  for (const std::size_t size : {std::size_t{3}, std::size_t{84}, bytes.size() - 1}) {
    EXPECT_NE(failure_of_text(bytes.substr(0, size), "mesh.stl").find("truncated"),
              std::string::npos);
  }
  std::string nan = bytes;
  nan.replace(84 + 12, 4, "\xff\xff\xff\xff");
  EXPECT_NE(failure_of_text(nan, "mesh.stl").find("face 0"), std::string::npos);
}

constexpr const char* kOffTetrahedron =
    "4 4 6\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
    "3 0 2 1\n3 0 1 3 255 0 0\n3 0 3 2\n3 1 2 3\n";

TEST(ReadOff, KindsOfVertices) {
  for (const char* keyword : {"OFF\n", "OFF ", "", "# first\nOFF # second\n\n"}) {
    const TriangleMesh mesh = read_text(std::string(keyword) + kOffTetrahedron, "mesh.off");
    EXPECT_NEAR(volume(mesh), 1.0 / 6, 1e-7);
  }
  const TriangleMesh colored = read_text(
      "STCNOFF\n3 1 0\n0 0 0 0 0 1 255 0 128 255 0.5 1\n1 0 0 0 0 1 0 0 0 255 0 0\n"
      "0 1 0 0 0 1 0 0 0 255 1 0\n3 0 1 2\n",
      "mesh.off");
  EXPECT_EQ(colored.color.at(0), Vec3f(1, 0, srgb_to_linear(128.0F * (1.0F / 255))));
  EXPECT_EQ(colored.wedge_normal.at(0)[1], Vec3f(0, 0, 1));
  EXPECT_EQ(colored.wedge_uv.at(0)[0], Vec2f(0.5F, 1));
}

TEST(ReadOff, BrokenFilesAreRefused) {
  const std::string off = std::string("OFF\n") + kOffTetrahedron;
  const auto expect = [](const std::string& text, const char* message) {
    const std::string found = failure_of_text(text, "mesh.off");
    EXPECT_NE(found.find(message), std::string::npos) << found;
  };
  expect(off.substr(0, off.size() - 9), "truncated");
  expect(replaced(off, "3 0 2 1", "3 0 2 4"), "line 7: index 4");
  expect(replaced(off, "3 0 2 1", "2 0 2"), "line 7: a face with 2 corners");
  expect(replaced(off, "3 0 2 1", "99999999 0 2 1"), "line 7: an index of a face is missing");
  expect(replaced(off, "OFF", "4OFF"), "line 1: '4OFF'");
  expect(replaced(off, "OFF", "OFF BINARY"), "binary");
  expect(replaced(off, "4 4 6", "-4 4 6"), "-4 vertices");
  expect(replaced(off, "4 4 6", "4 0 6"), "4 points and no face");
}

/// Two textured materials and one without; charts that meet at an edge; normals, colours.
TriangleMesh make_mesh(const TemporaryFolder& folder, const Vec3d& origin) {
  TriangleMesh mesh;
  mesh.origin = origin;
  for (const float z : {0.0F, 0.1F}) {
    for (const Vec2f& p : {Vec2f(0, 0), Vec2f(1, 0), Vec2f(1, 1), Vec2f(0, 1)}) {
      mesh.position.emplace_back(p.x(), p.y() / 3, z);
    }
  }
  mesh.face = {{0, 1, 2}, {0, 2, 3}, {4, 5, 6}, {4, 6, 7}};
  for (std::size_t i = 0; i < 4; ++i) {
    const auto f = static_cast<float>(i);
    mesh.wedge_uv.push_back({Vec2f(0.1F * f, 1 / 3.0F), Vec2f(1, 0), Vec2f(-0.5F, 7)});
    mesh.wedge_normal.push_back({Vec3f::UnitZ(), Vec3f::UnitZ(), Vec3f::UnitZ()});
  }
  for (std::uint8_t i = 0; i < 8; ++i) {
    mesh.color.push_back(Vec3f::Constant(srgb8_to_linear(static_cast<std::uint8_t>(i * 36))));
  }
  mesh.face_material = {0, 1, 2, 0};
  mesh.material = {{"wood", {1, 0.5F, 0.1F}, folder / "wood 1.png"},
                   {"paint", {0.25F, 1, 0}, ""},
                   {"wood", {1, 1, 1}, folder / "maps/b.png"}};
  mesh.material[0].normal_map = folder / "maps/b.png";
  mesh.material[1].bump_map = folder / "wood 1.png";
  mesh.material[1].bump_scale = 0.125F;
  std::filesystem::create_directory(folder / "maps");
  write_file(folder / "wood 1.png", "");
  write_file(folder / "maps/b.png", "");
  return mesh;
}

void expect_same_surface(const TriangleMesh& found, const TriangleMesh& expected) {
  ASSERT_EQ(found.position.size(), expected.position.size());
  for (std::size_t i = 0; i < found.position.size(); ++i) {
    EXPECT_EQ((found.origin + found.position[i].cast<double>()).eval(),
              (expected.origin + expected.position[i].cast<double>()).eval());
  }
  EXPECT_EQ(found.face, expected.face);
  EXPECT_EQ(found.wedge_uv, expected.wedge_uv);
  EXPECT_EQ(found.wedge_normal, expected.wedge_normal);
  ASSERT_EQ(found.color.size(), expected.color.size());
  for (std::size_t i = 0; i < found.color.size(); ++i) {
    EXPECT_TRUE(found.color[i].isApprox(expected.color[i], 1e-6F) ||
                (found.color[i] - expected.color[i]).norm() < 1e-6F);
  }
}

TEST(WriteMesh, ObjReadsBackAsItWas) {
  for (const Vec3d& origin : {Vec3d(0, 0, 0), Vec3d(1e7, -524288, 0.5)}) {
    const TemporaryFolder folder;
    const TriangleMesh mesh = make_mesh(folder, origin);
    write_mesh(mesh, folder / "mesh.obj");
    const TriangleMesh found = read_mesh(folder / "mesh.obj");
    expect_same_surface(found, mesh);
    EXPECT_EQ(found.face_material, mesh.face_material);
    ASSERT_EQ(found.material.size(), 3U);
    for (std::size_t i = 0; i < 3; ++i) {
      EXPECT_EQ(found.material[i].diffuse, mesh.material[i].diffuse);
      EXPECT_EQ(found.material[i].texture, mesh.material[i].texture);
      EXPECT_EQ(found.material[i].normal_map, mesh.material[i].normal_map);
      EXPECT_EQ(found.material[i].bump_map, mesh.material[i].bump_map);
      EXPECT_EQ(found.material[i].bump_scale, mesh.material[i].bump_scale);
    }
    EXPECT_EQ(found.material[0].name, "wood");
    EXPECT_NE(found.material[2].name, "wood");
    const std::string materials = read_file(folder / "mesh.mtl");
    EXPECT_NE(materials.find("map_Kd wood 1.png\n"), std::string::npos) << materials;
    EXPECT_NE(materials.find("map_Kd maps/b.png\n"), std::string::npos) << materials;
  }
}

TEST(WriteMesh, PlyReadsBackAsItWas) {
  for (const Vec3d& origin : {Vec3d(0, 0, 0), Vec3d(1e7, -524288, 0.5)}) {
    const TemporaryFolder folder;
    const TriangleMesh mesh = make_mesh(folder, origin);
    write_mesh(mesh, folder / "mesh.ply");
    const TriangleMesh found = read_mesh(folder / "mesh.ply");
    expect_same_surface(found, mesh);
    for (std::size_t i = 0; i < mesh.face.size(); ++i) {
      EXPECT_EQ(found.material.at(found.face_material.at(i)).texture,
                mesh.material[mesh.face_material[i]].texture);
    }
  }
}

TEST(WriteMesh, PlyLeavesOutNormalsThatWedgesDoNotShare) {
  const TemporaryFolder folder;
  TriangleMesh mesh = make_mesh(folder, Vec3d::Zero());
  mesh.wedge_normal[1][0] = Vec3f::UnitX();
  write_mesh(mesh, folder / "mesh.ply");
  EXPECT_TRUE(read_mesh(folder / "mesh.ply").wedge_normal.empty());
}

TEST(WriteMesh, NamesWithoutAFolderAreThoseOfTheCurrentOne) {
  const TemporaryFolder folder;
  const TriangleMesh mesh = make_mesh(folder, Vec3d::Zero());
  const std::filesystem::path before = std::filesystem::current_path();
  std::filesystem::current_path(std::filesystem::path(folder / "."));
  for (const char* name : {"mesh.ply", "mesh.obj"}) EXPECT_NO_THROW(write_mesh(mesh, name));
  std::filesystem::current_path(before);
  for (const char* name : {"mesh.ply", "mesh.obj"}) {
    const TriangleMesh found = read_mesh(folder / name);
    EXPECT_EQ(found.material.at(found.face_material.at(0)).texture,
              mesh.material[mesh.face_material[0]].texture);
  }
}

ErrorKind kind_of_failed_write(const TriangleMesh& mesh, const std::string& path,
                               const MeshWriteOptions& options = {}) {
  try {
    write_mesh(mesh, path, options);
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find(path.substr(0, path.size() - 4)), std::string::npos)
        << error.what();
    return error.kind();
  }
  ADD_FAILURE() << path << " was written";
  return ErrorKind::kNumeric;
}

TEST(WriteMesh, WholeOrNothing) {
  const TemporaryFolder folder;
  TriangleMesh mesh = make_mesh(folder, Vec3d::Zero());
  EXPECT_EQ(kind_of_failed_write(mesh, folder / "mesh.stl"), ErrorKind::kUsage);
  EXPECT_EQ(kind_of_failed_write(mesh, folder / "missing/mesh.obj"), ErrorKind::kIo);
  std::filesystem::create_directory(folder / "mesh.mtl");
  EXPECT_EQ(kind_of_failed_write(mesh, folder / "mesh.obj"), ErrorKind::kIo);
  std::filesystem::remove(folder / "mesh.mtl");
  write_file(folder / "old.ply", "old");
  EXPECT_EQ(kind_of_failed_write(mesh, folder / "old.ply", {.no_clobber = true}), ErrorKind::kIo);
  EXPECT_EQ(read_file(folder / "old.ply"), "old");
  mesh.face_material[0] = 3;
  EXPECT_EQ(kind_of_failed_write(mesh, folder / "mesh.ply"), ErrorKind::kInput);
  mesh.face_material[0] = 0;
  mesh.face[0][0] = 8;
  EXPECT_EQ(kind_of_failed_write(mesh, folder / "mesh.obj"), ErrorKind::kInput);
  std::set<std::string> left;
  for (const auto& entry : std::filesystem::directory_iterator(folder / "")) {
    left.insert(entry.path().filename().string());
  }
  EXPECT_EQ(left, (std::set<std::string>{"maps", "old.ply", "wood 1.png"}));
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
  for (int round = 0; round < 300; ++round) {
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
