#pragma once

#include <string>
#include <string_view>

#include <support/test_data.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel::test {

/// Writes a file and returns its path.
std::string write_file(const std::string& path, std::string_view content);

/// All bytes of a file.
std::string read_file(const std::string& path);

/// The mesh that is read from a file with that content; the name tells the format.
TriangleMesh read_text(std::string_view content, const std::string& name = "mesh.obj");

/// The message with which reading fails, which begins with the path; empty if it does not fail.
std::string failure(const std::string& path);

/// failure() of a file with that content.
std::string failure_of_text(std::string_view content, const std::string& name = "mesh.obj");

/// Corner `k` of a face, in world coordinates.
Vec3d corner(const TriangleMesh& mesh, std::size_t face, std::size_t k);

/// Sum of the areas of all faces.
double area(const TriangleMesh& mesh);

/// The volume inside a closed mesh whose faces are counter-clockwise from outside.
double volume(const TriangleMesh& mesh);

/// OBJ.
inline constexpr const char* kCube = R"(# unit cube of quads
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

/// Expects the mesh of kCube.
void expect_unit_cube(const TriangleMesh& mesh);

/// The text with every `from` replaced by `to`.
std::string replaced(std::string text, const std::string& from, const std::string& to);

/// STL.
inline constexpr const char* kTetrahedron = R"(solid tetrahedron
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

/// The faces as a binary STL file.
std::string binary_stl(const TriangleMesh& mesh, const std::string& title);

/// OFF without its first line.
inline constexpr const char* kOffTetrahedron =
    "4 4 6\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
    "3 0 2 1\n3 0 1 3 255 0 0\n3 0 3 2\n3 1 2 3\n";

/// Two squares with two textured materials and one without a texture, charts that meet at an edge,
/// normals and colours. The images are empty files in the folder.
TriangleMesh make_mesh(const TemporaryFolder& folder, const Vec3d& origin);

}  // namespace surfel::test
