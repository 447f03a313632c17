#include <filesystem>
#include <set>
#include <string>

#include <gtest/gtest.h>
#include <support/test_data.h>
#include <surfel/base/error.h>
#include <surfel/io/mesh_io.h>
#include <surfel/scene/triangle_mesh.h>

#include "io/mesh_files.h"

namespace surfel {
namespace {

using test::make_mesh;
using test::read_file;
using test::TemporaryFolder;
using test::write_file;

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

}  // namespace
}  // namespace surfel
