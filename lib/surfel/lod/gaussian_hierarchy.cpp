#include <algorithm>
#include <cmath>
#include <limits>

#include <surfel/base/error.h>
#include <surfel/base/morton.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/base/progress.h>
#include <surfel/base/stage_timer.h>
#include <surfel/lod/cluster_levels.h>
#include <surfel/lod/gaussian_hierarchy.h>
#include <surfel/lod/gaussian_merge.h>
#include <surfel/lod/gaussian_reduction.h>

namespace surfel {
namespace {

constexpr std::size_t kGatherGrain = 1024;

/// One level: its clusters, which count Gaussians and children from the level's first, and its
/// Gaussians; of the finest level they are the cloud's.
struct GaussianLevel {
  std::vector<TreeCluster> clusters;
  MergeGaussians sums;
  GaussianCloud drawn;
};

class GaussianHierarchy {
 public:
  GaussianHierarchy(const GaussianCloud& cloud, int reduction)
      : cloud_(cloud), reduction_(reduction) {}

  GaussianCloud build(const std::string& name, GaussianHierarchyReport& report);

 private:
  void make_finest();
  void make_coarser();
  MergeGaussians members_of(const GaussianLevel& finer, std::uint32_t begin,
                            std::uint32_t end) const;
  void bound(TreeCluster& cluster, std::size_t number, std::size_t index,
             const GaussianCloud& drawn, std::span<const TreeCluster> children) const;
  GaussianCloud assemble() const;

