#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/morton.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/base/progress.h>
#include <surfel/base/stage_timer.h>
#include <surfel/lod/cluster_levels.h>
#include <surfel/lod/hierarchy.h>
#include <surfel/lod/surfel_merge.h>
#include <surfel/lod/surfel_partition.h>
#include <surfel/scene/amplitude.h>
#include <surfel/scene/cluster_tree.h>
#include <surfel/scene/surfel_variance.h>

namespace surfel {
namespace {

constexpr std::size_t kGrain = std::size_t{1} << 15;
constexpr std::size_t kClusterGrain = 8;

/// One level: its clusters, which count surfels and children from the level's first, and its merged
/// surfels; level 0 has none.
struct Level {
  std::vector<TreeCluster> clusters;
  Array<MergeSurfel> surfels;
};

class Builder {
 public:
  Builder(const SurfelCloud& cloud, const HierarchyOptions& options, const std::string& name)
      : cloud_(cloud), options_(options), name_(name) {}

  SurfelCloud build(HierarchyReport& report);

 private:
  void order_finest(StageTimer& stage, HierarchyReport& report);
  void make_finest();
  void make_coarser();
  void bound_discs(TreeCluster& cluster) const;
  SurfelCloud assemble() const;
  void write_merged(SurfelCloud& out, std::size_t at, const MergeSurfel& s) const;

