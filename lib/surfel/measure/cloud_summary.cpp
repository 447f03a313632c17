#include <algorithm>
#include <optional>

#include <surfel/base/option_check.h>
#include <surfel/io/cloud_survey.h>
#include <surfel/measure/cloud_summary.h>
#include <surfel/measure/stray_counter.h>
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

/// Adds the strays that were counted to a summary that has all else.
void add_strays(const StrayCounter& strays, const std::string& file, CloudSummary& out) {
  out.strays = strays.strays();
  if (out.strays) out.needs.insert(out.needs.begin(), strays.need(file));
}

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
  add_strays(strays, file, out);
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
  add_strays(strays, file, out);
  return out;
}

}  // namespace surfel
