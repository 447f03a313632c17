#include <string>

#include <gtest/gtest.h>
#include <surfel/scene/triangle_mesh.h>

#include "io/mesh_files.h"

namespace surfel {
namespace {

using test::failure_of_text;
using test::kOffTetrahedron;
using test::read_text;
using test::replaced;
using test::volume;

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

}  // namespace
}  // namespace surfel
