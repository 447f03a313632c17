#include <algorithm>
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

std::optional<CloudCore> find_core(std::span<const PointGroup> groups, PointsOf points_of) {
  Bounds whole;
  for (const PointGroup& group : groups) {
    if (group.count > 0) add(whole, group);
  }
  const bool few = groups.size() <= kFewGroups;
  const std::vector<PointGroup> measured = refined(groups, few ? 0.0 : whole.diagonal(), points_of);
  if (measured.empty()) return std::nullopt;
  const Bounds middle = middle_box(measured);
  const double size = middle.diagonal();
  if (!(size > 0) || size >= kWorthwhile * whole.diagonal()) return std::nullopt;

  const double side = kCell * size;
  const std::vector<PointGroup> parts = refined(groups, side, points_of);
  Cells cells(middle.min, side);
  for (const PointGroup& part : parts) cells.add(part);
  cells.connect();
  const auto count = static_cast<double>(total(parts));
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
  if (static_cast<double>(strays) > kMostShare * count ||
      !(core.box.diagonal() < kWorthwhile * whole.diagonal())) {
    return std::nullopt;
  }
  for (const PointGroup& part : parts) {
    if (!core.box.contains(part.center)) core.stray += part.count;
  }
  if (core.stray == 0) return std::nullopt;
  return core;
}

}  // namespace surfel
