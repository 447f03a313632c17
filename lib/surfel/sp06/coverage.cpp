// Zhang, Pajarola 2006, Single-Pass Point Rendering and Transparent Shading, section 4.2.2 (SP06).

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <optional>

#include <fmt/format.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/base/stage_timer.h>
#include <surfel/scene/clips.h>
#include <surfel/sp06/coverage.h>
#include <surfel/sp06/duplication.h>
#include <surfel/sp06/missed_samples.h>

namespace surfel {
namespace {

constexpr std::size_t kCoverageGrain = 1 << 14;
/// Groups of that many splats are done one after another with all threads; smaller ones side by
/// side, a thread each.
constexpr std::size_t kLargeGroup = 1 << 15;
/// Most that kEnlarge covers of the area of a group's cells: on the Stanford dragon the last
/// thousandth are spikes at creases, which take ten times the radius.
constexpr double kReachable = 0.999;
/// Samples of GroupCoverage::missed_share.
constexpr std::size_t kMostSamples = 1 << 16;
constexpr std::uint64_t kSampleSeed = 5;

/// Indices of the discs of every group, ascending.
class GroupLists {
 public:
  GroupLists(const Discs& discs, const Array<std::uint16_t>& group) {
    std::size_t count = 0;
    for (const std::uint32_t i : discs.surfel) count = std::max<std::size_t>(count, group[i] + 1U);
    begin_.assign(count + 1, 0);
    for (const std::uint32_t i : discs.surfel) ++begin_[group[i] + 1U];
    std::partial_sum(begin_.begin(), begin_.end(), begin_.begin());
    std::vector<std::size_t> next(begin_.begin(), begin_.end() - 1);
    members_.resize(discs.size());
    for (std::size_t i = 0; i < discs.size(); ++i) {
      members_[next[group[discs.surfel[i]]]++] = static_cast<std::uint32_t>(i);
    }
  }
  std::size_t count() const { return begin_.size() - 1; }
  std::span<const std::uint32_t> operator[](std::size_t group) const {
    return {members_.data() + begin_[group], begin_[group + 1] - begin_[group]};
  }

 private:
  std::vector<std::size_t> begin_;
  Array<std::uint32_t> members_;
};

double surface_area(const SurfelCloud& cloud) {
  double sum = 0;
  for (std::size_t i = 0; i < cloud.area.size(); ++i) {
    const auto area = static_cast<double>(cloud.area[i]);
    if (area > 0 && std::isfinite(area) && !is_cut_off(cloud, i)) sum += area;
  }
  return sum;
}

double discs_area(std::span<const float> radius) {
  double sum = 0;
  for (const float r : radius) sum += std::numbers::pi * static_cast<double>(r) * r;
  return sum;
}

class GroupCoverer {
 public:
  GroupCoverer(SurfelCloud& cloud, const CoverageOptions& options, const std::string& name)
      : cloud_(cloud), options_(options), name_(name) {}

  CoverageReport run() {
    StageTimer stages(report_.times);
    discs_ = make_discs(cloud_, options_.cutoff, name_);
    report_.points_before = cloud_.size();
    report_.without_disc = cloud_.size() - discs_.size();
    if (enlarges()) keep_own_radii();
    leave_out_images();
    lists_.emplace(discs_, cloud_.group);
    const double area = surface_area(cloud_);
    report_.area_from_column = area > 0;
    surface_.emplace(discs_, !report_.area_from_column);
    report_.border_splats = surface_->border_count();
    report_.area = report_.area_from_column ? area : surface_->area();
    take_samples();
    stages.end("surface");

    report_.groups.resize(lists_->count());
    added_.resize(lists_->count());
    if (options_.method == CoverMethod::kDuplicate) {
      duplicate();
      stages.end("duplicate");
    }
    for_each_group([&](std::size_t k) { cover(k); });
    stages.end(enlarges() ? "enlarge" : "measure");

    if (!enlarges()) cloud_.group_radius = {};
    if (options_.method == CoverMethod::kDuplicate) append_copies();
    summarize();
    stages.end("output");
    return std::move(report_);
  }

 private:
  bool enlarges() const {
    return options_.method == CoverMethod::kEnlarge || options_.method == CoverMethod::kEnlargeEach;
  }

  template <class Body>
  void for_each_group(Body body) {
    std::vector<std::size_t> small;
    for (std::size_t k = 0; k < lists_->count(); ++k) {
      if ((*lists_)[k].size() + added_[k].size() < kLargeGroup) {
        small.push_back(k);
      } else {
        body(k);
      }
    }
    parallel_for(small.size(), 1, [&](std::size_t begin, std::size_t, int) { body(small[begin]); });
  }

  /// The discs of a group that no other disc of it hides.
  Array<std::uint32_t> distinct_of(std::span<const std::uint32_t> members) const {
    Array<std::uint32_t> distinct = distinct_discs(discs_.gathered(members));
    for (std::uint32_t& i : distinct) i = members[i];
    return distinct;
  }

