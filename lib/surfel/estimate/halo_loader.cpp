#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include <surfel/base/error.h>
#include <surfel/base/median.h>
#include <surfel/base/parallel.h>
#include <surfel/estimate/halo_loader.h>
#include <surfel/io/cloud_ranges.h>

namespace surfel {
namespace {

constexpr std::size_t kHaloGrain = 1 << 14;
/// Points that one region is made of: a box with fewer is tighter, and there are more of them.
constexpr std::size_t kRegionPoints = 512;
/// Points of a region that tell their spacing.
constexpr std::size_t kLeastTelling = 32;
/// Width of halos in spacings, for neighbourhoods of 16: cells are mostly known from 32 points,
/// which reach 3.2 spacings, and their normals from 16 more, which reach 2.3. The rest is for
/// uneven points: of a fractal terrain 1 in 3000 is estimated again.
constexpr double kHaloSpacings = 8;
/// Points that are read for halos at most, by the points of a block: consecutive points that lie
/// close together need less than half of that.
constexpr std::size_t kMostRead = 16;
/// Blocks with fewer points have halos that are large beside them.
constexpr std::size_t kLeastBlock = std::size_t{1} << 14;

template <class T>
Array<T> in_order(const Array<T>& values, const Array<std::uint32_t>& order) {
  Array<T> out(values.size());
  if (!values.empty()) {
    parallel_each(order.size(), kHaloGrain, [&](std::size_t i) { out[i] = values[order[i]]; });
  }
  return out;
}

HaloRegion region_of(std::span<const std::uint32_t> points, const BlockPoints& block) {
  HaloRegion region;
  for (const std::uint32_t i : points) {
    region.box.add(block.cloud.position[i]);
    region.reach = std::max(region.reach, block.reach[i]);
  }
  return region;
}

/// Do points along the curve lie far from most of the others?
bool have_strays(std::span<const std::uint32_t> points, const BlockPoints& block) {
  constexpr float kFar = 16;
  const std::size_t quarter = points.size() / 4;
  const RunBox all = region_of(points, block).box;
  const RunBox most = region_of(points.subspan(quarter, points.size() - 2 * quarter), block).box;
  return (all.high - all.low).norm() > kFar * (most.high - most.low).norm();
}

/// The run of a block's point.
std::size_t run_of(std::uint32_t point, const BlockPoints& block) {
  const auto& first = block.run_points;
  const auto next = std::upper_bound(first.begin(), first.end(), std::size_t{point});
  return block.begin_run + static_cast<std::size_t>(next - first.begin()) - 1;
}

}  // namespace

void refuse_disorder(const std::string& name) {
  throw_input(name,
              "consecutive points do not lie close together, as surfels that are made block by "
              "block need it; " +
                  range_advice(name));
}

HaloLoader::HaloLoader(const SurfelRanges& cloud, const RunIndex& index, HaloOptions options,
                       const std::string& name)
    : cloud_(cloud),
      index_(index),
      options_(std::move(options)),
      name_(name),
      grid_(cloud.grid()) {}

/// Calls body(points) with the points of a block, which are given along the curve, in boxes of
/// kRegionPoints at most, apart from those that lie far from them.
template <class Body>
void HaloLoader::cut(std::span<const std::uint32_t> points, const BlockPoints& block,
                     const Body& body) const {
  const auto code = [&](std::uint32_t i) { return grid_.code(block.cloud.position[i]); };
  const auto halve = [&](auto& self, std::span<const std::uint32_t> some, int bit) -> void {
    if (some.empty()) return;
    if (some.size() <= kRegionPoints && (bit < 0 || !have_strays(some, block))) {
      body(some);
      return;
    }
    auto middle = some.begin() + static_cast<std::ptrdiff_t>(some.size() / 2);
    if (bit >= 0) {
      middle = std::partition_point(some.begin(), some.end(),
                                    [&](std::uint32_t i) { return (code(i) >> bit & 1) == 0; });
    }
    self(self, some.first(static_cast<std::size_t>(middle - some.begin())), bit - 1);
    self(self, some.subspan(static_cast<std::size_t>(middle - some.begin())), bit - 1);
  };
  constexpr int kHighestBit = 62;
  halve(halve, points, kHighestBit);
}

void HaloLoader::measure_reach(std::span<const std::uint32_t> points, BlockPoints& block) const {
  std::fill(block.reach.begin(), block.reach.end(), 0.0F);
  struct Measured {
    std::span<const std::uint32_t> points;
    float spacing;
  };
  std::vector<Measured> boxes;
  std::vector<float> told;
  cut(points, block, [&](std::span<const std::uint32_t> some) {
    const RunBox box = region_of(some, block).box;
    Vec3f side = box.high - box.low;
    std::sort(side.begin(), side.end());
    const auto count = static_cast<float>(some.size());
    const float spacing = std::max(std::sqrt(side[2] * side[1] / count), side[2] / count);
    boxes.push_back({some, spacing});
    if (some.size() >= kLeastTelling) told.push_back(spacing);
  });
  const float middle = told.empty() ? 0 : median(told);
  const double spacings = kHaloSpacings * std::max(1.0, std::sqrt(options_.neighbors / 16.0));
  for (const Measured& box : boxes) {
    // Boxes of few points, or of points in several corners, have no spacing of their own.
    constexpr float kMostUneven = 4;
    float spacing = box.spacing;
    if (!told.empty()) {
      spacing =
          box.points.size() < kLeastTelling ? middle : std::min(spacing, kMostUneven * middle);
    }
    const auto reach =
        static_cast<float>(spacings * static_cast<double>(spacing) + options_.radius);
    for (const std::uint32_t i : box.points) block.reach[i] = reach;
  }
}

/// The runs that hold the points of the task, and their halo.
LoadedRuns HaloLoader::wanted_runs(const HaloTask& task, const BlockPoints& block) const {
  LoadedRuns runs(index_);
  for (const std::uint32_t i : task.points) runs.add(run_of(i, block));
  if (task.needed.empty()) {
    cut(task.points, block, [&](std::span<const std::uint32_t> some) {
      const HaloRegion region = region_of(some, block);
      runs.add_near(region.box, region.reach);
    });
  } else {
    // The points are few, and far from one another. Where the halo of a box was known around its
    // neighbours, the halo of a point has to be wider.
    for (const std::uint32_t i : task.points) {
      const HaloRegion region = region_of({&i, 1}, block);
      runs.add_near(region.box, 2 * region.reach);
    }
  }
  for (const HaloRegion& region : task.needed) runs.add_near(region.box, region.reach);
  return runs;
}

/// Points of consecutive runs, which lie in the block or outside of it.
HaloPoints HaloLoader::read(std::size_t begin_run, std::size_t end_run,
                            const BlockPoints& block) const {
  HaloPoints out;
  if (begin_run >= block.begin_run && begin_run < block.end_run) {
    const std::size_t begin = block.run_points[begin_run - block.begin_run];
    const std::size_t end = block.run_points[end_run - block.begin_run];
    const auto part = [&](const Array<Vec3f>& values) {
      if (values.empty()) return Array<Vec3f>();
      return Array<Vec3f>(values.begin() + static_cast<std::ptrdiff_t>(begin),
                          values.begin() + static_cast<std::ptrdiff_t>(end));
    };
    out.position = part(block.cloud.position);
    out.previous = part(block.previous);
    out.point.resize(end - begin);
    std::iota(out.point.begin(), out.point.end(), static_cast<std::uint32_t>(begin));
    return out;
  }
  const std::size_t begin = index_.begin(begin_run);
  const std::size_t end = index_.begin(end_run);
  if (options_.directions) {
    const SurfelCloud piece = cloud_.read(begin, end);
    const Array<Vec3f> previous = options_.directions(piece, begin_run);
    for (std::size_t i = 0; i < piece.size(); ++i) {
      if (!piece.position[i].allFinite()) continue;
      out.position.push_back(piece.position[i]);
      if (!previous.empty()) out.previous.push_back(previous[i]);
    }
  } else {
    out.position = cloud_.positions(begin, end);
    std::erase_if(out.position, [](const Vec3f& p) { return !p.allFinite(); });
  }
  out.point.assign(out.position.size(), kHalo);
  return out;
}

std::optional<HaloPoints> HaloLoader::load(const HaloTask& task, const BlockPoints& block) const {
  const LoadedRuns runs = wanted_runs(task, block);
  struct Part {
    std::size_t begin, end;  ///< Runs.
    HaloPoints points;
  };
  constexpr std::size_t kMostRuns = 16;
  std::vector<Part> parts;
  std::size_t outside = 0;
  for (std::size_t r = 0; r < index_.size(); ++r) {
    if (!runs.has(r)) continue;
    if (r < block.begin_run || r >= block.end_run) outside += index_[r].finite;
    const bool follows = !parts.empty() && parts.back().end == r && r != block.begin_run &&
                         r != block.end_run && r - parts.back().begin < kMostRuns;
    if (follows) {
      parts.back().end = r + 1;
    } else {
      parts.push_back({r, r + 1, {}});
    }
  }
  if (task.needed.empty() && outside > kMostRead * std::max(block.cloud.size(), kLeastBlock)) {
    refuse_disorder(name_);
  }
  if (task.points.size() > 1 && runs.finite() > options_.most_points) return std::nullopt;
  // Points that are not certain have had runs added as far as they need. With less than what is
  // known around them they would need the same runs again, for ever.
  const bool exact = !task.needed.empty();
  parallel_each(parts.size(), 1, [&](std::size_t p) {
    Part& part = parts[p];
    part.points = read(part.begin, part.end, block);
    HaloPoints& points = part.points;
    points.known.resize(points.size());
    for (std::size_t begin = 0; begin < points.size(); begin += kRegionPoints) {
      const std::size_t count = std::min(kRegionPoints, points.size() - begin);
      runs.known_around(std::span<const Vec3f>(points.position).subspan(begin, count), exact,
                        points.known.data() + begin);
    }
  });
  HaloPoints out;
  for (const Part& part : parts) out.append(part.points);
  Array<std::uint8_t> wanted;
  wanted.assign(block.cloud.size(), 0);
  for (const std::uint32_t i : task.points) wanted[i] = 1;
  for (std::uint32_t& i : out.point) {
    if (i != kHalo && wanted[i] == 0) i = kHalo;
  }
  const Array<std::uint32_t> order = morton_order(out.position, grid_);
  return HaloPoints{in_order(out.position, order), in_order(out.known, order),
                    in_order(out.previous, order), in_order(out.point, order)};
}

}  // namespace surfel
