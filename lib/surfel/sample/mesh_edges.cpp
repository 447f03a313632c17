#include <algorithm>
#include <array>
#include <bit>
#include <vector>

#include <surfel/base/disjoint_sets.h>
#include <surfel/base/parallel.h>
#include <surfel/base/radix_sort.h>
#include <surfel/base/random.h>
#include <surfel/sample/mesh_edges.h>

namespace surfel {
namespace {

constexpr std::size_t kEdgeGrain = 1 << 14;

}  // namespace

Array<std::uint32_t> welded_vertices(const Array<Vec3f>& position) {
  Array<std::uint64_t> keys(position.size());
  parallel_each(position.size(), kEdgeGrain, [&](std::size_t i) {
    const Vec3f p = position[i] + Vec3f::Zero();  // -0 becomes 0, to which it is equal.
    const auto xy = static_cast<std::uint64_t>(std::bit_cast<std::uint32_t>(p.x())) << 32 |
                    std::bit_cast<std::uint32_t>(p.y());
    keys[i] = random_bits(xy, std::bit_cast<std::uint32_t>(p.z()));
  });
  const Array<std::uint32_t> order = sort_keys(keys);
  Array<std::uint32_t> welded(position.size());
  for (std::size_t begin = 0, end; begin < order.size(); begin = end) {
    for (end = begin + 1; end < order.size() && keys[end] == keys[begin]; ++end) {
    }
    // All points of a run are at one place, unless hashes collide or they are not finite.
    for (std::size_t i = begin; i < end; ++i) {
      std::size_t first = begin;
      while (first < i && position[order[first]] != position[order[i]]) ++first;
      welded[order[i]] = order[first];
    }
  }
  return welded;
}

Array<std::array<std::uint32_t, 3>> welded_faces(const TriangleMesh& mesh) {
  const Array<std::uint32_t> welded = welded_vertices(mesh.position);
  Array<std::array<std::uint32_t, 3>> face(mesh.face.size());
  parallel_each(face.size(), kEdgeGrain, [&](std::size_t f) {
    for (int k = 0; k < 3; ++k) face[f][k] = welded[mesh.face[f][k]];
  });
  return face;
}

Array<std::uint32_t> repeated_faces(const Array<std::array<std::uint32_t, 3>>& welded) {
  const auto from_lowest = [&](std::uint32_t f) {
    std::array<std::uint32_t, 3> face = welded[f];
    std::rotate(face.begin(), std::min_element(face.begin(), face.end()), face.end());
    return face;
  };
  Array<std::uint64_t> keys(welded.size());
  parallel_each(welded.size(), kEdgeGrain, [&](std::size_t f) {
    const std::array<std::uint32_t, 3> face = from_lowest(static_cast<std::uint32_t>(f));
    keys[f] = random_bits(face[0], face[1], face[2]);
  });
  const Array<std::uint32_t> order = sort_keys(keys);
  Array<std::uint32_t> repeats;
  for (std::size_t begin = 0, end; begin < order.size(); begin = end) {
    for (end = begin + 1; end < order.size() && keys[end] == keys[begin]; ++end) {
    }
    // All faces of a run are alike, unless hashes collide.
    for (std::size_t i = begin + 1; i < end; ++i) {
      const std::array<std::uint32_t, 3> face = from_lowest(order[i]);
      if (face[0] == face[1] || face[1] == face[2]) continue;
      std::size_t first = begin;
      while (first < i && from_lowest(order[first]) != face) ++first;
      if (first < i) repeats.push_back(order[i]);
    }
  }
  std::sort(repeats.begin(), repeats.end());
  return repeats;
}

Array<std::uint32_t> edge_rings(const TriangleMesh& mesh) { return edge_rings(welded_faces(mesh)); }

Array<std::uint32_t> edge_rings(const Array<std::array<std::uint32_t, 3>>& face) {
  const std::size_t edges = 3 * face.size();
  Array<std::uint64_t> keys(edges);
  parallel_each(face.size(), kEdgeGrain, [&](std::size_t f) {
    for (int k = 0; k < 3; ++k) {
      const std::uint64_t a = face[f][k];
      const std::uint64_t b = face[f][(k + 1) % 3];
      keys[3 * f + k] = std::min(a, b) << 32 | std::max(a, b);
    }
  });
  const Array<std::uint32_t> order = sort_keys(keys);
  Array<std::uint32_t> rings(edges);
  for (std::size_t begin = 0, end; begin < edges; begin = end) {
    for (end = begin + 1; end < edges && keys[end] == keys[begin]; ++end) {
      rings[order[end - 1]] = order[end];
    }
    const std::uint64_t key = keys[begin];
    const bool collapsed = key >> 32 == (key & 0xffffffff);
    rings[order[end - 1]] = end == begin + 1 ? kBorderEdge : order[begin];
    for (std::size_t i = begin; collapsed && i < end; ++i) rings[order[i]] = kBorderEdge;
  }
  return rings;
}

void cut_crowded_edges(Array<std::uint32_t>& rings, std::size_t most) {
  std::vector<bool> counted(rings.size());
  std::vector<std::uint32_t> ring;
  for (std::uint32_t e = 0; e < rings.size(); ++e) {
    ring.clear();
    for (std::uint32_t at = e; at != kBorderEdge && !counted[at]; at = rings[at]) {
      counted[at] = true;
      ring.push_back(at);
    }
    if (ring.size() <= most) continue;
    for (const std::uint32_t member : ring) rings[member] = kBorderEdge;
  }
}

EdgeCounts count_edges(const TriangleMesh& mesh, const Array<std::uint32_t>& rings) {
  EdgeCounts counts;
  for (std::size_t e = 0; e < rings.size(); ++e) {
    const std::array<std::uint32_t, 3>& face = mesh.face[e / 3];
    const Vec3f& from = mesh.position[face[e % 3]];
    const Vec3f& to = mesh.position[face[(e % 3 + 1) % 3]];
    if (from == to) continue;
    const std::size_t next = rings[e];
    if (next == kBorderEdge) {
      ++counts.border;
      counts.border_length += (to - from).cast<double>().norm();
    } else if (next < e) {  // Once for each ring, at its last member.
      const bool pair = rings[next] == e;
      counts.non_manifold += pair ? 0 : 1;
      counts.inconsistent += pair && mesh.position[mesh.face[next / 3][next % 3]] == from ? 1 : 0;
    }
  }
  return counts;
}

Array<std::uint32_t> face_components(const Array<std::uint32_t>& rings) {
  Array<std::uint32_t> component(rings.size() / 3);
  DisjointSets sets(component.size());
  for (std::size_t e = 0; e < rings.size(); ++e) {
    if (rings[e] != kBorderEdge) sets.unite(static_cast<std::uint32_t>(e / 3), rings[e] / 3);
  }
  for (std::uint32_t f = 0; f < component.size(); ++f) component[f] = sets.root(f);
  return component;
}

}  // namespace surfel
