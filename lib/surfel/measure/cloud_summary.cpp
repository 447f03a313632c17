#include <algorithm>
#include <cmath>
#include <optional>

#include <fmt/format.h>
#include <surfel/base/coordinate_spread.h>
#include <surfel/base/elementary.h>
#include <surfel/base/option_check.h>
#include <surfel/base/shell_quote.h>
#include <surfel/io/cloud_survey.h>
#include <surfel/measure/cloud_summary.h>
#include <surfel/scene/clips.h>
#include <surfel/scene/cloud_rows.h>
#include <surfel/scene/surface_sample.h>

namespace surfel {
namespace {

/// Bytes of the values that the percentiles of an attribute are taken of.
constexpr std::uint64_t kAttributeBytes = 9 << 20;

bool knows_normal(const SurfelCloud& cloud, std::size_t i) {
  return !cloud.normal.empty() && cloud.normal[i].allFinite() && !cloud.normal[i].isZero(0);
}

/// What is told of a cloud without looking at what lies near what.
class Counter {
 public:
  void add(const SurfelCloud& piece) {
    survey_.add(piece);
    for (std::size_t i = 0; i < piece.size(); ++i) {
      ++out_.by_lines[static_cast<std::size_t>(count_half_planes(piece, i))];
      out_.cut_off += is_cut_off(piece, i) ? 1 : 0;
    }
    if (!piece.scan_viewpoints.empty() && all_told_) all_told_ = !piece.sensors().empty();
    take_like(piece);
  }
  /// What was counted.
  CloudSummary summary() {
    out_.tells_sensors = all_told_ && !out_.like.scan_viewpoints.empty();
    survey_.settle(out_.like);
    return std::move(out_);
  }
  std::uint64_t surfels() const { return survey_.count; }

 private:
  void take_like(const SurfelCloud& piece) {
    if (piece.empty()) return;
    // What the whole file says may be known at its end only.
    std::size_t row = 0;
    const SurfelCloud* from = &piece;
    const SurfelCloud before = std::move(out_.like);
    if (!before.empty() && knows_normal(before, 0)) {
      from = &before;
    } else {
      while (row < piece.size() && !knows_normal(piece, row)) ++row;
      if (row == piece.size()) {
        row = 0;
        if (!before.empty()) from = &before;
      }
    }
    out_.like = cloud_of_rows(piece, 1);
    copy_rows(*from, row, row + 1, out_.like, 0);
    // What the file holds besides is not the surfels' own, and is not copied with them.
    out_.like.coarser_skipped = piece.coarser_skipped;
    out_.like.unmeasured_skipped = piece.unmeasured_skipped;
    out_.like.skipped_elements = piece.skipped_elements;
  }

  CloudSurvey survey_{".ply"};
  CloudSummary out_;
  bool all_told_ = true;
};

/// Adds the points of a piece to a sampler.
void add_to_sample(const SurfelCloud& piece, SurfaceSampler& sampler) {
  for (std::size_t i = 0; i < piece.size(); ++i) {
    sampler.add({piece.position[i], piece.normal.empty() ? Vec3f(0, 0, 0) : piece.normal[i],
                 piece.area.empty() ? 1 : piece.area[i]});
  }
}

ViewGuess view_of(const SurfaceSample& sample, const SurfelCloud& like) {
  return guess_view(sample, {.up = like.up, .viewpoint = like.viewpoint});
}

/// A box a little larger than `box`, as --bounds takes it.
std::string larger_box(const Bounds& box) {
  const Vec3d largest = box.min.cwiseAbs().cwiseMax(box.max.cwiseAbs());
  // So that no rounding, in double or to the digits that are printed, makes the box smaller.
  const double margin = 1e-3 * box.diagonal() + 1e-12 * largest.maxCoeff() + 1e-300;
  const auto digits = static_cast<int>(std::max(0.0, std::ceil(-portable::log10(margin))));
  const Vec3d min = box.min.array() - margin;
  const Vec3d max = box.max.array() + margin;
  return fmt::format("{1:.{0}f},{2:.{0}f},{3:.{0}f},{4:.{0}f},{5:.{0}f},{6:.{0}f}", digits, min.x(),
                     min.y(), min.z(), max.x(), max.y(), max.z());
}

/// Counts the points outside of CoordinateSpread::core() in a cloud whose pieces are handed on
/// twice in their order: to add() and, once it has had all of them, to look().
class StrayCounter {
 public:
  void add(const SurfelCloud& piece) { spread_.add(piece.origin, piece.position); }
  void look(const SurfelCloud& piece) {
    if (!core_) {
      box_ = spread_.box();
      core_ = spread_.core(box_);
    }
    const bool all = core_->min == box_.min && core_->max == box_.max;
    for (std::size_t i = 0; !all && i < piece.size(); ++i) {
      // As the spread has it.
      const Vec3d place = piece.origin + piece.position[i].cast<double>();
      if (!place.allFinite() || core_->contains(place)) continue;
      if (!strays_) strays_ = StrayPoints{0, looked_at_ + i, piece.world(i)};
      ++strays_->count;
    }
    looked_at_ += piece.size();
  }
  /// Adds the strays to a summary that has all else. \param file  the cloud's, in commands.
  void finish(const std::string& file, CloudSummary& out) const {
    out.strays = strays_;
    if (!strays_) return;
    const Vec3d& place = strays_->place;
    const std::string measure = fmt::format(
        "{} of {} points lie far from all others; the first is point {} (counted from "
        "0) at {:.10g}, {:.10g}, {:.10g}",
        strays_->count, looked_at_, strays_->first, place.x(), place.y(), place.z());
    out.needs.insert(out.needs.begin(), {"strays", measure,
                                         fmt::format("surfel-convert {} --bounds={} -o OUT",
                                                     shell_file(file), larger_box(*core_))});
  }

