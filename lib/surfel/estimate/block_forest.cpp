#include <algorithm>
#include <array>
#include <cstring>

#include <surfel/base/parallel.h>
#include <surfel/estimate/block_forest.h>
#include <surfel/estimate/spanning_forest.h>

namespace surfel {
namespace {

constexpr std::size_t kForestBlockGrain = std::size_t{1} << 14;

}  // namespace

void BlockEdges::resize(std::size_t points, std::size_t edges) {
  degree = edges;
  to.assign(points * degree, 0);
  length.assign(points * degree, NeighborGraph::kNoEdge);
  opposed.assign(points, 0);
}

void BlockEdges::set(std::size_t point, std::size_t k, std::uint64_t to_number, float weight,
                     bool differ) {
  to[point * degree + k] = to_number;
  length[point * degree + k] = NeighborGraph::length_of(weight);
  if (differ) opposed[point] = static_cast<std::uint16_t>(opposed[point] | 1U << k);
}

BlockForest BlockForest::of(const Array<Vec3f>& position, const Array<Vec3f>& normal,
                            const BlockEdges& edges, std::uint64_t first, const MortonGrid& grid) {
  const std::size_t count = position.size();
  BlockForest out;
  out.points_.resize(count);
  parallel_each(count, kForestBlockGrain, [&](std::size_t i) {
    out.points_[i] = {position[i], normal[i]};
  });

  // The graph's points are along the curve, then come the ends outside of the block.
  std::vector<std::uint64_t> outside;
  for (std::size_t e = 0; e < edges.to.size(); ++e) {
    const bool leaves = edges.to[e] < first || edges.to[e] >= first + count;
    if (leaves && edges.length[e] != NeighborGraph::kNoEdge) outside.push_back(edges.to[e]);
  }
  std::sort(outside.begin(), outside.end());
  outside.erase(std::unique(outside.begin(), outside.end()), outside.end());
  const Array<std::uint32_t> order = morton_order(position, grid);
  Array<std::uint32_t> rank(count);
  for (std::size_t r = 0; r < count; ++r) rank[order[r]] = static_cast<std::uint32_t>(r);
  NeighborGraph graph;
  graph.rows.count = graph.rows.stride = edges.degree;
  graph.rows.kept.resize((count + outside.size()) * edges.degree);
  graph.rows.index = graph.rows.kept.data();
  graph.length.assign(graph.rows.kept.size(), NeighborGraph::kNoEdge);
  parallel_each(count + outside.size(), kForestBlockGrain, [&](std::size_t r) {
    for (std::size_t k = 0; k < edges.degree; ++k) {
      std::uint32_t& to = graph.rows.kept[r * edges.degree + k];
      to = static_cast<std::uint32_t>(r);
      if (r >= count) continue;
      const std::size_t e = order[r] * edges.degree + k;
      if (edges.length[e] == NeighborGraph::kNoEdge) continue;
      graph.length[r * edges.degree + k] = edges.length[e];
      const std::uint64_t number = edges.to[e];
      if (number >= first && number < first + count) {
        to = rank[number - first];
      } else {
        const auto at = std::lower_bound(outside.begin(), outside.end(), number);
        to = static_cast<std::uint32_t>(count + static_cast<std::size_t>(at - outside.begin()));
      }
    }
  });

  for (const std::uint64_t e : spanning_forest_edges(graph)) {
    const std::uint32_t from = order[e / edges.degree];
    const std::size_t k = e % edges.degree;
    const auto place = static_cast<std::uint8_t>(k);
    const auto differ = static_cast<std::uint8_t>(edges.opposed[from] >> k & 1);
    const std::uint32_t to = graph.to(e);
    if (to < count) {
      out.inner_.push_back({from, order[to], graph.length[e], place, differ});
    } else {
      const std::uint64_t number = outside[to - count];
      out.leaving_.push_back(
          {position[from],
           graph.length[e],
           place,
           differ,
           first + from,
           {static_cast<std::uint32_t>(number), static_cast<std::uint32_t>(number >> 32)}});
    }
  }
  return out;
}

Bytes BlockForest::bytes() const {
  Bytes out;
  const auto put = [&](const auto* values, std::size_t count) {
    const auto* const from = reinterpret_cast<const std::byte*>(values);
    out.insert(out.end(), from, from + count * sizeof(*values));
  };
  const std::array<std::uint64_t, 3> sizes{points_.size(), inner_.size(), leaving_.size()};
  put(sizes.data(), sizes.size());
  put(points_.data(), points_.size());
  put(inner_.data(), inner_.size());
  put(leaving_.data(), leaving_.size());
  return out;
}

BlockForest BlockForest::of(const Bytes& bytes) {
  const std::byte* from = bytes.data();
  const auto take = [&](auto* to, std::size_t count) {
    if (count > 0) std::memcpy(static_cast<void*>(to), from, count * sizeof(*to));
    from += count * sizeof(*to);
  };
  std::array<std::uint64_t, 3> sizes{};
  take(sizes.data(), sizes.size());
  BlockForest out;
  out.points_.resize(sizes[0]);
  out.inner_.resize(sizes[1]);
  out.leaving_.resize(sizes[2]);
  take(out.points_.data(), sizes[0]);
  take(out.inner_.data(), sizes[1]);
  take(out.leaving_.data(), sizes[2]);
  return out;
}

}  // namespace surfel
