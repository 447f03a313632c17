#pragma once

#include <array>
#include <cstdint>
#include <initializer_list>
#include <string>

#include <surfel/sample/generate.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel::test {

inline void add_triangle(TriangleMesh& mesh, const Vec3f& a, const Vec3f& b, const Vec3f& c) {
  const auto first = static_cast<std::uint32_t>(mesh.position.size());
  for (const Vec3f& p : {a, b, c}) mesh.position.push_back(p);
  mesh.face.push_back({first, first + 1, first + 2});
}

inline void add_quad(TriangleMesh& mesh, const Vec3f& a, const Vec3f& b, const Vec3f& c,
                     const Vec3f& d) {
  add_triangle(mesh, a, b, c);
  add_triangle(mesh, a, c, d);
}

/// Axis-aligned, faces outward; vertices are not shared, as in an STL file.
inline TriangleMesh box(const Vec3f& size) {
  TriangleMesh mesh;
  const auto corner = [&](int i) {
    return Vec3f((i & 1 ? size : Vec3f(0, 0, 0)).x(), (i & 2 ? size : Vec3f(0, 0, 0)).y(),
                 (i & 4 ? size : Vec3f(0, 0, 0)).z());
  };
  for (const auto& q : std::initializer_list<std::array<int, 4>>{
           {0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}}) {
    add_quad(mesh, corner(q[0]), corner(q[1]), corner(q[2]), corner(q[3]));
  }
  return mesh;
}

/// Adds the other mesh's triangles; columns per wedge are dropped.
inline void append(TriangleMesh& mesh, const TriangleMesh& other, float scale,
                   const Vec3f& offset) {
  mesh.wedge_uv.clear();
  mesh.wedge_normal.clear();
  const auto first = static_cast<std::uint32_t>(mesh.position.size());
  for (const Vec3f& p : other.position) mesh.position.push_back(scale * p + offset);
  for (const auto& f : other.face) mesh.face.push_back({f[0] + first, f[1] + first, f[2] + first});
}

/// A procedural scene of that name as triangles, with uv and normals.
inline TriangleMesh surface(const std::string& kind, int resolution) {
  return generate_mesh(procedural_scene(kind, 1), resolution);
}

}  // namespace surfel::test
