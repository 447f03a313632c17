#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include <surfel/base/box_tree.h>
#include <surfel/base/export.h>
#include <surfel/base/function_ref.h>
#include <surfel/base/types.h>
#include <surfel/scene/clips.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

/// The lines at which samples of a mesh end: its borders, its creases (where faces meet at more
/// than an angle), and edges of three faces or more. Faces that other edges connect are a patch.
class SURFEL_API MeshClips {
 public:
  /// A half-plane in a sample's tangent plane that leaves the sample itself.
  using Line = HalfPlane;
  struct Lines {
    std::array<Line, 2> line;
    int count = 0;
    /// The lines meet at a reflex corner: what lies within either of them is left. One of them may
    /// cut off the sample itself. All samples around a corner have them in the same order.
    bool either = false;
  };

  /// \param rings  edge_rings() of the mesh.
  /// \param crease_angle  radians.
  MeshClips(const TriangleMesh& mesh, const Array<std::uint32_t>& rings, double crease_angle);

  /// Whether there are no edges that samples end at.
  bool empty() const { return edges_.empty(); }
  /// Number of edges at which two faces meet at a crease.
  std::size_t creases() const { return creases_.size() / 2; }
  /// Makes creases borders that cut discs of samples on them, so that either side is sampled for
  /// itself.
  /// \param rings  edge_rings() of the mesh, as the constructor had them.
  /// \param reach_at  Radius of discs at a place.
  Array<std::uint32_t> cut_creases(const TriangleMesh& mesh, const Array<std::uint32_t>& rings,
                                   FunctionRef<double(const Vec3d&)> reach_at) const;
  /// The lines that cut the disc of radius `reach` around a sample, at most two, nearest first:
  /// - edges of the sample's own patch alone count, of faces that agree with its normal;
  /// - a line must follow edges over nearly half of its chord of the disc at least. Shorter edges,
  ///   as of holes smaller than the disc or where a crease fades out, cut nothing, as the surface
  ///   goes on around them;
  /// - where edges meet at a reflex corner, what lies beyond both of their lines is cut off
  ///   (Lines::either). Where there is no corner of two edges, as where it is cut or curved, the
  ///   nearer line alone cuts, as the surface goes on beyond the other.
  /// Thus no line cuts off surface that no other sample covers.
  Lines around(std::uint32_t face, const Vec3d& place, const Vec3d& normal, double reach) const;

 private:
  /// An edge as one of its faces sees it.
  struct Edge {
    Vec3d from, to;
    Vec3d outward;  ///< Unit: in the face's plane, away from the face.
    std::uint32_t patch;
  };
  /// An edge in a sample's tangent plane, relative to the sample.
  struct FlatEdge {
    Vec3d from, to;
    Line line;
    double away;          ///< Distance of the sample from the edge.
    std::size_t edge;     ///< Among edges_.
    bool beyond = false;  ///< The sample lies beyond the edge's line.
  };
  /// A part of a line, by distances along it from the point nearest to the sample.
  struct Chord {
    double from, to;
  };
  struct Node {
    Vec3d min = Vec3d::Constant(1e300);
    Vec3d max = Vec3d::Constant(-1e300);
    void add(const Node& other) {
      min = min.cwiseMin(other.min);
      max = max.cwiseMax(other.max);
    }
  };

  std::vector<FlatEdge> edges_around(std::uint32_t face, const Vec3d& place, const Vec3d& normal,
                                     double reach) const;
  static bool follows(const Line& line, const Chord& chord, const Vec3d& normal,
                      const std::vector<FlatEdge>& edges, double reach);
  static bool bounds_all(const Line& line, const std::vector<FlatEdge>& edges, double reach);
  static const FlatEdge* neighbor(const FlatEdge& edge, bool forward,
                                  const std::vector<FlatEdge>& edges, double reach);
  static Lines convex_lines(const Vec3d& normal, const std::vector<FlatEdge>& edges, double reach,
                            const FlatEdge*& first);
  static Lines reflex_corner(const FlatEdge& edge, bool lead_on, const Vec3d& normal,
                             const std::vector<FlatEdge>& edges, double reach);

  Array<std::uint32_t> patch_;  ///< By face.
  std::vector<std::uint32_t>
      creases_;  ///< Edges of two faces, as edge_rings() numbers them, from both faces.
  std::vector<Edge> edges_;
  BoxTree<Node, 4, 4> tree_;
};

}  // namespace surfel
