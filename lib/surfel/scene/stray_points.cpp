#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <unordered_map>
#include <vector>

#include <surfel/scene/stray_points.h>

namespace surfel {
namespace {

/// Up to this number groups are too few to tell the cloud's size: some reach out to strays.
constexpr std::size_t kFewGroups = 512;
/// Share of the points on each side of the box that tells the cloud's size. Strays are fewer.
constexpr double kOuterShare = 0.03;
/// Sides of the cells that points are sorted into, by the cloud's size. Points of neighbouring
/// cells belong together, so that gaps are between 1 and 2 sqrt(3) cells.
constexpr double kCell = 1.0 / 8;
/// The most points of a stray part, as a share and at all, and the most of all together.
constexpr double kMostPart = 1e-3;
constexpr std::uint64_t kMostPartPoints = 100;
constexpr double kMostShare = 5e-3;
/// Diagonal of the box without strays, by that with them, above which strays do not matter.
constexpr double kWorthwhile = 0.8;

using PointsOf = FunctionRef<void(std::size_t group, FunctionRef<void(const Vec3d& point)>)>;

/// Replaces the groups wider than a diameter by their points.
std::vector<PointGroup> refined(std::span<const PointGroup> groups, double most_diameter,
                                const PointsOf& points_of) {
  std::vector<PointGroup> parts;
  for (std::size_t g = 0; g < groups.size(); ++g) {
    if (groups[g].count == 0) continue;
    if (2 * groups[g].radius <= most_diameter) {
      parts.push_back(groups[g]);
    } else {
      points_of(g, [&](const Vec3d& p) {
        if (p.allFinite()) parts.push_back({p, 0, 1});
      });
    }
  }
  return parts;
}

std::uint64_t total(std::span<const PointGroup> groups) {
  return std::accumulate(groups.begin(), groups.end(), std::uint64_t{0},
                         [](std::uint64_t sum, const PointGroup& g) { return sum + g.count; });
}

void add(Bounds& box, const PointGroup& group) {
  box.add(group.center - Vec3d::Constant(group.radius));
  box.add(group.center + Vec3d::Constant(group.radius));
}

/// The box of all peers' boxes.
Bounds joined(const Bounds& mine, Peers* peers) {
  std::vector<double> numbers;
  for (int axis = 0; axis < 3; ++axis) {
    numbers.push_back(mine.min[axis]);
    numbers.push_back(mine.max[axis]);
  }
  Bounds all;
  for (const std::vector<double>& box : gather_lists(peers, numbers)) {
    for (int axis = 0; axis < 3; ++axis) {
      const auto k = static_cast<std::size_t>(2 * axis);
      all.min[axis] = std::min(all.min[axis], box[k]);
      all.max[axis] = std::max(all.max[axis], box[k + 1]);
    }
  }
  return all;
}

/// Whole numbers in the order of the numbers that they stand for, which are not NaN, and back.
std::uint64_t ordered_bits(double value) {
  const auto bits = std::bit_cast<std::uint64_t>(value);
  return bits >> 63 != 0 ? ~bits : bits | std::uint64_t{1} << 63;
}
double from_ordered_bits(std::uint64_t bits) {
  return std::bit_cast<double>(bits >> 63 != 0 ? bits & ~(std::uint64_t{1} << 63) : ~bits);
}

/// As middle_box(), of groups that are spread over peers: the numbers are found bit by bit, from
/// how many of them are below a bound.
Bounds shared_middle_box(std::span<const PointGroup> groups, std::uint64_t all, Peers& peers) {
  const auto outer = static_cast<std::uint64_t>(kOuterShare * static_cast<double>(all));
  std::array<std::vector<std::uint64_t>, 3> sorted;
  for (int axis = 0; axis < 3; ++axis) {
    for (const PointGroup& group : groups) {
      sorted[axis].push_back(ordered_bits(group.center[axis]));
    }
    std::sort(sorted[axis].begin(), sorted[axis].end());
  }
  // Of each axis the number that `outer` are before, and the one that `outer` are after.
  const std::array<std::uint64_t, 2> before{outer, all - 1 - outer};
  std::vector<std::uint64_t> found(6, 0);
  for (int bit = 63; bit >= 0; --bit) {
    std::vector<std::uint64_t> below(6);
    for (std::size_t k = 0; k < 6; ++k) {
      const std::vector<std::uint64_t>& values = sorted[k / 2];
      const std::uint64_t bound = found[k] | std::uint64_t{1} << bit;
      below[k] = static_cast<std::uint64_t>(std::lower_bound(values.begin(), values.end(), bound) -
                                            values.begin());
    }
    std::vector<std::uint64_t> sums(6, 0);
    for (const std::vector<std::uint64_t>& counts : gather_lists(&peers, below)) {
      for (std::size_t k = 0; k < 6; ++k) sums[k] += counts[k];
    }
    for (std::size_t k = 0; k < 6; ++k) {
      if (sums[k] <= before[k % 2]) found[k] |= std::uint64_t{1} << bit;
    }
  }
  Bounds box;
  for (std::size_t k = 0; k < 6; ++k) {
    (k % 2 == 0 ? box.min : box.max)[static_cast<Eigen::Index>(k / 2)] =
        from_ordered_bits(found[k]);
  }
  return box;
}

/// The box of the centres without the outermost of them.
Bounds middle_box(std::span<const PointGroup> groups) {
  std::vector<double> at(groups.size());
  const auto outer = static_cast<std::ptrdiff_t>(kOuterShare * static_cast<double>(at.size()));
  Bounds box;
  for (int axis = 0; axis < 3; ++axis) {
    std::transform(groups.begin(), groups.end(), at.begin(),
                   [axis](const PointGroup& g) { return g.center[axis]; });
    const auto low = at.begin() + outer;
    const auto high = at.end() - 1 - outer;
    std::nth_element(at.begin(), low, at.end());
    box.min[axis] = *low;
    std::nth_element(low, high, at.end());
    box.max[axis] = *high;
  }
  return box;
}

/// Cells of space, and the parts of the cloud that neighbouring ones make.
class Cells {
 public:
  Cells(const Vec3d& origin, double side) : origin_(origin), side_(side) {}

