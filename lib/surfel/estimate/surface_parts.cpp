// Kruskal, "On the shortest spanning subtree of a graph", 1956.

#include <algorithm>
#include <memory>

#include <surfel/base/disjoint_sets.h>
#include <surfel/base/parallel.h>
#include <surfel/estimate/surface_edges.h>
#include <surfel/estimate/surface_parts.h>

namespace surfel {
namespace {

/// Parts are joined by edges below this weight, to the kJoinNeighbors nearest points.
constexpr float kJoinWeight = 0.1F;
constexpr std::size_t kJoinNeighbors = 64;
constexpr std::size_t kPartGrain = 1024;

/// Directions that the extreme points of a part are looked for in.
std::vector<Vec3f> probes(Orientation method) {
  if (method != Orientation::kOutward) return {Vec3f(0, 0, 1)};
  std::vector<Vec3f> out;
  for (const float x : {-1.0F, 0.0F, 1.0F}) {
    for (const float y : {-1.0F, 0.0F, 1.0F}) {
      for (const float z : {-1.0F, 0.0F, 1.0F}) {
        const Vec3f d(x, y, z);
        if (!d.isZero(0)) out.push_back(d.normalized());
      }
    }
  }
  return out;
}

/// Does an edge come before another in Kruskal's algorithm?
bool precedes(const PartJoin& a, const PartJoin& b) {
  if (a.weight != b.weight) return a.weight < b.weight;
  return a.point != b.point ? a.point < b.point : a.rank < b.rank;
}

}  // namespace

void PartJoins::add(const PartJoin& join) {
  if (joins_.size() == most_) {
    // Half as many again are added before the next search, so that searches take as long as sorting
    // all edges once or a few times.
    most_ = std::max(kFew, forest().size() / 2 * 3);
  }
  if (joins_.size() == joins_.capacity()) {
    joins_.reserve(std::min(most_, std::max(kFew, 2 * joins_.size())));
  }
  joins_.push_back(join);
}

void PartJoins::add(const PartJoins& more) {
  for (const PartJoin& join : more.joins_) add(join);
}

std::span<const PartJoin> PartJoins::forest() {
  std::sort(joins_.begin(), joins_.end(), precedes);
  std::vector<std::uint32_t> parts;
  parts.reserve(2 * joins_.size());
  for (const PartJoin& join : joins_) parts.insert(parts.end(), {join.from, join.to});
  std::sort(parts.begin(), parts.end());
  parts.erase(std::unique(parts.begin(), parts.end()), parts.end());
  const auto place = [&](std::uint32_t part) {
    return static_cast<std::uint32_t>(std::lower_bound(parts.begin(), parts.end(), part) -
                                      parts.begin());
  };
  DisjointSets sets(parts.size());
  std::erase_if(
      joins_, [&](const PartJoin& join) { return !sets.unite(place(join.from), place(join.to)); });
  return joins_;
}

PartJoins find_joins(const PartPoints& points, const NeighborSearch& search,
                     const Array<std::uint8_t>& opposed, std::uint32_t largest) {
  const std::size_t count = points.position.size();
  const SurfaceEdges edges(points.position, points.normal);
  const auto comes = [&](std::size_t i) { return edges.known(i) && points.part[i] != largest; };
  PerWorker<PartJoins> found;
  const auto look = [&](std::size_t i, std::span<const Neighbor> near, int worker) {
    for (std::size_t rank = 0; rank < near.size(); ++rank) {
      const std::uint32_t j = near[rank].index;
      if (points.part[j] == points.part[i] || !edges.known(j)) continue;
      const float w = edges.weight(i, j);
      if (!(w < kJoinWeight)) continue;
      const bool signs_differ = opposed[i] != opposed[j];
      found[worker].add({.weight = w,
                         .point = static_cast<std::uint32_t>(i),
                         .from = points.part[i],
                         .to = points.part[j],
                         .rank = static_cast<std::uint8_t>(rank),
                         .opposed = edges.opposed(i, j) != signs_differ});
    }
  };
  if (2 * count_where(count, comes) > count) {
    // A search for all points takes less time than one for each of most of them.
    search.for_each_nearest(kJoinNeighbors,
                            [&](std::size_t i, std::span<const Neighbor> near, int worker) {
                              if (comes(i)) look(i, near, worker);
                            });
  } else {
    PerWorker<std::vector<Neighbor>> scratch;
    parallel_for(count, kPartGrain, [&](std::size_t begin, std::size_t end, int worker) {
      for (std::size_t i = begin; i < end; ++i) {
        if (!comes(i)) continue;
        search.nearest(points.position[i], kJoinNeighbors, scratch[worker]);
        look(i, scratch[worker], worker);
      }
    });
  }
  PartJoins joins;
  found.for_each([&](const PartJoins& some) { joins.add(some); });
  return joins;
}

std::vector<bool> parts_to_turn(const PartPoints& points, std::size_t parts,
                                const Array<std::uint8_t>& turned, Orientation method) {
  const std::vector<Vec3f> directions = probes(method);
  const Array<Vec3f>& position = points.position;
  // The furthest points, by direction, then part.
  std::vector<std::uint32_t> furthest(directions.size() * parts, PartPoints::kNoPart);
  parallel_each(directions.size(), 1, [&](std::size_t d) {
    for (std::uint32_t i = 0; i < position.size(); ++i) {
      if (points.part[i] == PartPoints::kNoPart) continue;
      std::uint32_t& most = furthest[d * parts + points.part[i]];
      if (most == PartPoints::kNoPart ||
          position[i].dot(directions[d]) > position[most].dot(directions[d])) {
        most = i;
      }
    }
  });
  std::vector<bool> out(parts);
  for (std::size_t part = 0; part < parts; ++part) {
    double vote = 0;
    for (std::size_t d = 0; d < directions.size(); ++d) {
      const Vec3f& normal = points.normal[furthest[d * parts + part]];
      vote += static_cast<double>(normal.dot(directions[d]));
    }
    const std::uint32_t last = furthest[(directions.size() - 1) * parts + part];
    out[part] = vote < 0 || (vote == 0 && turned[last] != 0);
  }
  return out;
}

}  // namespace surfel
