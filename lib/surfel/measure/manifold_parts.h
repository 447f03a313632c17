#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include <surfel/base/types.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

/// Faces for a half-edge structure: the faces of a mesh with vertices split where it is no
/// manifold, so that the faces at a vertex form one fan and no edge has more than two. The sides of
/// a cut whose ends stay one vertex each are one edge again: two cubes that share an edge are two
/// closed ones.
struct ManifoldParts {
  Array<std::array<std::uint32_t, 3>> face;  ///< Corners by number in `vertex`.
  Array<std::uint32_t> vertex;               ///< Vertex of the mesh that each one is at.
  /// Element 3 f + k: 1 where edge k of face f (from corner k to corner k + 1) has no other face.
  std::vector<unsigned char> is_border;
  std::size_t left_out_faces = 0;  ///< Faces with two corners at one place, or a corner that is not
                                   ///< finite.
  std::size_t turned_faces = 0;    ///< Faces whose corners were put in the opposite order.
  std::size_t split_vertices = 0;  ///< Vertices added. Vertices at one position count as one.
  std::size_t non_manifold_vertices = 0;     ///< Vertices where sheets touch that no edge there
                                             ///< connects.
  std::size_t non_orientable_parts = 0;      ///< Parts whose faces cannot all face one way.
  std::vector<Vec3d> non_manifold_places;    ///< Middles of edges of three faces or more, then
                                             ///< vertices: the first few, world coordinates.
  static constexpr std::size_t kPlaces = 5;  ///< Most `non_manifold_places`.
};

/// Cuts a mesh along its edges of three faces or more and between faces that face opposite ways
/// (Gueziec, Taubin, Lazarus, Horn 2001, "Cutting and Stitching: Converting Sets of Polygons to
/// Manifold Surfaces"). Before that the lesser number of faces of each part is turned, so that all
/// face one way; parts where that is impossible stay as they are. Faces keep their order.
ManifoldParts manifold_parts(const TriangleMesh& mesh);

}  // namespace surfel
