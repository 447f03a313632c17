#include <algorithm>
#include <limits>
#include <optional>

#include <surfel/base/bounds.h>
#include <surfel/base/error.h>
#include <surfel/base/median.h>
#include <surfel/base/morton.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/base/progress.h>
#include <surfel/base/stage_timer.h>
#include <surfel/estimate/estimate.h>
#include <surfel/estimate/point_estimates.h>
#include <surfel/surface/neighbor_lists.h>

namespace surfel {
namespace {

constexpr std::size_t kCloudGrain = 1 << 14;

/// Values of points order[0], order[1], ...
template <class T>
Array<T> gathered(const Array<T>& values, const Array<std::uint32_t>& order) {
  Array<T> out(order.size());
  parallel_each(order.size(), kCloudGrain, [&](std::size_t i) { out[i] = values[order[i]]; });
  return out;
}

/// Puts points that are in the order of the curve back into the order of the file: `order` becomes
/// the points that are left, ascending; returned is the place of each point along the curve.
Array<std::uint32_t> file_order(std::size_t count, Array<std::uint32_t>& order) {
  constexpr std::uint32_t kRemoved = std::numeric_limits<std::uint32_t>::max();
  Array<std::uint32_t> place(count);
  if (order.size() < count) place.assign(count, kRemoved);
  parallel_each(order.size(), kCloudGrain,
                [&](std::size_t i) { place[order[i]] = static_cast<std::uint32_t>(i); });
  if (order.size() == count) {  // None was removed.
    parallel_each(count, kCloudGrain,
                  [&](std::size_t i) { order[i] = static_cast<std::uint32_t>(i); });
    return place;
  }
  std::size_t kept = 0;
  for (std::uint32_t i = 0; i < count; ++i) {
    if (place[i] == kRemoved) continue;
    order[kept] = i;
    place[kept++] = place[i];
  }
  place.resize(kept);
  return place;
}

/// Points along a space-filling curve, where neighbours are near in memory, too.
struct OrderedPoints {
  Array<std::uint32_t> order;  ///< Points of the cloud.
  Array<Vec3f> position;
  Array<Vec3f> fitted;  ///< Normals known from smoothing (zero = unknown); or empty.
};

/// The points of the cloud that are finite, one at least, and in a box that single precision holds.
OrderedPoints finite_points(const SurfelCloud& cloud, const std::string& name) {
  OrderedPoints out{morton_order(cloud.position), {}, {}};
  // Points that are not finite come last.
  const auto end = std::partition_point(out.order.begin(), out.order.end(), [&](std::uint32_t i) {
    return cloud.position[i].allFinite();
  });
  out.order.erase(end, out.order.end());
  if (out.order.empty())
    throw_input(name, "there is no point with finite coordinates; export the points again");
  require_float_extent(cloud.bounds(), name);
  out.position = gathered(cloud.position, out.order);
  return out;
}

/// How many of the points have no usable normal to align with. Throws Error(kInput) if none has
/// one.
std::size_t without_normal(const SurfelCloud& cloud, const OrderedPoints& points,
                           const std::string& name) {
  const std::size_t count = points.order.size();
  const auto is_unknown = [&](std::size_t i) {
    return !usable_normal(cloud.normal[points.order[i]]);
  };
  const std::size_t unknown = cloud.normal.empty() ? count : count_where(count, is_unknown);
  if (unknown == count) {
    throw_input(name,
                "holds no normals for estimated ones to be aligned with; orient by another method, "
                "such as mst, outward or viewpoint");
  }
  return unknown;
}

/// Removes outliers and returns how many there were; one point at least is left.
std::size_t remove_outliers(const OutlierOptions& options, const std::string& name,
                            OrderedPoints& points) {
  const Array<std::uint8_t> inlier = inliers(points.position, options);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < inlier.size(); ++i) {
    if (inlier[i] == 0) continue;
    points.order[kept] = points.order[i];
    points.position[kept++] = points.position[i];
  }
  if (kept == 0) throw_input(name, "every point is an outlier; raise `deviations`");
  points.order.resize(kept);
  points.position.resize(kept);
  return inlier.size() - kept;
}

/// The points of the cloud averaged in the cells of a grid, a cloud of its own.
SurfelCloud thinned(const SurfelCloud& cloud, const VoxelOptions& options, const std::string& name,
                    OrderedPoints& points, EstimateReport& r) {
  SurfelCloud out = average_voxels(cloud, points.order, options, name, r.voxel_edge);
  r.averaged = points.order.size() - out.size();
  points = finite_points(out, name);
  return out;
}

/// Moves the points onto a smooth surface.
void smooth(const EstimateOptions& options, OrderedPoints& points, EstimateReport& r) {
  const auto tree = make_neighbor_search(points.position, options.search);
  SmoothedPoints smoothed = smooth_points(points.position, *tree, *options.smoothing);
  points.position = std::move(smoothed.position);
  if (options.smoothing->normals) points.fitted = std::move(smoothed.normal);
  r.smoothed = true;
  r.stayed = smoothed.stayed;
  r.mean_shift = smoothed.mean_shift;
  r.largest_shift = smoothed.largest_shift;
}

/// Directions from the points to the sensors of their scans, or to the cloud's one viewpoint.
/// Throws Error(kUsage) for a cloud that tells neither.
Array<Vec3f> directions_to_sensors(const SurfelCloud& cloud, const OrderedPoints& points,
                                   const std::string& name) {
  const Array<Vec3d> sensors = cloud.sensors();
  if (sensors.empty() && !cloud.viewpoint) {
    throw_usage((name.empty() ? "the cloud" : name) +
                " does not say where its scanner stood; give the `viewpoint`");
  }
  Array<Vec3f> directions(points.order.size());
  parallel_each(directions.size(), kCloudGrain, [&](std::size_t i) {
    const Vec3d& sensor = sensors.empty() ? cloud.viewpoint->position : sensors[points.order[i]];
    directions[i] = direction_to_sensor(sensor, cloud.origin, points.position[i]);
  });
  return directions;
}

PointEstimates estimate_points(const SurfelCloud& cloud, const OrderedPoints& points,
                               const EstimateOptions& options, const std::string& name,
                               StageTimer& stage, EstimateReport& r) {
  const Array<Vec3f>& position = points.position;
  const auto tree = make_neighbor_search(position, options.search);
  const NeighborLists search(*tree, position, shared_neighbors(options.normals));
  stage.end("search tree");
  std::optional<ProgressStage> progress;
  progress.emplace("estimating normals", position.size(), "points");
  PointEstimates out;
  NormalOptions normals = options.normals;
  // Depth cameras stand at the origin of their own coordinates; whether the points are a range
  // image from there is tested.
  normals.sensor = normals.sensor.value_or(Vec3d(0, 0, 0)) - cloud.origin;
  out.normals = estimate_normals(position, search, normals);
  parallel_each(points.fitted.size(), kCloudGrain, [&](std::size_t i) {
    if (!points.fitted[i].isZero(0)) out.normals.normal[i] = points.fitted[i];
  });
  r.flagged = out.normals.flagged;
  r.extended = out.normals.extended;
  r.remade = out.normals.remade;
  if (r.remade > 0) {
    std::vector<float> noise(out.normals.noise.begin(), out.normals.noise.end());
    r.noise = static_cast<double>(median(noise));
  }
  r.mean_neighbors =
      static_cast<double>(out.normals.neighbors) / static_cast<double>(position.size());
  stage.end("neighbors and normals");
  if (options.edges) {
    out.lines.assign(position.size(), EdgeLines());
    r.creases = sharpen_creases(position, search, *options.edges, out.normals, out.lines);
    stage.end("creases");
  }
  progress->set_share(1);
  progress.emplace("orienting normals", position.size(), "points");
  Array<Vec3f> previous;
  if (options.orientation.method == Orientation::kAlign && !cloud.normal.empty()) {
    previous = gathered(cloud.normal, points.order);
  }
  const bool told = cloud.viewpoint || !cloud.sensors().empty();
  if (!options.orientation.viewpoint &&
      (options.orientation.method == Orientation::kViewpoint ||
       (options.orientation.method == Orientation::kAuto && told))) {
    previous = directions_to_sensors(cloud, points, name);
  }
  r.orientation = orient_normals(position, cloud.origin, search, previous, options.orientation,
                                 out.normals.normal, &out.side_confidence);
  if (!out.side_confidence.empty()) {
    r.side_confidence = mean_confidence(sum_of_confidences(out.side_confidence), position.size());
  }
  stage.end("orientation");
  progress->set_share(1);
  progress.emplace("sizing splats", position.size(), "points");
  const bool oriented = options.orientation.method != Orientation::kNone;
  out.sizes = estimate_splat_sizes(position, out.normals.normal, oriented, search, options.size,
                                   out.normals.noise, out.lines);
  r.border = out.sizes.border;
  r.capped = out.sizes.capped;
  r.anisotropic = out.sizes.ellipses;
  stage.end("sizes");
  if (options.edges) {
    r.borders = find_borders(position, out.normals.normal, oriented, search, out.sizes, out.lines);
    stage.end("borders");
  }
  progress->set_share(1);
  progress.reset();
  if (options.search == SearchMethod::kFlannApproximate) {
    const int k = options.normals.adaptive ? options.normals.k_max : options.normals.k;
    r.search_recall = neighbor_recall(position, *tree, static_cast<std::size_t>(k));
    stage.end("recall");
  }
  return out;
}

/// The cloud's points, which are along the curve, as surfels in the order of the file; they stay
/// where they are in the cloud if `points` have no positions.
SurfelCloud in_file_order(const SurfelCloud& cloud, OrderedPoints points,
                          const PointEstimates& estimates) {
  const Array<std::uint32_t> place = file_order(cloud.size(), points.order);
  SurfelCloud out = cloud.gathered(points.order);
  points.order = {};
  if (!points.position.empty()) {
    parallel_each(out.size(), kCloudGrain,
                  [&](std::size_t i) { out.position[i] = points.position[place[i]]; });
  }
  set_estimates(estimates, place, out);
  return out;
}

}  // namespace