  void add(const PointGroup& group) { cells_[cell_of(group.center)].count += group.count; }

  /// Adds the cells of all peers.
  void share(Peers* peers) {
    if (!peers) return;
    std::vector<std::array<std::uint64_t, 2>> mine;
    for (const auto& [key, cell] : cells_) mine.push_back({key, cell.count});
    cells_.clear();
    for (const auto& cells : gather_lists(peers, mine)) {
      for (const auto& [key, count] : cells) cells_[key].count += count;
    }
  }

  /// Finds the parts.
  void connect() {
    for (auto& [key, cell] : cells_) {
      if (cell.part != kNone) continue;
      std::vector<std::uint64_t> open{key};
      const std::size_t part = counts_.size();
      cell.part = part;
      counts_.push_back(0);
      while (!open.empty()) {
        const std::uint64_t at = open.back();
        open.pop_back();
        counts_.back() += cells_.at(at).count;
        for_each_neighbor(at, [&](std::uint64_t neighbor) {
          const auto found = cells_.find(neighbor);
          if (found == cells_.end() || found->second.part != kNone) return;
          found->second.part = part;
          open.push_back(neighbor);
        });
      }
    }
  }

  /// Points of the part that a group belongs to.
  std::uint64_t part_size(const PointGroup& group) const {
    return counts_[cells_.at(cell_of(group.center)).part];
  }

 private:
  static constexpr std::size_t kNone = ~std::size_t{0};
  static constexpr int kBits = 21;  ///< Of a coordinate in a key.
  /// Cells count from here on; beyond, points lie in the outermost cell.
  static constexpr double kMiddle = 1 << (kBits - 1);

  struct Cell {
    std::uint64_t count = 0;
    std::size_t part = kNone;
  };

  std::uint64_t cell_of(const Vec3d& point) const {
    std::uint64_t key = 0;
    for (int axis = 0; axis < 3; ++axis) {
      const double at = std::floor((point[axis] - origin_[axis]) / side_) + kMiddle;
      key = key << kBits | static_cast<std::uint64_t>(std::clamp(at, 1.0, 2 * kMiddle - 2));
    }
    return key;
  }
  template <class Function>
  static void for_each_neighbor(std::uint64_t key, const Function& function) {
    for (std::uint64_t x = 0; x < 3; ++x) {
      for (std::uint64_t y = 0; y < 3; ++y) {
        for (std::uint64_t z = 0; z < 3; ++z) {
          const std::uint64_t step = x << (2 * kBits) | y << kBits | z;
          constexpr std::uint64_t kOne = std::uint64_t{1} << (2 * kBits) | 1U << kBits | 1U;
          function(key + step - kOne);
        }
      }
    }
  }

  Vec3d origin_;
  double side_;
  std::unordered_map<std::uint64_t, Cell> cells_;
  std::vector<std::uint64_t> counts_;  ///< Points of the parts.
};

}  // namespace

std::optional<CloudCore> find_core(std::span<const PointGroup> groups, PointsOf points_of,
                                   Peers* peers) {
  Bounds whole;
  for (const PointGroup& group : groups) {
    if (group.count > 0) add(whole, group);
  }
  whole = joined(whole, peers);
  const bool few = sum_of(peers, std::uint64_t{groups.size()}) <= kFewGroups;
  const std::vector<PointGroup> measured = refined(groups, few ? 0.0 : whole.diagonal(), points_of);
  const std::uint64_t all_measured = sum_of(peers, std::uint64_t{measured.size()});
  if (all_measured == 0) return std::nullopt;
  const Bounds middle =
      peers ? shared_middle_box(measured, all_measured, *peers) : middle_box(measured);
  const double size = middle.diagonal();
  if (!(size > 0) || size >= kWorthwhile * whole.diagonal()) return std::nullopt;

  const double side = kCell * size;
  const std::vector<PointGroup> parts = refined(groups, side, points_of);
  Cells cells(middle.min, side);
  for (const PointGroup& part : parts) cells.add(part);
  cells.share(peers);
  cells.connect();
  const auto count = static_cast<double>(sum_of(peers, total(parts)));
  const std::uint64_t most =
      std::clamp<std::uint64_t>(static_cast<std::uint64_t>(kMostPart * count), 1, kMostPartPoints);
  const auto is_stray = [&](const PointGroup& part) { return cells.part_size(part) <= most; };
  std::uint64_t strays = 0;
  CloudCore core;
  whole = {};
  for (const PointGroup& part : parts) {
    if (is_stray(part)) {
      strays += part.count;
    } else {
      add(core.box, part);
    }
    add(whole, part);
  }
  strays = sum_of(peers, strays);
  core.box = joined(core.box, peers);
  whole = joined(whole, peers);
  if (static_cast<double>(strays) > kMostShare * count ||
      !(core.box.diagonal() < kWorthwhile * whole.diagonal())) {
    return std::nullopt;
  }
  for (const PointGroup& part : parts) {
    if (!core.box.contains(part.center)) core.stray += part.count;
  }
  core.stray = sum_of(peers, core.stray);
  if (core.stray == 0) return std::nullopt;
  return core;
}

}  // namespace surfel