  const SurfelCloud& cloud_;
  const HierarchyOptions& options_;
  const std::string& name_;
  Array<std::uint32_t> finest_;  ///< Surfels of the cloud in the order of level 0.
  std::vector<Level> levels_;
};

void Builder::order_finest(StageTimer& stage, HierarchyReport& report) {
  Array<std::uint32_t> order = morton_order(cloud_.position);
  report.dropped = remove_unusable(cloud_, false, order);
  if (order.empty()) throw_input(name_, "holds no surfel that can be drawn");
  stage.end("sort");
  finest_ = cluster_order(cloud_.position, order, options_.reduction);
  stage.end("split");
}

/// The larger of the largest standard deviation and the root of the area, which renderers widen
/// kernels to where they draw a level closer than it is meant to be seen.
float reach_of(const MergeSurfel& s) {
  const auto& c = s.covariance;
  return std::sqrt(std::max({c[0] + c[3] + c[5], s.area, 0.0F}));
}

/// Root of the mean square of the pieces' longer sides, by area.
float spacing_of(std::span<const MergeSurfel> surfels) {
  double area = 0;
  double spacing2 = 0;
  for (const MergeSurfel& s : surfels) {
    area += s.area;
    spacing2 += static_cast<double>(s.area) * s.extent2;
  }
  return area > 0 ? static_cast<float>(std::sqrt(spacing2 / area)) : 0.0F;
}

/// Bounds of a cluster of level 0, whose surfels are drawn as they are.
ClusterBounds bounds_of(const std::vector<MergeSurfel>& surfels) {
  constexpr std::size_t kSize = kClusterSurfels + kColumnPadding;
  std::array<float, 7 * kSize> columns{};
  const auto column = [&](std::size_t i) { return columns.data() + i * kSize; };
  for (std::size_t i = 0; i < surfels.size(); ++i) {
    const MergeSurfel& s = surfels[i];
    for (int axis = 0; axis < 3; ++axis) {
      column(axis)[i] = s.position[axis];
      column(3 + axis)[i] = s.normal[axis];
    }
    column(6)[i] = std::sqrt(tangent_gaussian(s.covariance, s.normal).variance_u);
  }
  return cluster_bounds({.position = {column(0), column(1), column(2)},
                         .normal = {column(3), column(4), column(5)},
                         .deviation_u = column(6),
                         .deviation_v = column(6),
                         .count = surfels.size()});
}

/// Box around the discs of a cluster of level 0.
void Builder::bound_discs(TreeCluster& cluster) const {
  const Array<float>& variance = cloud_.anisotropic() ? cloud_.variance_u : cloud_.variance;
  cluster.reach_min = Vec3f::Constant(std::numeric_limits<float>::infinity());
  cluster.reach_max = -cluster.reach_min;
  for (std::uint32_t i = cluster.begin; i < cluster.end; ++i) {
    const Vec3f& position = cloud_.position[finest_[i]];
    const Vec3f reach = Vec3f::Constant(std::sqrt(variance[finest_[i]]));
    cluster.reach_min = cluster.reach_min.cwiseMin(position - reach);
    cluster.reach_max = cluster.reach_max.cwiseMax(position + reach);
  }
}

void Builder::make_finest() {
  Level& level = levels_.emplace_back();
  level.clusters = finest_clusters(finest_.size());
  parallel_for(level.clusters.size(), kClusterGrain, [&](std::size_t first, std::size_t last, int) {
    std::vector<MergeSurfel> surfels;
    for (std::size_t c = first; c < last; ++c) {
      TreeCluster& cluster = level.clusters[c];
      surfels.clear();
      for (std::uint32_t i = cluster.begin; i < cluster.end; ++i) {
        surfels.push_back(merge_surfel(cloud_, finest_[i]));
      }
      cluster.spacing = spacing_of(surfels);
      cluster.bounds = bounds_of(surfels);
      bound_discs(cluster);
    }
  });
}

/// Cone around the cones of all children.
void bound_cone(ClusterBounds& bounds, std::span<const TreeCluster> children) {
  Vec3f sum(0, 0, 0);
  for (const TreeCluster& child : children) {
    if (child.bounds.cone_cosine < 0) return;
    sum += child.bounds.cone_axis;
  }
  const float length = sum.norm();
  if (!(length > 0)) return;
  const Vec3f axis = sum / length;
  float angle = 0;
  for (const TreeCluster& child : children) {
    angle =
        std::max(angle, portable::acos(std::clamp(axis.dot(child.bounds.cone_axis), -1.0F, 1.0F)) +
                            portable::acos(std::min(1.0F, child.bounds.cone_cosine)));
  }
  const float cosine = portable::cos(std::min(angle, 3.0F)) - 1e-5F;
  if (cosine <= kWidestCone) return;
  bounds.cone_axis = axis;
  bounds.cone_cosine = cosine;
}

void Builder::make_coarser() {
  const std::size_t number = levels_.size();
  levels_.emplace_back();
  Level& level = levels_.back();
  const Level& finer = levels_[number - 1];
  level.clusters = coarser_clusters(finer.clusters, options_.reduction);
  level.surfels.resize(level.clusters.back().end);

  struct Worker {
    SurfelPartition partition;
    std::vector<MergeSurfel> members;
  };
  PerWorker<Worker> workers;
  ProgressStage stage("merging a level of detail", level.clusters.size(), "clusters");
  parallel_for(
      level.clusters.size(), kClusterGrain, [&](std::size_t first, std::size_t last, int w) {
        stage.add(last - first);
        Worker& worker = workers[w];
        for (std::size_t c = first; c < last; ++c) {
          TreeCluster& cluster = level.clusters[c];
          const std::span<const TreeCluster> children(finer.clusters.data() + cluster.first_child,
                                                      cluster.child_count);
          worker.members.clear();
          for (std::uint32_t i = children.front().begin; i < children.back().end; ++i) {
            worker.members.push_back(finer.surfels.empty() ? merge_surfel(cloud_, finest_[i])
                                                           : finer.surfels[i]);
          }
          worker.partition.run(worker.members, cluster.end - cluster.begin, options_.sheets);
          float reach = 0;
          for (std::size_t g = 0; g < worker.partition.size(); ++g) {
            MergeSurfel s = merged(worker.members, worker.partition.members(g));
            s.extent2 = worker.partition.extent2(g);
            reach = std::max(reach, reach_of(s));
            level.surfels[cluster.begin + g] = s;
          }
          cluster.spacing =
              spacing_of({level.surfels.data() + cluster.begin, cluster.end - cluster.begin});
          cluster.bounds.max_deviation = reach;
          cluster.reach_min = children.front().reach_min;
          cluster.reach_max = children.front().reach_max;
          for (const TreeCluster& child : children) {
            cluster.bounds.max_deviation =
                std::max(cluster.bounds.max_deviation, child.bounds.max_deviation);
            cluster.reach_min = cluster.reach_min.cwiseMin(child.reach_min);
            cluster.reach_max = cluster.reach_max.cwiseMax(child.reach_max);
          }
          bound_sphere(cluster.bounds, cloud_.position,
                       finest_below(finest_, number, c, options_.reduction));
          bound_cone(cluster.bounds, children);
        }
      });
}

void Builder::write_merged(SurfelCloud& out, std::size_t at, const MergeSurfel& s) const {
  write_attributes(out, at, s);
  const TangentGaussian g = tangent_gaussian(s.covariance, s.normal);
  // A variance of zero is no surfel: collinear members of a plane leave a sliver.
  constexpr float kSliver = 1e-6F;
  out.tangent[at] = g.tangent;
  out.variance_u[at] = g.variance_u;
  out.variance_v[at] = std::max(g.variance_v, kSliver * g.variance_u);
}

/// The surfels of all levels, coarsest first, and their tree.
SurfelCloud Builder::assemble() const {
  std::size_t total = finest_.size();
  for (const Level& level : levels_) total += level.surfels.size();
  Array<std::uint32_t> source(total);
  std::size_t at = 0;
  for (auto level = levels_.rbegin(); level != levels_.rend(); ++level) {
    for (const MergeSurfel& s : level->surfels) source[at++] = s.source;
  }
  std::copy(finest_.begin(), finest_.end(), source.begin() + static_cast<std::ptrdiff_t>(at));
  SurfelCloud out = cloud_.gathered(source);

  const bool anisotropic = cloud_.anisotropic();
  if (!anisotropic) {
    out.tangent.resize(total);
    out.variance_u = out.variance;
    out.variance_v = std::move(out.variance);
  }
  out.variance = {};
  if (cloud_.area.empty()) out.area.resize(total);
  out.level.resize(total);
  parallel_for(finest_.size(), kGrain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t i = begin; i < end; ++i) {
      const std::size_t k = at + i;
      if (!anisotropic) {
        const bool oriented = !out.normal.empty() && !out.normal[k].isZero();
        out.tangent[k] = oriented ? Vec3f(out.normal[k].unitOrthogonal()) : Vec3f::UnitX();
      }
      if (cloud_.area.empty()) out.area[k] = root_of_determinant(cloud_, source[k]);
      out.level[k] = 0;
    }
  });

