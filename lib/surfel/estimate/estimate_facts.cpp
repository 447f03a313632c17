#include <algorithm>
#include <span>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/base/progress.h>
#include <surfel/estimate/estimate_blocks.h>
#include <surfel/estimate/estimate_facts.h>
#include <surfel/estimate/halo_loader.h>
#include <surfel/estimate/noisy_normals.h>
#include <surfel/estimate/place_sample.h>
#include <surfel/estimate/point_estimates.h>
#include <surfel/estimate/range_normals.h>
#include <surfel/scene/cloud_rows.h>

namespace surfel {
namespace {

/// Runs that are read at once for the index.
constexpr std::size_t kIndexRuns = 256;
/// Runs whose boxes meet the box of a run: along a curve through space there are some tens.
constexpr std::size_t kMostMeeting = 64;

std::size_t finite_without_normal(const SurfelCloud& cloud) {
  return count_where(cloud.size(), [&](std::size_t i) {
    return cloud.position[i].allFinite() &&
           (cloud.normal.empty() || !usable_normal(cloud.normal[i]));
  });
}

}  // namespace

EstimateFacts read_estimate_facts(const SurfelRanges& cloud, const EstimateOptions& options,
                                  std::size_t run_length, const std::string& name) {
  EstimateFacts facts(run_length);
  const bool aligned = options.orientation.method == Orientation::kAlign;
  PlaceSample sample(std::max({kNoiseSample, kScanLineSample, kPixelSample}));
  ProgressStage progress("reading " + (name.empty() ? "points" : name), cloud.size(), "points");
  const std::size_t length = kIndexRuns * run_length;
  bool all_told = true;
  for (std::size_t begin = 0; begin < cloud.size(); begin += length) {
    const std::size_t end = std::min(begin + length, cloud.size());
    const bool all_columns = begin == 0 || facts.sensors || aligned;
    SurfelCloud piece = all_columns ? cloud.read(begin, end) : SurfelCloud();
    if (!all_columns) piece.position = cloud.positions(begin, end);
    if (begin == 0) {
      facts.column_bytes = row_bytes(piece);
      facts.told_once = piece.viewpoint.has_value();
      facts.sensors = !piece.scan_viewpoints.empty();
      facts.sensor = options.normals.sensor.value_or(Vec3d(0, 0, 0)) - piece.origin;
    }
    if (facts.sensors && all_told) all_told = !piece.sensors().empty();
    facts.index.add(piece.position);
    if (aligned) facts.without_normal += finite_without_normal(piece);
    std::erase_if(piece.position, [](const Vec3f& p) { return !p.allFinite(); });
    facts.at_sensor = facts.at_sensor ||
                      std::any_of(piece.position.begin(), piece.position.end(),
                                  [&](const Vec3f& p) { return p.cast<double>() == facts.sensor; });
    sample.add(piece.position);
    progress.add(end - begin);
  }
  facts.index.finish();
  facts.sensors = facts.sensors && all_told;
  if (facts.index.finite() == 0) {
    throw_input(name, "there is no point with finite coordinates; export the points again");
  }
  // Any order will do by which what is near in the file is near in space.
  if (facts.index.median_meeting() > std::max(kMostMeeting, facts.index.size() / 4)) {
    refuse_disorder(name);
  }
  facts.sample = sample.places();
  return facts;
}

CloudRules decide_rules(const SurfelRanges& cloud, const EstimateFacts& facts,
                        const EstimateOptions& options, const std::string& name) {
  const OrientationOptions& orientation = options.orientation;
  const std::size_t finite = facts.index.finite();
  const bool told = facts.told_once || facts.sensors;
  if (orientation.method == Orientation::kViewpoint && !orientation.viewpoint && !told) {
    throw_usage((name.empty() ? "the cloud" : name) +
                " does not say where its scanner stood; give the `viewpoint`");
  }
  if (facts.without_normal > 0) {
    throw_input(name, fmt::format("{} of {} points have no normal to be aligned with: their side "
                                  "follows the others', which only works in memory; orient by "
                                  "another method, such as up or viewpoint, or give more memory",
                                  facts.without_normal, finite));
  }
  CloudRules rules;
  rules.winding = orientation.method == Orientation::kWinding ||
                  (orientation.method == Orientation::kAuto && !orientation.viewpoint && !told);
  rules.to_sensors =
      !rules.winding && !orientation.viewpoint &&
      (orientation.method == Orientation::kViewpoint || orientation.method == Orientation::kAuto);

  RunSearch search(cloud, facts.index);
  const auto nearest = [&](const Vec3f& place, std::size_t k, std::vector<Vec3f>& out) {
    search.nearest(place, k, out);
  };
  const auto first = [&](std::size_t most) {
    return std::span<const Vec3f>(facts.sample).first(std::min(most, facts.sample.size()));
  };
  const bool grow_in_noise = options.normals.grow_in_noise && !(options.normals.radius > 0);
  if (grow_in_noise && planes_often_uncertain(finite, first(kNoiseSample), nearest)) {
    const auto directions = [&](const Vec3f& direction, std::size_t k, std::vector<float>& out) {
      search.nearest_directions(facts.sensor, direction, k, out);
    };
    const bool pixels =
        !facts.at_sensor && seen_as_pixels(finite, facts.sample, facts.sensor, directions);
    if (pixels || noise_hides_surface(first(kNoiseSample), nearest)) {
      throw_input(name, std::string(pixels ? "the points are a range image, whose"
                                           : "noise hides the surface: its") +
                            " normals can only be made with all points in memory; give more "
                            "memory, or have noise ignored (`grow_in_noise`)");
    }
  }
  rules.scan_lines =
      options.size.max_radius > 0 && consists_of_scan_lines(first(kScanLineSample), nearest);
  return rules;
}

}  // namespace surfel