  const GaussianCloud& cloud_;
  int reduction_;
  Array<std::uint32_t> finest_;  ///< Gaussians of the cloud in the order of level 0.
  std::vector<GaussianLevel> levels_;
};

void GaussianHierarchy::make_finest() {
  GaussianLevel& level = levels_.emplace_back();
  level.clusters = finest_clusters(finest_.size());
  level.drawn = cloud_.without_gaussians();
  level.drawn.resize(finest_.size());
  parallel_each(finest_.size(), kGatherGrain,
                [&](std::size_t i) { level.drawn.assign(i, cloud_, finest_[i]); });
  parallel_each(level.clusters.size(), 8,
                [&](std::size_t c) { bound(level.clusters[c], 0, c, level.drawn, {}); });
}

/// Fills in a cluster's bounds: the sphere of all Gaussians of the finest level below it, and the
/// largest deviation of its own Gaussians and of all below.
void GaussianHierarchy::bound(TreeCluster& cluster, std::size_t number, std::size_t index,
                              const GaussianCloud& drawn,
                              std::span<const TreeCluster> children) const {
  const std::span<const std::uint32_t> members = finest_below(finest_, number, index, reduction_);
  ClusterBounds& bounds = cluster.bounds;
  bound_sphere(bounds, cloud_.position, members);
  for (std::uint32_t i = cluster.begin; i < cluster.end; ++i) {
    bounds.max_deviation = std::max(bounds.max_deviation, drawn.scale[i].maxCoeff());
  }
  cluster.reach_min = Vec3f::Constant(std::numeric_limits<float>::infinity());
  cluster.reach_max = -cluster.reach_min;
  const auto add = [&](const Vec3f& low, const Vec3f& high) {
    cluster.reach_min = cluster.reach_min.cwiseMin(low);
    cluster.reach_max = cluster.reach_max.cwiseMax(high);
  };
  for (const TreeCluster& child : children) {
    bounds.max_deviation = std::max(bounds.max_deviation, child.bounds.max_deviation);
    add(child.reach_min, child.reach_max);
  }
  if (!children.empty()) return;
  for (const std::uint32_t i : members) {
    const Vec3f reach = Vec3f::Constant(cloud_.scale[i].maxCoeff());
    add(cloud_.position[i] - reach, cloud_.position[i] + reach);
  }
}

/// The Gaussians [begin, end) of a level, to be merged.
MergeGaussians GaussianHierarchy::members_of(const GaussianLevel& finer, std::uint32_t begin,
                                             std::uint32_t end) const {
  if (finer.sums.size() == 0) {
    return merge_gaussians(cloud_, std::span(finest_).subspan(begin, end - begin));
  }
  MergeGaussians out;
  out.rule = finer.sums.rule;
  out.stride = finer.sums.stride;
  out.resize(end - begin);
  for (std::uint32_t i = begin; i < end; ++i) out.assign(i - begin, finer.sums, i);
  return out;
}

/// Twice the largest standard deviation of the Gaussians that were merged, in the mean.
float spacing_of(const MergeGaussians& sums, const GaussianCloud& drawn,
                 const TreeCluster& cluster) {
  double sum = 0;
  std::size_t merged = 0;
  for (std::uint32_t i = cluster.begin; i < cluster.end; ++i) {
    if (sums.source[i] != MergeGaussians::kMerged) continue;
    sum += 2 * double{drawn.scale[i].maxCoeff()};
    ++merged;
  }
  return merged > 0 ? static_cast<float>(sum / static_cast<double>(merged)) : 0.0F;
}

void GaussianHierarchy::make_coarser() {
  const std::size_t number = levels_.size();
  levels_.emplace_back();
  GaussianLevel& level = levels_.back();
  const GaussianLevel& finer = levels_[number - 1];
  level.clusters = coarser_clusters(finer.clusters, reduction_);
  level.sums.rule = cloud_.rule;
  level.sums.stride = cloud_.harmonics_stride();
  level.sums.resize(level.clusters.back().end);
  const auto children_of = [&](const TreeCluster& cluster) {
    return std::span(finer.clusters).subspan(cluster.first_child, cluster.child_count);
  };
  PerWorker<GaussianReduction> workers;
  ProgressStage stage("merging a level of detail", level.clusters.size(), "clusters");
  parallel_for(level.clusters.size(), 1, [&](std::size_t c, std::size_t, int worker) {
    const TreeCluster& cluster = level.clusters[c];
    const std::span<const TreeCluster> children = children_of(cluster);
    MergeGaussians members = members_of(finer, children.front().begin, children.back().end);
    const double blur = group_blur(members, static_cast<std::size_t>(reduction_));
    workers[worker].run(members, cluster.end - cluster.begin, blur);
    for (std::uint32_t i = cluster.begin; i < cluster.end; ++i) {
      level.sums.assign(i, members, i - cluster.begin);
    }
    stage.add(1);
  });
  level.drawn = drawn_gaussians(level.sums, cloud_);
  parallel_each(level.clusters.size(), 8, [&](std::size_t c) {
    TreeCluster& cluster = level.clusters[c];
    cluster.spacing = spacing_of(level.sums, level.drawn, cluster);
    bound(cluster, number, c, level.drawn, children_of(cluster));
  });
}

/// The Gaussians of all levels, coarsest first, and their tree.
GaussianCloud GaussianHierarchy::assemble() const {
  std::size_t total = 0;
  std::vector<std::span<const TreeCluster>> clusters;
  for (const GaussianLevel& level : levels_) {
    total += level.drawn.size();
    clusters.emplace_back(level.clusters);
  }
  GaussianCloud out = cloud_.without_gaussians();
  out.resize(total);
  std::size_t at = 0;
  for (std::size_t l = levels_.size(); l-- > 0;) {
    const GaussianCloud& drawn = levels_[l].drawn;
    parallel_each(drawn.size(), kGatherGrain, [&](std::size_t i) { out.assign(at + i, drawn, i); });
    at += drawn.size();
  }
  out.tree = joined_levels(clusters);
  return out;
}

GaussianCloud GaussianHierarchy::build(const std::string& name, GaussianHierarchyReport& report) {
  StageTimer stage(report.stages);
  Array<std::uint32_t> order = morton_order(cloud_.position);
  report.unseen = without_massless(cloud_, order, name);
  finest_ = cluster_order(cloud_.position, order, reduction_);
  stage.end("sort");
  make_finest();
  while (levels_.back().clusters.size() > 1) {
    make_coarser();
    levels_[levels_.size() - 2].sums = {};
  }
  stage.end("merge");
  for (const GaussianLevel& level : levels_) {
    double sum = 0;
    for (const TreeCluster& cluster : level.clusters) sum += double{cluster.spacing};
    report.levels.push_back(level.drawn.size());
    report.spacing.push_back(sum / static_cast<double>(level.clusters.size()));
    report.clusters += level.clusters.size();
  }
  GaussianCloud out = assemble();
  stage.end("assemble");
  return out;
}

}  // namespace

std::vector<std::string> GaussianHierarchyOptions::problems() const {
  std::vector<std::string> found;
  check_option(found, reduction >= 2 && reduction <= 16, "reduction", reduction, "in 2..16");
  return found;
}

GaussianCloud build_gaussian_hierarchy(const GaussianCloud& cloud,
                                       const GaussianHierarchyOptions& options,
                                       const std::string& name, GaussianHierarchyReport* report) {
  require_usable(options);
  // Together with all coarser levels, 32-bit indices must do.
  if (cloud.size() > std::numeric_limits<std::uint32_t>::max() / 2 - (1U << 20)) {
    throw_input(name, "holds more than 2.1 billion Gaussians; levels of detail take no more");
  }
  GaussianHierarchyReport done;
  GaussianCloud out = GaussianHierarchy(cloud, options.reduction).build(name, done);
  if (report) *report = done;
  return out;
}

}  // namespace surfel
