#pragma once

#include <cstddef>
#include <cstdint>

namespace surfel {

// The library and the plug-in libsurfel_openmesh.so hand raw numbers to one another.

/// Triangles for half-edges. Every vertex has faces, which form one fan, and an edge has at most
/// two.
struct HalfEdgeMesh {
  const double* position = nullptr;  ///< x y z of the vertices, finite.
  std::size_t vertices = 0;
  const std::uint32_t* face = nullptr;  ///< Three vertices' numbers each.
  std::size_t faces = 0;
  /// Element 3 f + k: whether edge k of face f (from corner k to corner k + 1) is a border in the
  /// file, and no edge that was cut.
  const unsigned char* is_border = nullptr;
  double crease_angle = 0;  ///< Radians.
};

/// Lengths are in the positions' units.
struct HalfEdgeReport {
  std::size_t components = 0;
  std::size_t open_edges = 0;    ///< Edges of a single face, borders of the file or not.
  std::size_t border_loops = 0;  ///< Loops of open edges that hold a border of the file.
  double longest_border = 0;     ///< Length of borders of the file in the longest loop.
  std::size_t crease_edges = 0;  ///< Edges whose two faces meet at more than `crease_angle`.
  double crease_length = 0;
  std::int64_t euler_characteristic = 0;  ///< Vertices - edges + faces.
};

/// Throws Error(kNumeric) where OpenMesh refuses a face.
using MeasureHalfEdges = void(const HalfEdgeMesh& mesh, HalfEdgeReport& report);
inline constexpr char kMeasureHalfEdgesSymbol[] = "surfel_measure_half_edges";

}  // namespace surfel
