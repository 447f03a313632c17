#include <utility>

#include <surfel/base/disjoint_sets.h>
#include <surfel/measure/manifold_parts.h>
#include <surfel/sample/mesh_edges.h>

namespace surfel {
namespace {

using Faces = Array<std::array<std::uint32_t, 3>>;
using Rings = Array<std::uint32_t>;

/// Faces with three different finite corners, by welded vertices.
Faces usable_faces(const TriangleMesh& mesh) {
  const Array<std::uint32_t> welded = welded_vertices(mesh.position);
  Faces faces;
  faces.reserve(mesh.face.size());
  for (const auto& face : mesh.face) {
    const std::array<std::uint32_t, 3> at{welded[face[0]], welded[face[1]], welded[face[2]]};
    const auto finite = [&](std::uint32_t v) { return mesh.position[v].allFinite(); };
    const bool different = at[0] != at[1] && at[1] != at[2] && at[2] != at[0];
    if (different && finite(at[0]) && finite(at[1]) && finite(at[2])) faces.push_back(at);
  }
  return faces;
}

/// Vertex where an edge (3 * face + edge) begins.
std::uint32_t start(const Faces& faces, std::uint32_t edge) { return faces[edge / 3][edge % 3]; }

/// The edge's corner at its end, as 3 * face + corner.
std::uint32_t end_corner(std::uint32_t edge) { return edge % 3 == 2 ? edge - 2 : edge + 1; }

/// Whether an edge has two faces: itself and the next in its ring.
bool is_pair(const Rings& rings, std::uint32_t edge) {
  return rings[edge] != kBorderEdge && rings[rings[edge]] == edge;
}

/// Turns the lesser number of faces of each part, so that faces that share an edge run along it in
/// opposite directions.
void orient(Faces& faces, const Rings& rings, ManifoldParts& out) {
  std::vector<unsigned char> seen(faces.size(), 0);
  std::vector<unsigned char> turn(faces.size(), 0);
  std::vector<std::uint32_t> part;  // Faces in the order in which they are reached.
  for (std::uint32_t first = 0; first < faces.size(); ++first) {
    if (seen[first]) continue;
    part.assign(1, first);
    seen[first] = 1;
    bool orientable = true;
    std::size_t turned = 0;
    for (std::size_t i = 0; i < part.size(); ++i) {
      const std::uint32_t f = part[i];
      turned += turn[f];
      for (std::uint32_t e = 3 * f; e < 3 * f + 3; ++e) {
        if (!is_pair(rings, e)) continue;
        const std::uint32_t other = rings[e] / 3;
        const bool same = start(faces, e) == start(faces, rings[e]);
        const auto wanted = static_cast<unsigned char>(same ? 1 - turn[f] : turn[f]);
        if (!seen[other]) {
          seen[other] = 1;
          turn[other] = wanted;
          part.push_back(other);
        }
        orientable = orientable && turn[other] == wanted;
      }
    }
    out.non_orientable_parts += orientable ? 0 : 1;
    if (!orientable || turned == 0) continue;
    const bool others = 2 * turned > part.size();
    for (const std::uint32_t f : part) {
      if ((turn[f] != 0) == others) continue;
      std::swap(faces[f][1], faces[f][2]);
      ++out.turned_faces;
    }
  }
}

/// Corners (3 * face + corner) at each vertex that are in one set.
struct CornerSets {
  explicit CornerSets(std::size_t corners) : fan(corners), touching(corners) {}
  DisjointSets fan;       ///< Connected by edges of two faces that face one way.
  DisjointSets touching;  ///< Connected by any edges.
};

CornerSets connect_corners(const Faces& faces, const Rings& rings) {
  CornerSets sets(rings.size());
  const auto unite = [](DisjointSets& corners, std::uint32_t edge, std::uint32_t other, bool same) {
    corners.unite(edge, same ? other : end_corner(other));
    corners.unite(end_corner(edge), same ? end_corner(other) : other);
  };
  for (std::uint32_t e = 0; e < rings.size(); ++e) {
    if (rings[e] == kBorderEdge) continue;
    const bool same = start(faces, e) == start(faces, rings[e]);
    unite(sets.touching, e, rings[e], same);
    if (!same && is_pair(rings, e)) unite(sets.fan, e, rings[e], same);
  }
  return sets;
}

/// Gives every fan of corners a vertex of its own.
void split_vertices(const Faces& faces, DisjointSets& fan, ManifoldParts& out) {
  out.face.resize(faces.size());
  std::vector<bool> used;
  for (std::uint32_t corner = 0; corner < 3 * faces.size(); ++corner) {
    const std::uint32_t root = fan.root(corner);
    std::uint32_t& number = out.face[corner / 3][corner % 3];
    if (root != corner) {  // A set's root is its first corner, which has its number already.
      number = out.face[root / 3][root % 3];
      continue;
    }
    const std::uint32_t at = start(faces, corner);
    number = static_cast<std::uint32_t>(out.vertex.size());
    out.vertex.push_back(at);
    if (used.size() <= at) used.resize(at + 1, false);
    out.split_vertices += used[at] ? 1 : 0;
    used[at] = true;
  }
}

void find_non_manifold(const TriangleMesh& mesh, const Faces& faces, const Rings& rings,
                       DisjointSets& touching, ManifoldParts& out) {
  const auto add_place = [&](const Vec3d& at) {
    if (out.non_manifold_places.size() < ManifoldParts::kPlaces) {
      out.non_manifold_places.emplace_back(mesh.origin + at);
    }
  };
  const auto place = [&](std::uint32_t corner) {
    return mesh.position[start(faces, corner)].cast<double>();
  };
  std::vector<unsigned char> groups(mesh.position.size(), 0);
  for (std::uint32_t e = 0; e < rings.size(); ++e) {
    // The last member of a ring stands for its edge.
    if (rings[e] < e && !is_pair(rings, e)) add_place((place(e) + place(end_corner(e))) / 2);
  }
  for (std::uint32_t corner = 0; corner < rings.size(); ++corner) {
    if (touching.root(corner) != corner) continue;
    unsigned char& found = groups[start(faces, corner)];
    if (found == 1) {
      ++out.non_manifold_vertices;
      add_place(place(corner));
    }
    if (found < 2) ++found;
  }
}

}  // namespace

ManifoldParts manifold_parts(const TriangleMesh& mesh) {
  ManifoldParts out;
  Faces faces = usable_faces(mesh);
  out.left_out_faces = mesh.face.size() - faces.size();
  Rings rings = edge_rings(faces);
  orient(faces, rings, out);
  // The edges of a turned face have other numbers.
  if (out.turned_faces > 0) rings = edge_rings(faces);
  out.is_border.resize(rings.size());
  for (std::size_t e = 0; e < rings.size(); ++e) out.is_border[e] = rings[e] == kBorderEdge ? 1 : 0;
  CornerSets sets = connect_corners(faces, rings);
  split_vertices(faces, sets.fan, out);
  find_non_manifold(mesh, faces, rings, sets.touching, out);
  return out;
}

}  // namespace surfel
