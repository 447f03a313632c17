#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>
#include <support/test_data.h>
#include <surfel/base/color.h>
#include <surfel/base/error.h>
#include <surfel/io/mesh_io.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/scene/triangle_mesh.h>

#include "io/mesh_files.h"

namespace surfel {
namespace {

using test::expect_unit_cube;
using test::failure_of_text;
using test::kCube;
using test::read_text;
using test::replaced;
using test::TemporaryFolder;
using test::write_file;

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

/// Each name is looked for in the folder, which may hold many files.
TEST(ReadObj, ManyMaterialFilesAreRefused) {
  std::string text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
  for (int i = 0; i < 2000; ++i) text += "mtllib same.mtl\n";
  EXPECT_EQ(failure_of_text(text).find("material files"), std::string::npos);
  for (int i = 0; i < 2000; ++i) text += "mtllib " + std::to_string(i) + ".mtl\n";
  EXPECT_NE(failure_of_text(text).find("more than 1024 names of material files"),
            std::string::npos);
}

}  // namespace
}  // namespace surfel
