#include <algorithm>
#include <limits>
#include <memory>

#include <surfel/base/error.h>
#include <surfel/base/morton.h>
#include <surfel/base/parallel.h>
#include <surfel/estimate/estimate.h>
#include <surfel/surface/neighbor_lists.h>

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

/// Turns the order of points along the curve into that of the file: `order` becomes the points that
/// are left, ascending; returned is the place of each along the curve.
Array<std::uint32_t> file_order(std::size_t count, Array<std::uint32_t>& order) {
  constexpr std::uint32_t kRemoved = std::numeric_limits<std::uint32_t>::max();
  Array<std::uint32_t> place(count);
  if (order.size() < count) place.assign(count, kRemoved);
  parallel_for(order.size(), kGrain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t i = begin; i < end; ++i) place[order[i]] = static_cast<std::uint32_t>(i);
  });
  if (order.size() == count) {  // None was removed.
    parallel_for(count, kGrain, [&](std::size_t begin, std::size_t end, int) {
      for (std::size_t i = begin; i < end; ++i) order[i] = static_cast<std::uint32_t>(i);
    });
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

/// Adds a property, in place of one of its name, and returns its values.
template <class T>
T* add_extra(SurfelCloud& cloud, const std::string& name, ScalarType type) {
  std::erase_if(cloud.extra, [&](const ExtraProperty& p) { return p.name == name; });
  ExtraProperty& property = cloud.extra.emplace_back(ExtraProperty{name, type, {}});
  property.data.resize(cloud.size() * sizeof(T));
  return reinterpret_cast<T*>(property.data.data());
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
    if (kept.empty()) throw_input(name, "every point is an outlier; raise `deviations`");
    order = std::move(kept);
    position = std::move(kept_position);
    lap("outliers");
  }

  auto tree = make_neighbor_search(position, options.search);
  // All stages go over the same neighbourhoods, but for large or adaptive ones of the normals.
  std::size_t shared =
      static_cast<std::size_t>(std::max(options.size.neighbors, options.orientation.neighbors + 1));
  if (!options.normals.adaptive && options.normals.radius == 0) {
    shared = std::max(shared, static_cast<std::size_t>(std::min(options.normals.k, kMostShared)));
  }
  auto search = std::make_unique<const NeighborLists>(*tree, position, shared);
  lap("search tree");
  NormalEstimate normals = estimate_normals(position, *search, options.normals);
  r.flagged = normals.flagged;
  r.extended = normals.extended;
  r.mean_neighbors = static_cast<double>(normals.neighbors) / static_cast<double>(position.size());
  lap("neighbors and normals");
  Array<Vec3f> previous;
  if (options.orientation.method == Orientation::kAlign && !cloud.normal.empty()) {
    previous = gathered(cloud.normal, order);
  }
  r.orientation = orient_normals(position, cloud.origin, *search, previous, options.orientation,
                                 normals.normal);
  lap("orientation");
  const SplatSizes sizes =
      estimate_splat_sizes(position, normals.normal,
                           options.orientation.method != Orientation::kNone, *search, options.size);
  r.border = sizes.border;
  r.capped = sizes.capped;
  r.anisotropic = sizes.ellipses;
  lap("sizes");

  if (options.search == SearchMethod::kFlannApproximate) {
    const int k = options.normals.adaptive ? options.normals.k_max : options.normals.k;
    r.search_recall = neighbor_recall(position, *tree, static_cast<std::size_t>(k));
    lap("recall");
  }
  // What comes next needs the memory.
  search.reset();
  tree.reset();
  position = {};

  // Back to the order of the file.
  const Array<std::uint32_t> place = file_order(cloud.size(), order);
  SurfelCloud out = cloud.gathered(order);
  const std::size_t count = out.size();
  out.normal.resize(count);
  out.area.resize(count);
  out.variance.resize(r.anisotropic ? 0 : count);
  out.tangent.resize(r.anisotropic ? count : 0);
  out.variance_u.resize(r.anisotropic ? count : 0);
  out.variance_v.resize(r.anisotropic ? count : 0);
  auto* curvature = add_extra<float>(out, "curvature", ScalarType::kFloat32);
  auto* confidence = add_extra<float>(out, "confidence", ScalarType::kFloat32);
  static_assert(sizeof(PointFlag) == 1);
  auto* flag = add_extra<PointFlag>(out, "flag", ScalarType::kUint8);
  parallel_for(count, kGrain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t i = begin; i < end; ++i) {
      const std::uint32_t from = place[i];
      const SplatSize& size = sizes.of[from];
      const NormalQuality& quality = normals.quality[from];
      out.normal[i] = normals.normal[from];
      out.area[i] = size.area;
      if (r.anisotropic) {
        out.tangent[i] = size.tangent;
        out.variance_u[i] = size.variance_u;
        out.variance_v[i] = size.variance_v;
      } else {
        out.variance[i] = size.variance;
      }
      curvature[i] = quality.curvature;
      confidence[i] = quality.confidence;
      flag[i] = quality.flag;
    }
  });
  lap("gather");
  if (report) *report = std::move(r);
  return out;
}

}  // namespace surfel