std::vector<std::string> EstimateOptions::problems() const {
  std::vector<std::string> found = normals.problems();
  const auto add = [&](const std::vector<std::string>& more) {
    found.insert(found.end(), more.begin(), more.end());
  };
  add(orientation.problems());
  add(size.problems());
  if (edges) add(edges->problems());
  if (outliers) add(outliers->problems());
  if (voxels) add(voxels->problems());
  if (smoothing) add(smoothing->problems());
  return found;
}

SurfelCloud estimate_surfels(const SurfelCloud& cloud, const EstimateOptions& options,
                             EstimateReport* report, const std::string& name) {
  require_usable(options);
  EstimateReport r;
  r.points = cloud.size();
  StageTimer stage(r.times);
  OrderedPoints points = finite_points(cloud, name);
  r.nonfinite = cloud.size() - points.order.size();
  r.unusable_colors = unusable_colors(cloud);
  if (options.orientation.method == Orientation::kAlign) {
    r.without_normal = without_normal(cloud, points, name);
  }
  stage.end("sort");
  if (options.outliers) {
    r.outliers = remove_outliers(*options.outliers, name, points);
    stage.end("outliers");
  }
  SurfelCloud fewer;
  if (options.voxels) {
    fewer = thinned(cloud, *options.voxels, name, points, r);
    stage.end("voxels");
  }
  if (options.smoothing) {
    smooth(options, points, r);
    stage.end("smoothing");
  }
  const SurfelCloud& source = options.voxels ? fewer : cloud;
  const PointEstimates estimates = estimate_points(source, points, options, name, stage, r);
  if (!options.smoothing) points.position = {};  // The surfels need the memory.
  SurfelCloud out = in_file_order(source, std::move(points), estimates);
  stage.end("gather");
  if (report) *report = std::move(r);
  return out;
}

}  // namespace surfel
