#include <algorithm>
#include <cstring>
#include <numeric>

#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/cloud/morton.h>
#include <surfel/estimate/estimate.h>
#include <surfel/estimate/neighbor_lists.h>

namespace surfel {
namespace {

/// Neighbourhoods of the normals are kept up to this size.
constexpr int kMostShared = 64;

constexpr std::size_t kGrain = 1 << 14;

/// Values of points order[0], order[1], ...
template <class T>
Array<T> gathered(const Array<T>& values, const Array<std::uint32_t>& order) {
  Array<T> out(order.size());
  parallel_for(order.size(), kGrain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t i = begin; i < end; ++i) out[i] = values[order[i]];
  });
  return out;
}

/// Values of points order[0], order[1], ... as a column in the order of the file, `rank[i]` being
/// the place of point i there.
template <class T>
Array<T> in_file_order(const Array<T>& values, const Array<std::uint32_t>& rank) {
  Array<T> out(values.size());
  parallel_for(values.size(), kGrain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t i = begin; i < end; ++i) out[rank[i]] = values[i];
  });
  return out;
}

template <class T>
void set_extra(SurfelCloud& cloud, const std::string& name, ScalarType type,
               const Array<T>& values) {
  std::erase_if(cloud.extra, [&](const ExtraProperty& p) { return p.name == name; });
  ExtraProperty property;
  property.name = name;
  property.type = type;
  property.data.resize(values.size() * sizeof(T));
  if (!values.empty()) std::memcpy(property.data.data(), values.data(), property.data.size());
  cloud.extra.push_back(std::move(property));
}

}  // namespace

std::vector<std::string> EstimateOptions::problems() const {
  std::vector<std::string> found = normals.problems();
  const auto add = [&](const std::vector<std::string>& more) {
    found.insert(found.end(), more.begin(), more.end());
  };
  add(orientation.problems());
  add(size.problems());
  if (outliers) add(outliers->problems());
  return found;
}

SurfelCloud estimate_surfels(const SurfelCloud& cloud, const EstimateOptions& options,
                             EstimateReport* report, const std::string& name) {
  for (const std::string& problem : options.problems()) throw_usage(problem);
  EstimateReport r;
  r.points = cloud.size();
  Timer timer;
  const auto lap = [&](const char* stage) {
    r.times.add(stage, timer.milliseconds());
    timer.restart();
  };

  // Along a space-filling curve neighbours are near in memory, too. Points that are not finite come
  // last.
  Array<std::uint32_t> order = morton_order(cloud.position);
  const auto finite = std::partition_point(
      order.begin(), order.end(), [&](std::uint32_t i) { return cloud.position[i].allFinite(); });
  order.erase(finite, order.end());
  r.nonfinite = cloud.size() - order.size();
  if (order.empty()) throw_input(name, "there is no point with finite coordinates");
  Array<Vec3f> position = gathered(cloud.position, order);
  lap("sort");
  if (options.outliers) {
    const Array<std::uint8_t> inlier = inliers(position, *options.outliers);
    Array<std::uint32_t> kept;
    Array<Vec3f> kept_position;
    for (std::size_t i = 0; i < order.size(); ++i) {
      if (inlier[i] == 0) continue;
      kept.push_back(order[i]);
      kept_position.push_back(position[i]);
    }
    r.outliers = order.size() - kept.size();
    if (kept.empty()) throw_input(name, "every point is an outlier; raise --outlier-deviations");
    order = std::move(kept);
    position = std::move(kept_position);
    lap("outliers");
  }

  const auto tree = make_neighbor_search(position, options.search);
  // All stages go over the same neighbourhoods, but for large or adaptive ones of the normals.
  std::size_t shared =
      static_cast<std::size_t>(std::max(options.size.neighbors, options.orientation.neighbors + 1));
  if (!options.normals.adaptive && options.normals.radius == 0) {
    shared = std::max(shared, static_cast<std::size_t>(std::min(options.normals.k, kMostShared)));
  }
  const NeighborLists search(*tree, position, shared);
  lap("search tree");
  NormalEstimate normals = estimate_normals(position, search, options.normals);
  r.flagged = normals.flagged;
  r.extended = normals.extended;
  r.mean_neighbors = std::accumulate(normals.neighbors.begin(), normals.neighbors.end(), 0.0) /
                     static_cast<double>(order.size());
  lap("neighbors and normals");
  Array<Vec3f> previous;
  if (options.orientation.method == Orientation::kAlign && !cloud.normal.empty()) {
    previous = gathered(cloud.normal, order);
  }
  r.orientation =
      orient_normals(position, cloud.origin, search, previous, options.orientation, normals.normal);
  lap("orientation");
  const SplatSizes sizes =
      estimate_splat_sizes(position, normals.normal,
                           options.orientation.method != Orientation::kNone, search, options.size);
  r.border = sizes.border;
  r.capped = sizes.capped;
  r.anisotropic = !sizes.tangent.empty();
  lap("sizes");

  // Back to the order of the file.
  Array<std::uint8_t> kept;
  kept.assign(cloud.size(), 0);
  for (const std::uint32_t i : order) kept[i] = 1;
  Array<std::uint32_t> by_file;
  by_file.reserve(order.size());
  Array<std::uint32_t> place(cloud.size());
  for (std::uint32_t i = 0; i < cloud.size(); ++i) {
    place[i] = static_cast<std::uint32_t>(by_file.size());
    if (kept[i] != 0) by_file.push_back(i);
  }
  const Array<std::uint32_t> rank = gathered(place, order);
  SurfelCloud out = cloud.gathered(by_file);
  out.normal = in_file_order(normals.normal, rank);
  out.variance = {};
  out.tangent = {};
  out.variance_u = {};
  out.variance_v = {};
  if (r.anisotropic) {
    out.tangent = in_file_order(sizes.tangent, rank);
    out.variance_u = in_file_order(sizes.variance_u, rank);
    out.variance_v = in_file_order(sizes.variance_v, rank);
  } else {
    out.variance = in_file_order(sizes.variance, rank);
  }
  out.area = in_file_order(sizes.area, rank);
  set_extra(out, "curvature", ScalarType::kFloat32, in_file_order(normals.curvature, rank));
  set_extra(out, "confidence", ScalarType::kFloat32, in_file_order(normals.confidence, rank));
  static_assert(sizeof(PointFlag) == 1);
  set_extra(out, "flag", ScalarType::kUint8, in_file_order(normals.flag, rank));
  lap("gather");
  if (options.search == SearchMethod::kFlannApproximate) {
    const int k = options.normals.adaptive ? options.normals.k_max : options.normals.k;
    r.search_recall = neighbor_recall(position, *tree, static_cast<std::size_t>(k));
    lap("recall");
  }
  if (report) *report = std::move(r);
  return out;
}

}  // namespace surfel
