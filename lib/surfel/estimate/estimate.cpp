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

/// Indices of the points of `order` that `keep` says yes to.
template <class Keep>
Array<std::uint32_t> filtered(const Array<std::uint32_t>& order, Keep keep) {
  Array<std::uint32_t> out;
  out.reserve(order.size());
  for (const std::uint32_t i : order) {
    if (keep(i)) out.push_back(i);
  }
  return out;
}

/// Values of points order[0], order[1], ... as a column in the order of the file, `rank[i]` being
/// the place of point i there.
template <class T>
Array<T> in_file_order(const Array<T>& values, const Array<std::uint32_t>& rank) {
  Array<T> out(values.size());
  for (std::size_t i = 0; i < values.size(); ++i) out[rank[i]] = values[i];
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

  // Along a space-filling curve neighbours are near in memory, too.
  Array<std::uint32_t> order = filtered(
      morton_order(cloud.position), [&](std::uint32_t i) { return cloud.position[i].allFinite(); });
  r.nonfinite = cloud.size() - order.size();
  if (order.empty()) throw_input(name, "there is no point with finite coordinates");
  Array<Vec3f> position(order.size());
  for (std::size_t i = 0; i < order.size(); ++i) position[i] = cloud.position[order[i]];
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
  lap("neighbors");
  NormalEstimate normals = estimate_normals(position, search, options.normals);
  r.flagged = normals.flagged;
  r.extended = normals.extended;
  r.mean_neighbors = std::accumulate(normals.neighbors.begin(), normals.neighbors.end(), 0.0) /
                     static_cast<double>(order.size());
  lap("normals");
  Array<Vec3f> previous;
  if (!cloud.normal.empty()) {
    previous.resize(order.size());
    for (std::size_t i = 0; i < order.size(); ++i) previous[i] = cloud.normal[order[i]];
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
  Array<std::uint32_t> by_file = order;
  std::sort(by_file.begin(), by_file.end());
  Array<std::uint32_t> place(cloud.size());
  for (std::size_t i = 0; i < by_file.size(); ++i) {
    place[by_file[i]] = static_cast<std::uint32_t>(i);
  }
  Array<std::uint32_t> rank(order.size());
  for (std::size_t i = 0; i < order.size(); ++i) rank[i] = place[order[i]];
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
  Array<std::uint8_t> flag(order.size());
  for (std::size_t i = 0; i < order.size(); ++i) {
    flag[rank[i]] = static_cast<std::uint8_t>(normals.flag[i]);
  }
  set_extra(out, "flag", ScalarType::kUint8, flag);
  lap("gather");
  if (report) *report = std::move(r);
  return out;
}

}  // namespace surfel
