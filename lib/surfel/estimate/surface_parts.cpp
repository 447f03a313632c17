// Kruskal, "On the shortest spanning subtree of a graph", 1956.

#include <algorithm>
#include <memory>

#include <surfel/base/disjoint_sets.h>
#include <surfel/base/parallel.h>
#include <surfel/estimate/surface_edges.h>
#include <surfel/estimate/surface_parts.h>

namespace surfel {
namespace {

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

}  // namespace

bool PartJoins::before(const PartJoin& a, const PartJoin& b) const {
  if (a.weight != b.weight) return a.weight < b.weight;
  if (a.place.number != b.place.number) return order_(a.place, b.place);
  return a.rank < b.rank;
}

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
  std::sort(joins_.begin(), joins_.end(),
            [&](const PartJoin& a, const PartJoin& b) { return before(a, b); });
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

void find_joins(const JoinPoints& points, const NeighborSearch& search,
                FunctionRef<bool(std::size_t)> comes, FunctionRef<bool(std::size_t)> counts,
                PartJoins& joins) {
  const std::size_t count = points.position.size();
  const SurfaceEdges edges(points.position, points.normal);
  PerWorker<PartJoins> found([&] { return std::make_unique<PartJoins>(joins.order()); });
  const auto look = [&](std::size_t i, std::span<const Neighbor> near, int worker) {
    if (!counts(i)) return;
    for (std::size_t rank = 0; rank < near.size(); ++rank) {
      const std::uint32_t j = near[rank].index;
      if (points.part[j] == points.part[i] || !edges.known(j)) continue;
      const float w = edges.weight(i, j);
      if (!(w < kJoinWeight)) continue;
      const bool signs_differ = points.opposed[i] != points.opposed[j];
      found[worker].add(
          {.place = {points.position[i], points.number.empty() ? i : points.number[i]},
           .weight = w,
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
  found.for_each([&](const PartJoins& some) { joins.add(some); });
}

std::size_t PartVotes::parts(Orientation method) {
  return kBytes / sizeof(Extreme) / probes(method).size();
}

PartVotes::PartVotes(Orientation method, std::uint32_t first, std::size_t count,
                     const CurveOrder& order)
    : first_(first),
      count_(count),
      order_(order),
      directions_(probes(method)),
      extreme_(count * directions_.size()) {}

void PartVotes::add(const Points& points) {
  parallel_each(directions_.size(), 1, [&](std::size_t d) {
    const Vec3f direction = directions_[d];
    Extreme* const extremes = extreme_.data() + d * count_;
    for (std::size_t i = 0; i < points.position.size(); ++i) {
      const std::uint32_t part = points.part[i];
      if (part == kNoPart || part < first_ || part - first_ >= count_) continue;
      Extreme& most = extremes[part - first_];
      const float along = points.position[i].dot(direction);
      if (most.any && along < most.along) continue;
      const CurvePlace place{points.position[i], points.first + i};
      if (most.any && along == most.along && !order_(place, most.place)) continue;
      most = {place, along, points.normal[i].dot(direction), points.turned[i] != 0, true};
    }
  });
}

std::vector<bool> PartVotes::turned() const {
  std::vector<bool> out(count_);
  for (std::size_t part = 0; part < count_; ++part) {
    double vote = 0;
    bool last_turned = false;
    for (std::size_t d = 0; d < directions_.size(); ++d) {
      const Extreme& most = extreme_[d * count_ + part];
      if (!most.any) continue;
      vote += static_cast<double>(most.normal);
      last_turned = most.turned;
    }
    out[part] = vote < 0 || (vote == 0 && last_turned);
  }
  return out;
}

}  // namespace surfel