 private:
  CoordinateSpread spread_;
  Bounds box_;
  std::optional<Bounds> core_;
  std::uint64_t looked_at_ = 0;
  std::optional<StrayPoints> strays_;
};

}  // namespace

std::uint64_t summary_bytes(std::uint64_t surfels, std::size_t row_bytes) {
  constexpr std::size_t kSearch = 72;  // The tree, the positions and radii that it is made of.
  return surfels * (row_bytes + kSearch);
}

CloudSummary summarize_cloud(const SurfelCloud& cloud, const CloudStatisticsOptions& options,
                             const std::string& file) {
  require_usable(options);
  Counter counter;
  counter.add(cloud);
  CloudSummary out = counter.summary();
  out.statistics = cloud_statistics(cloud, options);
  out.view = view_of(sample_surface(cloud), cloud);
  out.attributes = summarize_attributes(cloud, out.view.up);
  out.needs = cloud_needs(cloud, out.statistics, options, file);
  StrayCounter strays;
  strays.add(cloud);
  strays.look(cloud);
  strays.finish(file, out);
  return out;
}

CloudSummary summarize_cloud(const CloudPasses& pieces, const CloudStatisticsOptions& options,
                             const std::string& file, std::uint64_t memory) {
  require_usable(options);
  StreamedStatistics statistics(pieces, memory / 2, options);
  CloudFactCounter facts;
  Counter counter;
  StrayCounter strays;
  pieces([&](const SurfelCloud& piece) {
    statistics.add(piece);
    facts.add(piece);
    counter.add(piece);
    strays.add(piece);
  });
  const std::uint64_t surfels = counter.surfels();
  CloudSummary out = counter.summary();
  SurfaceSampler sampler(surfels);
  pieces([&](const SurfelCloud& piece) {
    statistics.look(piece);
    facts.look(piece);
    strays.look(piece);
    add_to_sample(piece, sampler);
  });
  out.view = view_of(sampler.sample(out.like.origin), out.like);
  out.statistics = statistics.finish();

  const std::vector<std::string> names = measured_attributes(out.like);
  const auto at_once =
      static_cast<std::size_t>(std::max<std::uint64_t>(1, memory / 2 / kAttributeBytes));
  for (std::size_t begin = 0; begin < names.size(); begin += at_once) {
    const std::size_t end = std::min(begin + at_once, names.size());
    std::vector<AttributeSurvey> surveys;
    for (std::size_t a = begin; a < end; ++a) surveys.emplace_back(surfels);
    pieces([&](const SurfelCloud& piece) {
      const CloudSource source(piece, "", CloudSource::Sizes::kAny);
      for (std::size_t a = begin; a < end; ++a) {
        surveys[a - begin].add(AttributeValues(source, names[a], out.view.up, ""), 0, piece.size());
      }
    });
    for (std::size_t a = begin; a < end; ++a) {
      out.attributes.emplace_back(names[a], surveys[a - begin].summary());
    }
  }
  out.needs = cloud_needs(facts.facts(), out.statistics, options, file,
                          [&](const CloudStatisticsOptions& at) { return statistics.holes(at); });
  strays.finish(file, out);
  return out;
}

}  // namespace surfel
