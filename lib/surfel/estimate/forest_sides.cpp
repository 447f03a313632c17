// Kruskal, "On the shortest spanning subtree of a graph", 1956.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/estimate/forest_sides.h>

namespace surfel {
namespace {

constexpr std::size_t kForestGrain = std::size_t{1} << 14;
constexpr std::uint32_t kNoneLeaves = std::numeric_limits<std::uint32_t>::max();

/// Bytes that an edge between blocks takes while their ends are sorted, or one that is left of a
/// block while their array grows.
constexpr std::uint64_t kEdgeBytes = 100;
/// Bytes of a set with its part.
constexpr std::uint64_t kSetBytes = 36;

/// Values of a file by their numbers, which may be in any order.
template <class T>
Array<T> values_at(const ScratchFile& file, std::span<const std::uint64_t> numbers) {
  // Values between those that are asked for are read as well, as long as they are few.
  constexpr std::uint64_t kMostBetween = 256;
  constexpr std::uint64_t kMostTogether = std::uint64_t{1} << 16;
  Array<std::uint32_t> order(numbers.size());
  std::iota(order.begin(), order.end(), 0U);
  std::sort(order.begin(), order.end(),
            [&](std::uint32_t a, std::uint32_t b) { return numbers[a] < numbers[b]; });
  Array<T> out(numbers.size());
  Array<T> read;
  for (std::size_t begin = 0; begin < order.size();) {
    const std::uint64_t first = numbers[order[begin]];
    std::uint64_t last = first;
    std::size_t end = begin + 1;
    for (; end < order.size(); ++end) {
      const std::uint64_t next = numbers[order[end]];
      if (next - last > kMostBetween || next - first >= kMostTogether) break;
      last = next;
    }
    read.resize(last - first + 1);
    file.read_at(first * sizeof(T), read.data(), read.size() * sizeof(T));
    for (; begin < end; ++begin) out[order[begin]] = read[numbers[order[begin]] - first];
  }
  return out;
}

/// Unites sets along edges in their order.
template <class Edges>
void unite_along(const Edges& edges, SignedSets& sets) {
  for (const auto& edge : edges) {
    sets.unite(edge.ends[0], edge.ends[1], [&] { return edge.differ != 0; });
  }
}

}  // namespace

ForestSides::ForestSides(std::size_t count, const MortonGrid& grid, Options options)
    : count_(count),
      order_(grid),
      options_(std::move(options)),
      points_(options_.beside),
      point_set_(options_.beside) {
  inner_.emplace(options_.beside);
  const std::uint64_t needed = count_ * bytes_on_disk();
  if (points_.free_bytes() < needed) {
    throw_io(options_.beside,
             fmt::format("the sides of {} points take {:.3g} GB on its disk while they are found, "
                         "and {:.3g} GB are left; make room, or orient by another method",
                         count_, static_cast<double>(needed) / 1e9,
                         static_cast<double>(points_.free_bytes()) / 1e9));
  }
  require_memory(1);
}

/// \param share_done  of the points, 0..1: the rest will need as much as these points.
void ForestSides::require_memory(double share_done) const {
  const auto found =
      static_cast<double>(edges_.size() * kEdgeBytes + set_points_.size() * kSetBytes);
  require_bytes(found / share_done);
}

/// \param needed  bytes, besides a bit a point.
void ForestSides::require_bytes(double needed) const {
  needed += static_cast<double>(count_) / 8;
  if (needed <= static_cast<double>(options_.memory)) return;
  const double share = static_cast<double>(options_.of_memory) /
                       static_cast<double>(std::max<std::uint64_t>(1, options_.memory));
  throw_usage(fmt::format(
      "{} bytes of memory are too few to find the sides of {} points along the surface: give at "
      "least {:.0f} bytes, or orient by winding",
      options_.of_memory, count_, std::ceil(needed * share)));
}

void ForestSides::require_room_for(PartJoins& joins, double share_done) const {
  const auto sets = static_cast<double>(set_points_.size() * kSetBytes);
  const auto parts = static_cast<double>(part_points_.size());
  const double expected = std::min(parts, static_cast<double>(joins.forest().size()) / share_done);
  require_bytes(sets + expected * static_cast<double>(PartJoins::kJoinBytes));
}

bool ForestSides::before(const Edge& a, const Edge& b) const {
  if (a.length != b.length) return a.length < b.length;
  if (a.number != b.number) return order_({a.position, a.number}, {b.position, b.number});
  return a.place < b.place;
}

void ForestSides::add(const BlockForest& block) {
  const std::size_t begin = added_;
  added_ += block.points_.size();
  points_.append(block.points_.data(), block.points_.size() * sizeof(Point));
  const std::uint64_t at =
      inner_->append(block.inner_.data(), block.inner_.size() * sizeof(InnerEdge));
  blocks_.push_back({begin, added_, at, block.inner_.size()});
  edges_.insert(edges_.end(), block.leaving_.begin(), block.leaving_.end());
  require_memory(static_cast<double>(added_) / static_cast<double>(count_));
}

/// Sorts the edges between blocks, and finds their ends, with the shortest edge of each.
void ForestSides::find_borders() {
  std::sort(edges_.begin(), edges_.end(),
            [&](const Edge& a, const Edge& b) { return before(a, b); });
  struct End {
    std::uint64_t number;
    std::uint32_t edge;
    std::uint32_t end;
  };
  std::vector<End> ends;
  ends.reserve(2 * edges_.size());
  for (std::uint32_t e = 0; e < edges_.size(); ++e) {
    const Edge& edge = edges_[e];
    ends.push_back({edge.number, e, 0});
    ends.push_back({std::uint64_t{edge.ends[1]} << 32 | edge.ends[0], e, 1});
  }
  std::sort(ends.begin(), ends.end(), [](const End& a, const End& b) {
    return a.number != b.number ? a.number < b.number : a.edge < b.edge;
  });
  for (const End& end : ends) {
    if (borders_.empty() || borders_.back().number != end.number) {
      borders_.push_back({end.number, end.edge, 0, 0});
    }
    edges_[end.edge].ends[end.end] = static_cast<std::uint32_t>(borders_.size() - 1);
  }
}

/// Unites the points of a block along edges that are surely in the forest; the others are left.
void ForestSides::contract(const Block& block, std::span<Border> borders) {
  const std::size_t count = block.end - block.begin;
  Array<Point> points(count);
  points_.read_at(block.begin * sizeof(Point), points.data(), count * sizeof(Point));
  std::vector<InnerEdge> inner(block.edges);
  inner_->read_at(block.edges_at, inner.data(), inner.size() * sizeof(InnerEdge));
  SignedSets sets(count);
  Array<std::uint32_t> shortest;  // Of the edges between blocks: of a point, then of a set's root.
  shortest.assign(count, kNoneLeaves);
  for (const Border& border : borders) shortest[border.number - block.begin] = border.shortest;

  const auto whole = [&](const InnerEdge& e) {
    return Edge{points[e.from].position, e.length,      e.place, e.differ,
                block.begin + e.from,    {e.from, e.to}};
  };
  const std::size_t first_left = edges_.size();
  for (const InnerEdge& e : inner) {
    // Edges come in ascending order. A shorter one within the block that leaves either set has
    // been passed over because one to another block was shorter still.
    const SignedSets::Root a = sets.find(e.from);
    const SignedSets::Root b = sets.find(e.to);
    const std::uint32_t out_a = shortest[a.index];
    const std::uint32_t out_b = shortest[b.index];
    const std::uint32_t longer = std::max(out_a, out_b);
    if (longer == kNoneLeaves || before(whole(e), edges_[longer])) {
      shortest[sets.join(a, b, e.differ != 0)] = std::min(out_a, out_b);
    } else {
      edges_.push_back(whole(e));
    }
  }

  Array<std::uint32_t> set_of_root;
  set_of_root.assign(count, kNoSet);
  Array<PointSet> point_set(count);
  for (std::uint32_t i = 0; i < count; ++i) {
    point_set[i] = {};
    if (points[i].normal.isZero(0)) continue;
    const SignedSets::Root root = sets.find(i);
    std::uint32_t& set = set_of_root[root.index];
    if (set == kNoSet) {
      set = static_cast<std::uint32_t>(set_points_.size());
      if (set == kNoSet) {
        throw_usage(
            fmt::format("the surface of {} points is in more than {} pieces: orient by "
                        "winding",
                        count_, set));
      }
      set_points_.push_back(0);
    }
    ++set_points_[set];
    point_set[i] = PointSet::of(set, root.opposed);
  }
  point_set_.append(point_set.data(), count * sizeof(PointSet));
  const auto to_sets = [&](std::uint32_t& end, std::uint8_t& differ) {
    differ = static_cast<std::uint8_t>(differ ^ (point_set[end].opposed() ? 1 : 0));
    end = point_set[end].set();
  };
  for (std::size_t e = first_left; e < edges_.size(); ++e) {
    for (std::uint32_t& end : edges_[e].ends) to_sets(end, edges_[e].differ);
  }
  for (Border& border : borders) {
    const PointSet at = point_set[border.number - block.begin];
    border.set = at.set();
    border.opposed = at.opposed() ? 1 : 0;
  }
}

void ForestSides::unite() {
  find_borders();
  const std::size_t between = edges_.size();
  auto next = borders_.begin();
  for (const Block& block : blocks_) {
    const auto end =
        std::find_if(next, borders_.end(), [&](const Border& b) { return b.number >= block.end; });
    contract(block, {next, end});
    next = end;
    require_memory(1);
  }
  for (std::size_t e = 0; e < between; ++e) {
    Edge& edge = edges_[e];
    for (std::uint32_t& end : edge.ends) {
      const Border& border = borders_[end];
      edge.differ = static_cast<std::uint8_t>(edge.differ ^ border.opposed);
      end = border.set;
    }
  }
  borders_ = {};
  inner_.reset();
  std::sort(edges_.begin(), edges_.end(),
            [&](const Edge& a, const Edge& b) { return before(a, b); });
  SignedSets united(set_points_.size());
  unite_along(edges_, united);
  edges_ = {};
  sets_.resize(united.size());
  for (std::uint32_t set = 0; set < sets_.size(); ++set) sets_[set] = {set, 0};
  number_parts(united);
  if (looks_for_joins()) find_largest();
}

/// Numbers the parts anew that the parts so far are united to.
void ForestSides::number_parts(SignedSets& united) {
  std::vector<std::uint32_t> number(united.size(), PartVotes::kNoPart);
  part_points_.clear();
  for (std::uint32_t set = 0; set < sets_.size(); ++set) {
    const SignedSets::Root root = united.find(sets_[set].part);
    std::uint32_t& part = number[root.index];
    if (part == PartVotes::kNoPart) {
      part = static_cast<std::uint32_t>(part_points_.size());
      part_points_.push_back(0);
    }
    part_points_[part] += set_points_[set];
    sets_[set] = {part, static_cast<std::uint8_t>(sets_[set].opposed ^ (root.opposed ? 1 : 0))};
  }
}

template <class Body>
void ForestSides::for_each_block(const Body& body) const {
  for (const Block& block : blocks_) {
    const std::size_t count = block.end - block.begin;
    Array<Point> points(count);
    points_.read_at(block.begin * sizeof(Point), points.data(), count * sizeof(Point));
    Array<PointSet> point_set(count);
    point_set_.read_at(block.begin * sizeof(PointSet), point_set.data(), count * sizeof(PointSet));
    body(block.begin, points, point_set);
  }
}

/// Finds the part of the most points; of several, the part of the lowest point along the curve.
void ForestSides::find_largest() {
  const std::uint64_t most = *std::max_element(part_points_.begin(), part_points_.end());
  if (std::count(part_points_.begin(), part_points_.end(), most) == 1) {
    const auto at = std::find(part_points_.begin(), part_points_.end(), most);
    largest_ = static_cast<std::uint32_t>(at - part_points_.begin());
    return;
  }
  CurvePlace lowest;
  for_each_block(
      [&](std::uint64_t first, const Array<Point>& points, const Array<PointSet>& point_set) {
        for (std::size_t i = 0; i < points.size(); ++i) {
          const std::uint32_t part = part_of(point_set[i]);
          if (part == PartVotes::kNoPart || part_points_[part] != most) continue;
          const CurvePlace place{points[i].position, first + i};
          if (largest_ != PartVotes::kNoPart && !order_(place, lowest)) continue;
          largest_ = part;
          lowest = place;
        }
      });
}

ForestSides::Parts ForestSides::parts_of(std::span<const std::uint64_t> numbers) const {
  const Array<Point> points = values_at<Point>(points_, numbers);
  const Array<PointSet> point_set = values_at<PointSet>(point_set_, numbers);
  Parts out;
  out.normal.resize(numbers.size());
  out.part.resize(numbers.size());
  out.opposed.resize(numbers.size());
  parallel_each(numbers.size(), kForestGrain, [&](std::size_t i) {
    out.normal[i] = points[i].normal;
    out.part[i] = part_of(point_set[i]);
    out.opposed[i] = opposed(point_set[i]);
  });
  return out;
}

void ForestSides::join(PartJoins& joins) {
  SignedSets united(part_points_.size());
  for (const PartJoin& join : joins.forest()) {
    united.unite(join.from, join.to, [&] { return join.opposed; });
  }
  number_parts(united);
}

TurnedPoints ForestSides::turn() const {
  std::vector<bool> turn;
  while (turn.size() < part_points_.size()) {
    const std::size_t some =
        std::min(PartVotes::parts(options_.method), part_points_.size() - turn.size());
    PartVotes votes(options_.method, static_cast<std::uint32_t>(turn.size()), some, order_);
    for_each_block(
        [&](std::uint64_t first, const Array<Point>& points, const Array<PointSet>& point_set) {
          const std::size_t count = points.size();
          Array<Vec3f> position(count), normal(count);
          Array<std::uint32_t> part(count);
          Array<std::uint8_t> turned(count);
          parallel_each(count, kForestGrain, [&](std::size_t i) {
            position[i] = points[i].position;
            turned[i] = opposed(point_set[i]);
            normal[i] = turned[i] != 0 ? Vec3f(-points[i].normal) : points[i].normal;
            part[i] = part_of(point_set[i]);
          });
          votes.add({position, normal, part, turned, first});
        });
    const std::vector<bool> told = votes.turned();
    turn.insert(turn.end(), told.begin(), told.end());
  }
  TurnedPoints out{part_points_.size(), std::vector<std::uint64_t>((count_ + 63) / 64)};
  for_each_block(
      [&](std::uint64_t first, const Array<Point>& points, const Array<PointSet>& point_set) {
        for (std::size_t i = 0; i < points.size(); ++i) {
          const std::uint32_t part = part_of(point_set[i]);
          if (part == PartVotes::kNoPart) continue;
          const std::uint64_t bit = (opposed(point_set[i]) != 0) != turn[part] ? 1 : 0;
          out.turned[(first + i) / 64] |= bit << (first + i) % 64;
        }
      });
  return out;
}

}  // namespace surfel
