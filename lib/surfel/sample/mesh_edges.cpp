#include <algorithm>
#include <bit>

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
    // All points of a run are at one place, unless hashes collide.
    for (std::size_t i = begin; i < end; ++i) {
      std::size_t first = begin;
      while (position[order[first]] != position[order[i]]) ++first;
      welded[order[i]] = order[first];
    }
  }
  return welded;
}

Array<std::uint32_t> edge_rings(const TriangleMesh& mesh) {
  const Array<std::uint32_t> welded = welded_vertices(mesh.position);
  const std::size_t edges = 3 * mesh.face.size();
  Array<std::uint64_t> keys(edges);
  parallel_each(mesh.face.size(), kEdgeGrain, [&](std::size_t f) {
    for (int k = 0; k < 3; ++k) {
      const std::uint64_t a = welded[mesh.face[f][k]];
      const std::uint64_t b = welded[mesh.face[f][(k + 1) % 3]];
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
