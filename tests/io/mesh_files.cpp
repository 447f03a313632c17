#include "io/mesh_files.h"

#include <Eigen/Geometry>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <string_view>

#include <gtest/gtest.h>
#include <support/test_data.h>
#include <surfel/base/color.h>
#include <surfel/base/error.h>
#include <surfel/io/mesh_io.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel::test {

std::string write_file(const std::string& path, std::string_view content) {
  std::ofstream(path, std::ios::binary) << content;
  return path;
}

std::string read_file(const std::string& path) {
  std::ostringstream out;
  out << std::ifstream(path, std::ios::binary).rdbuf();
  return out.str();
}

TriangleMesh read_text(std::string_view content, const std::string& name) {
  const TemporaryFolder folder;
  return read_mesh(write_file(folder / name, content));
}

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

std::string failure_of_text(std::string_view content, const std::string& name) {
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

}  // namespace surfel::test