  void duplicate() {
    const Duplication duplication(discs_, options_.least_gain);
    // A group's queue is served by one thread.
    parallel_for(lists_->count(), 1, [&](std::size_t k, std::size_t, int) {
      added_[k] = duplication.discs_to_add(distinct_of((*lists_)[k]));
    });
  }

  void keep_own_radii() {
    cloud_.group_radius.assign(cloud_.size(), 0);
    parallel_for(discs_.size(), kCoverageGrain, [&](std::size_t begin, std::size_t end, int) {
      for (std::size_t i = begin; i < end; ++i) {
        cloud_.group_radius[discs_.surfel[i]] = discs_.radius[i];
      }
    });
  }

  /// Takes out the discs whose centres half-planes cut off: they continue others beyond the
  /// surface, so that there is nothing that they would have to cover.
  void leave_out_images() {
    Array<std::uint32_t> kept;
    for (std::uint32_t i = 0; i < discs_.size(); ++i) {
      if (!is_cut_off(cloud_, discs_.surfel[i])) kept.push_back(i);
    }
    if (kept.size() < discs_.size()) discs_ = discs_.gathered(kept);
  }

  void cover(std::size_t k) {
    const auto own = (*lists_)[k];
    Array<std::uint32_t> members(own.size() + added_[k].size());
    std::merge(own.begin(), own.end(), added_[k].begin(), added_[k].end(), members.begin());
    const Discs discs = discs_.gathered(distinct_of(members));
    const GroupCells cells(discs, *surface_);

    GroupCoverage& out = report_.groups[k];
    out.splats = members.size();
    out.added = added_[k].size();
    out.hidden = members.size() - discs.size();
    out.capped = cells.restricted();
    out.cell_area = cells.area();
    const Array<float> radius = grown_radii(cells, discs, out);
    out.covered_area = cells.covered_area(radius, 1);
    out.uncovered_area = std::max(0.0, out.cell_area - out.covered_area);
    out.unreachable_area =
        std::max(0.0, out.enlargement ? options_.target * report_.area - out.covered_area
                                      : report_.area - out.cell_area);
    Discs grown = discs;
    grown.radius = radius;
    out.missed_share = missed_share(grown, sample_places_, sample_normals_);
    auto growth = static_cast<double>(out.hidden);  // They do not grow.
    double hidden_area = 0;
    for (const std::uint32_t i : members) {
      hidden_area += std::numbers::pi * static_cast<double>(discs_.radius[i]) * discs_.radius[i];
    }
    hidden_area -= discs_area(discs.radius);
    for (std::size_t i = 0; i < discs.size(); ++i) {
      const double ratio = static_cast<double>(radius[i]) / static_cast<double>(discs.radius[i]);
      growth += ratio;
      out.growth_max = std::max(out.growth_max, ratio);
      if (enlarges()) cloud_.group_radius[discs.surfel[i]] = radius[i];
    }
    if (!members.empty()) out.growth_mean = growth / static_cast<double>(members.size());
    out.overlap_area =
        std::max(0.0, discs_area(radius) + std::max(0.0, hidden_area) - out.covered_area);
  }

  /// Takes samples of the surface: places about splats, each anywhere in the area that its splat
  /// stands for.
  void take_samples() {
    const double mean_area =
        report_.area / static_cast<double>(std::max<std::size_t>(1, discs_.size()));
    const std::size_t step = discs_.size() / kMostSamples + 1;
    for (std::size_t i = 0; i < discs_.size(); i += step) {
      const double own = cloud_.area.empty() ? mean_area : cloud_.area[discs_.surfel[i]];
      const double area = own > 0 && std::isfinite(own) ? own : mean_area;
      const double radius = std::sqrt(area / std::numbers::pi * random_uniform(kSampleSeed, i, 0));
      const double angle = 2 * std::numbers::pi * random_uniform(kSampleSeed, i, 1);
      const Vec3f a = discs_.normal[i].unitOrthogonal();
      const Vec3f b = discs_.normal[i].cross(a);
      const Vec3f offset = static_cast<float>(radius * portable::cos(angle)) * a +
                           static_cast<float>(radius * portable::sin(angle)) * b;
      if (is_beyond(discs_.surfel[i], offset)) continue;
      sample_places_.emplace_back(discs_.center[i] + offset);
      sample_normals_.push_back(discs_.normal[i]);
    }
  }

  /// Does a half-plane of a surfel cut off the place at this offset from its centre?
  bool is_beyond(std::uint32_t surfel, const Vec3f& offset) const {
    const auto beyond = [&](const HalfPlane& cut) {
      return cut.cuts() && cut.direction.dot(offset.cast<double>()) > cut.distance;
    };
    return beyond(half_plane(cloud_, surfel, 0)) || beyond(half_plane(cloud_, surfel, 1));
  }

