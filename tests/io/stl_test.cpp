#include <string>

#include <gtest/gtest.h>
#include <surfel/scene/triangle_mesh.h>

#include "io/mesh_files.h"

namespace surfel {
namespace {

using test::binary_stl;
using test::failure_of_text;
using test::kTetrahedron;
using test::read_text;
using test::replaced;
using test::volume;

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

}  // namespace
}  // namespace surfel