  std::vector<std::span<const TreeCluster>> clusters;
  for (const Level& level : levels_) clusters.emplace_back(level.clusters);
  out.tree = joined_levels(clusters);
  std::size_t surfels = 0;
  for (std::size_t l = levels_.size(); l-- > 0;) {
    const Level& level = levels_[l];
    parallel_for(level.surfels.size(), kGrain, [&](std::size_t begin, std::size_t end, int) {
      for (std::size_t i = begin; i < end; ++i) {
        write_merged(out, surfels + i, level.surfels[i]);
        out.level[surfels + i] = static_cast<std::uint8_t>(l);
      }
    });
    surfels += l > 0 ? level.surfels.size() : finest_.size();
  }
  return out;
}

SurfelCloud Builder::build(HierarchyReport& report) {
  StageTimer stage(report.stages);
  order_finest(stage, report);
  make_finest();
  while (levels_.back().clusters.size() > 1) make_coarser();
  stage.end("merge");
  for (const Level& level : levels_) {
    double area = 0;
    double spacing2 = 0;
    for (const TreeCluster& cluster : level.clusters) {
      area += cluster.end - cluster.begin;
      spacing2 +=
          (cluster.end - cluster.begin) * portable::squared(static_cast<double>(cluster.spacing));
    }
    report.levels.push_back(level.clusters.back().end);
    report.spacing.push_back(std::sqrt(spacing2 / area));
    report.clusters += level.clusters.size();
  }
  SurfelCloud out = assemble();
  stage.end("assemble");
  return out;
}

}  // namespace

std::vector<std::string> HierarchyOptions::problems() const {
  std::vector<std::string> found = sheets.problems();
  check_option(found, reduction >= 2 && reduction <= 16, "reduction", reduction, "in 2..16");
  return found;
}

SurfelCloud build_hierarchy(const SurfelCloud& cloud, const HierarchyOptions& options,
                            HierarchyReport* report, const std::string& name) {
  require_usable(options);
  cloud.check_columns(name);
  if (cloud.empty()) throw_input(name, "holds no surfel");
  if (!has_variance(cloud)) {
    throw_input(name,
                "the surfels have no variance (nor radius); make it with surfel-from-mesh or "
                "surfel-estimate");
  }
  // Together with all coarser levels, 32-bit indices must do.
  if (cloud.size() > std::numeric_limits<std::uint32_t>::max() / 2 - (1U << 20)) {
    throw_input(name, "holds more than 2.1 billion surfels; levels of detail take no more");
  }
  HierarchyReport own;
  HierarchyReport& r = report ? *report : own;
  r = {};
  SurfelCloud made = Builder(cloud, options, name).build(r);
  // Moments are areas times squared distances, which overflow long before the lengths do.
  if (!tree_problem(made.tree, made.size()).empty()) {
    throw_input(name,
                "its extent is too large for single precision, in which surfels are merged; "
                "scale it down, or remove points that lie far away");
  }
  return made;
}

}  // namespace surfel