  Array<float> grown_radii(const GroupCells& cells, const Discs& discs, GroupCoverage& out) const {
    Array<float> radius = discs.radius;
    if (options_.method == CoverMethod::kEnlarge) {
      const double area = options_.target * report_.area;
      const double reachable = std::min(area, kReachable * cells.area());
      out.enlargement = enlarge_by_bracketing(cells, discs.radius, reachable);
      out.enlargement->converged = out.enlargement->converged && reachable == area;
      if (options_.fixed_point_iterations > 0) {
        out.fixed_point =
            enlarge_by_fixed_point(cells, discs.radius, area, options_.fixed_point_iterations);
      }
      for (float& r : radius) r = rounded_up(out.enlargement->factor * static_cast<double>(r));
    } else if (options_.method == CoverMethod::kEnlargeEach) {
      const double limit = options_.most_growth * median_growth(cells, discs);
      for (std::size_t i = 0; i < cells.size(); ++i) {
        const double most = limit * static_cast<double>(discs.radius[i]);
        if (cells.reach(i) > most) ++out.limited;
        radius[i] = std::max(radius[i], rounded_up(std::min(most, cells.reach(i))));
      }
    }
    return radius;
  }

  /// Median of the factors, 1 at least, by which the discs would have to grow.
  static double median_growth(const GroupCells& cells, const Discs& discs) {
    if (cells.size() == 0) return 1;
    std::vector<double> growth(cells.size());
    for (std::size_t i = 0; i < cells.size(); ++i) {
      growth[i] = std::max(1.0, cells.reach(i) / static_cast<double>(discs.radius[i]));
    }
    const auto middle = growth.begin() + static_cast<std::ptrdiff_t>(growth.size() / 2);
    std::nth_element(growth.begin(), middle, growth.end());
    return *middle;
  }

  /// The least float that is no smaller: a corner stays covered.
  static float rounded_up(double value) {
    const auto nearest = static_cast<float>(value);
    return static_cast<double>(nearest) < value
               ? std::nextafter(nearest, std::numeric_limits<float>::infinity())
               : nearest;
  }

  void append_copies() {
    if (cloud_.source.empty()) {
      cloud_.source.resize(cloud_.size());
      std::iota(cloud_.source.begin(), cloud_.source.end(), 0U);
    }
    Array<std::uint32_t> order(cloud_.size());
    std::iota(order.begin(), order.end(), 0U);
    Array<std::uint16_t> group = cloud_.group;
    for (std::size_t k = 0; k < added_.size(); ++k) {
      const std::size_t first = order.size();
      for (const std::uint32_t i : added_[k]) order.push_back(discs_.surfel[i]);
      std::sort(order.begin() + static_cast<std::ptrdiff_t>(first), order.end());
      group.resize(order.size(), static_cast<std::uint16_t>(k));
    }
    if (order.size() > std::numeric_limits<std::uint32_t>::max()) {
      throw_input(name_, fmt::format("with the copies there are {} surfels, more than 2^32 - 1; "
                                     "use fewer groups or a larger least gain",
                                     order.size()));
    }
    cloud_ = cloud_.gathered(order);
    cloud_.group = std::move(group);
  }

  void summarize() {
    double growth = 0;
    std::size_t splats = 0;
    const auto count = static_cast<double>(std::max<std::size_t>(1, report_.groups.size()));
    for (const GroupCoverage& group : report_.groups) {
      report_.points_added += group.added;
      report_.hidden += group.hidden;
      report_.capped += group.capped;
      report_.limited += group.limited;
      report_.covered_area += group.covered_area / count;
      report_.uncovered_area += group.uncovered_area / count;
      report_.unreachable_area += group.unreachable_area / count;
      report_.overlap_area += group.overlap_area / count;
      report_.missed_share += group.missed_share / count;
      growth += group.growth_mean * static_cast<double>(group.splats);
      splats += group.splats;
      report_.growth_max = std::max(report_.growth_max, group.growth_max);
    }
    if (splats > 0) report_.growth_mean = growth / static_cast<double>(splats);
  }

  SurfelCloud& cloud_;
  const CoverageOptions& options_;
  const std::string& name_;  ///< The cloud's, for messages.
  CoverageReport report_;
  Discs discs_;
  std::optional<GroupLists> lists_;
  std::optional<DiscSurface> surface_;
  std::vector<Vec3f> sample_places_, sample_normals_;
  std::vector<Array<std::uint32_t>> added_;  ///< Added discs of every group: indices into discs_.
};

}  // namespace

std::vector<std::string> CoverageOptions::problems() const {
  std::vector<std::string> found;
  check_option(found, cutoff > 0 && std::isfinite(cutoff), "cutoff", cutoff, "above 0");
  check_option(found, target > 0 && target <= 1, "target", target, "in (0, 1]");
  check_option(found, least_gain > 0 && least_gain < 1, "least_gain", least_gain, "in (0, 1)");
  check_option(found, most_growth >= 1 && std::isfinite(most_growth), "most_growth", most_growth,
               "at least 1");
  check_option(found, fixed_point_iterations >= 0, "fixed_point_iterations", fixed_point_iterations,
               "0 or more");
  return found;
}

CoverageReport cover_groups(SurfelCloud& cloud, const CoverageOptions& options,
                            const std::string& name) {
  require_usable(options);
  cloud.check_columns(name);
  if (cloud.empty()) return {};
  if (cloud.group.empty()) {
    throw_input(name, "has no groups; assign them first (surfel-group)");
  }
  return GroupCoverer(cloud, options, name).run();
}

}  // namespace surfel
