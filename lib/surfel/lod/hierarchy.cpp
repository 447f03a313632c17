#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>
#include <optional>
#include <span>
#include <string_view>
#include <type_traits>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/base/progress.h>
#include <surfel/base/stage_timer.h>
#include <surfel/lod/cluster_levels.h>
#include <surfel/lod/hierarchy.h>
#include <surfel/lod/level_columns.h>
#include <surfel/lod/level_plan.h>
#include <surfel/lod/surfel_merge.h>
#include <surfel/lod/surfel_partition.h>
#include <surfel/scene/amplitude.h>
#include <surfel/scene/cloud_rows.h>
#include <surfel/scene/cluster_tree.h>
#include <surfel/scene/curve_blocks.h>
#include <surfel/scene/surfel_variance.h>

namespace surfel {
namespace {

constexpr std::size_t kGrain = std::size_t{1} << 13;
constexpr std::size_t kClusterGrain = 8;

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

/// Gives row i of a cloud with level_columns() what a merged surfel has.
void write_merged(SurfelCloud& out, std::size_t i, const MergeSurfel& s, std::size_t level) {
  write_attributes(out, i, s);
  const TangentGaussian g = tangent_gaussian(s.covariance, s.normal);
  // A variance of zero is no surfel: collinear members of a plane leave a sliver.
  constexpr float kSliver = 1e-6F;
  out.tangent[i] = g.tangent;
  out.variance_u[i] = g.variance_u;
  out.variance_v[i] = std::max(g.variance_v, kSliver * g.variance_u);
  out.level[i] = static_cast<std::uint8_t>(level);
}

/// What a thread needs to merge surfels.
struct Merger {
  SurfelPartition partition;
  std::vector<MergeSurfel> members;

  /// Merges `members` into as many surfels as a cluster has, and fills in its bounds from them and
  /// from its children, all but the sphere.
  void run(TreeCluster& cluster, std::span<const TreeCluster> children, const SheetRules& sheets,
           MergeSurfel* to) {
    partition.run(members, cluster.end - cluster.begin, sheets);
    float reach = 0;
    for (std::size_t g = 0; g < partition.size(); ++g) {
      to[g] = merged(members, partition.members(g));
      to[g].extent2 = partition.extent2(g);
      reach = std::max(reach, reach_of(to[g]));
    }
    cluster.spacing = spacing_of({to, partition.size()});
    cluster.bounds.max_deviation = reach;
    cluster.reach_min = children.front().reach_min;
    cluster.reach_max = children.front().reach_max;
    for (const TreeCluster& child : children) {
      cluster.bounds.max_deviation =
          std::max(cluster.bounds.max_deviation, child.bounds.max_deviation);
      cluster.reach_min = cluster.reach_min.cwiseMin(child.reach_min);
      cluster.reach_max = cluster.reach_max.cwiseMax(child.reach_max);
    }
    bound_cone(cluster.bounds, children);
  }
};

/// One level of a block: its clusters, which count surfels and children from the level's first, and
/// its merged surfels; level 0 has none.
struct Level {
  std::vector<TreeCluster> clusters;
  Array<MergeSurfel> surfels;
};

/// The levels of a block.
class BlockLevels {
 public:
  /// Keeps a reference to the cloud, whose surfels can all be drawn.
  BlockLevels(const SurfelCloud& cloud, std::size_t levels, const HierarchyOptions& options)
      : cloud_(cloud), options_(options) {
    Array<std::uint32_t> order(cloud.size());
    std::iota(order.begin(), order.end(), 0U);
    finest_ = cluster_order(cloud.position, order, options.reduction);
    make_finest();
    while (levels_.size() < levels) make_coarser();
  }

  const std::vector<Level>& levels() const { return levels_; }
  /// The surfels of all levels, coarsest first.
  SurfelCloud surfels() const;

 private:
  void make_finest();
  void make_coarser();
  void bound_finest(TreeCluster& cluster) const;

  const SurfelCloud& cloud_;
  const HierarchyOptions& options_;
  Array<std::uint32_t> finest_;  ///< Surfels of the cloud in the order of level 0.
  std::vector<Level> levels_;
};

/// Fills in the bounds and the spacing of a cluster of level 0, whose surfels are drawn as they
/// are.
void BlockLevels::bound_finest(TreeCluster& cluster) const {
  const Array<float>& variance = cloud_.anisotropic() ? cloud_.variance_u : cloud_.variance;
  constexpr std::size_t kSize = kClusterSurfels + kColumnPadding;
  std::array<float, 7 * kSize> columns;
  const auto column = [&](std::size_t i) { return columns.data() + i * kSize; };
  columns.fill(0);
  cluster.reach_min = Vec3f::Constant(std::numeric_limits<float>::infinity());
  cluster.reach_max = -cluster.reach_min;
  double area = 0;
  double spacing2 = 0;
  for (std::size_t i = 0; i < cluster.end - cluster.begin; ++i) {
    const std::uint32_t surfel = finest_[cluster.begin + i];
    const Vec3f& position = cloud_.position[surfel];
    const float deviation = std::sqrt(variance[surfel]);
    for (int axis = 0; axis < 3; ++axis) {
      column(axis)[i] = position[axis];
      if (!cloud_.normal.empty()) column(3 + axis)[i] = cloud_.normal[surfel][axis];
    }
    column(6)[i] = deviation;
    cluster.reach_min = cluster.reach_min.cwiseMin(position - Vec3f::Constant(deviation));
    cluster.reach_max = cluster.reach_max.cwiseMax(position + Vec3f::Constant(deviation));
    // Its piece of surface is taken for a square.
    const double piece = std::max(0.0F, amplitude(cloud_, surfel));
    area += piece;
    spacing2 += piece * piece;
  }
  cluster.spacing = area > 0 ? static_cast<float>(std::sqrt(spacing2 / area)) : 0.0F;
  cluster.bounds = cluster_bounds({.position = {column(0), column(1), column(2)},
                                   .normal = {column(3), column(4), column(5)},
                                   .deviation_u = column(6),
                                   .deviation_v = column(6),
                                   .count = cluster.end - cluster.begin});
}

void BlockLevels::make_finest() {
  Level& level = levels_.emplace_back();
  level.clusters = finest_clusters(finest_.size());
  parallel_each(level.clusters.size(), kClusterGrain,
                [&](std::size_t c) { bound_finest(level.clusters[c]); });
}

void BlockLevels::make_coarser() {
  const std::size_t number = levels_.size();
  levels_.emplace_back();
  Level& level = levels_.back();
  const Level& finer = levels_[number - 1];
  level.clusters = coarser_clusters(finer.clusters, options_.reduction);
  level.surfels.resize(level.clusters.back().end);
  PerWorker<Merger> workers;
  parallel_for(
      level.clusters.size(), kClusterGrain, [&](std::size_t first, std::size_t last, int w) {
        Merger& merger = workers[w];
        for (std::size_t c = first; c < last; ++c) {
          TreeCluster& cluster = level.clusters[c];
          const std::span<const TreeCluster> children(finer.clusters.data() + cluster.first_child,
                                                      cluster.child_count);
          merger.members.clear();
          for (std::uint32_t i = children.front().begin; i < children.back().end; ++i) {
            merger.members.push_back(finer.surfels.empty() ? merge_surfel(cloud_, finest_[i])
                                                           : finer.surfels[i]);
          }
          merger.run(cluster, children, options_.sheets, level.surfels.data() + cluster.begin);
          bound_sphere(cluster.bounds, cloud_.position,
                       finest_below(finest_, number, c, options_.reduction));
        }
      });
}

SurfelCloud BlockLevels::surfels() const {
  std::size_t coarser = 0;
  for (const Level& level : levels_) coarser += level.surfels.size();
  Array<std::uint32_t> source(coarser + finest_.size());
  std::size_t at = 0;
  for (auto level = levels_.rbegin(); level != levels_.rend(); ++level) {
    for (const MergeSurfel& s : level->surfels) source[at++] = s.source;
  }
  std::copy(finest_.begin(), finest_.end(), source.begin() + static_cast<std::ptrdiff_t>(at));
  SurfelCloud out = level_columns(cloud_, source);
  at = 0;
  for (std::size_t l = levels_.size(); l-- > 1;) {
    const Array<MergeSurfel>& surfels = levels_[l].surfels;
    parallel_each(surfels.size(), kGrain,
                  [&](std::size_t i) { write_merged(out, at + i, surfels[i], l); });
    at += surfels.size();
  }
  return out;
}

/// The surfels of a block that can be drawn.
SurfelCloud read_block(const SurfelRanges& ranges, const CurveBlock& block) {
  SurfelCloud cloud = ranges.read(block.begin, block.end);
  if (block.count == block.end - block.begin) return cloud;
  Array<std::uint32_t> order(cloud.size());
  std::iota(order.begin(), order.end(), 0U);
  remove_unusable(cloud, false, order);
  return cloud.gathered(order);
}

/// The levels of a cloud, made block by block.
class Hierarchy {
 public:
  Hierarchy(const SurfelRanges& ranges, const std::vector<CurveBlock>& blocks,
            const HierarchyOptions& options, LevelSink& sink, const std::string& name)
      : ranges_(ranges),
        blocks_(blocks),
        options_(options),
        sink_(sink),
        name_(name),
        plan_(blocks, options.reduction) {}

  void merge(HierarchyReport& report);
  void join(HierarchyReport& report);

 private:
  std::size_t blocks_at_once(const SurfelCloud& surfel, const SurfelCloud& drawn) const;
  void begin(const SurfelCloud& drawn);
  void make_block(std::size_t block);
  std::string state(const std::vector<LevelPart>& parts) const;
  bool set_state(const std::vector<LevelPart>& parts, std::string_view state);
  bool restore_block(std::size_t block, const std::vector<LevelPart>& parts);
  void keep_block(std::size_t block, const std::vector<LevelPart>& parts) const;
  bool mine(std::size_t block) const;
  void gather_blocks();
  template <class Visit>
  static void visit_state(auto& hierarchy, const std::vector<LevelPart>& parts, const Visit& visit);
  void keep_root(const BlockLevels& block, const SurfelCloud& surfels, const LevelPart& part);
  void make_upper(std::size_t number);
  void describe(HierarchyReport& report) const;

  const SurfelRanges& ranges_;
  const std::vector<CurveBlock>& blocks_;
  const HierarchyOptions& options_;
  LevelSink& sink_;
  const std::string& name_;
  LevelPlan plan_;
  ClusterTree tree_;
  SurfelCloud roots_;          ///< The coarsest level of all blocks; empty where it is the root.
  Array<MergeSurfel> merged_;  ///< The coarsest level so far, above the blocks or theirs.
};

/// \param drawn  a surfel with level_columns()
void Hierarchy::begin(const SurfelCloud& drawn) {
  sink_.begin(drawn, plan_.surfels(), plan_.clusters());
  tree_.resize(plan_.clusters());
  if (plan_.block_levels() == plan_.levels()) return;
  const std::size_t roots = plan_.level(plan_.block_levels() - 1).surfels;
  roots_ = cloud_of_rows(drawn, roots);
  merged_.resize(roots);
}

/// How many blocks the threads may work on at the same time: one, on which they work together, or
/// one each. Throws Error(kInput) if one is too much.
std::size_t Hierarchy::blocks_at_once(const SurfelCloud& surfel, const SurfelCloud& drawn) const {
  const std::size_t row = row_bytes(drawn);
  std::size_t most = 0;
  for (const CurveBlock& block : blocks_) most = std::max(most, block.end - block.begin);
  // The finest level is there as it was read and as it is written, with its order and the places
  // that it was sorted by; the coarser ones, which have 1 / (reduction - 1) as many surfels, are
  // there as they were merged and as they are written.
  constexpr std::size_t kOrder = 2 * sizeof(std::uint32_t) + 4 * sizeof(float);
  const std::uint64_t each =
      most * (row_bytes(surfel) + row + kOrder +
              (row + sizeof(MergeSurfel)) / static_cast<std::size_t>(options_.reduction - 1));
  const std::size_t roots =
      plan_.block_levels() < plan_.levels() ? plan_.level(plan_.block_levels() - 1).surfels : 0;
  // A block has a place in each level. The levels above the roots have half as many surfels.
  constexpr std::size_t kPlaces = 256;
  const std::uint64_t always = plan_.clusters() * sizeof(TreeCluster) +
                               blocks_.size() * (sizeof(CurveBlock) + kPlaces) +
                               std::uint64_t{roots} * 3 / 2 * (row + sizeof(MergeSurfel));
  const auto threads = static_cast<std::size_t>(thread_count());
  // Few blocks would leave threads without work.
  const bool many = blocks_.size() >= 4 * threads;
  if (options_.memory == 0) return many ? threads : 1;
  if (always + each > options_.memory) {
    throw_input(name_, fmt::format("levels of its surfels take {} MB of memory, and `memory` is "
                                   "{} MB; give more",
                                   ((always + each) >> 20) + 1, options_.memory >> 20));
  }
  return many && (options_.memory - always) / each >= threads ? threads : 1;
}

void Hierarchy::merge(HierarchyReport& report) {
  const SurfelCloud surfel = ranges_.read(0, 1);
  const SurfelCloud drawn = level_columns(surfel, {0});
  report.blocks = blocks_.size();
  report.blocks_at_once = blocks_at_once(surfel, drawn);
  begin(drawn);
  ProgressStage stage("merging levels of detail", plan_.level(0).surfels, "surfels");
  const auto make = [&](std::size_t b) {
    if (mine(b)) {
      make_block(b);
    } else if (options_.checkpoints) {
      options_.checkpoints->finished(b);  // What is kept of it stays in memory otherwise.
    }
    stage.add(blocks_[b].count);
  };
  if (report.blocks_at_once == 1) {
    for (std::size_t b = 0; b < blocks_.size(); ++b) make(b);
  } else {
    parallel_each(blocks_.size(), 1, make);
  }
  if (options_.peers) gather_blocks();
}

/// Calls visit(bytes, count) for all that blocks leave in memory of one of them.
template <class Visit>
void Hierarchy::visit_state(auto& hierarchy, const std::vector<LevelPart>& parts,
                            const Visit& visit) {
  static_assert(std::is_trivially_destructible_v<MergeSurfel>);
  const auto visit_rows = [&](auto& values, std::size_t begin, std::size_t count) {
    visit(values.data() + begin, count * sizeof(values[0]));
  };
  for (const LevelPart& part : parts)
    visit_rows(hierarchy.tree_, part.first_cluster, part.clusters);
  if (hierarchy.merged_.empty()) return;
  const LevelPlan& plan = hierarchy.plan_;
  const LevelPart& root = parts.back();
  const std::size_t at = root.first_surfel - plan.level(plan.block_levels() - 1).first_surfel;
  visit_rows(hierarchy.merged_, at, root.surfels);
  SurfelCloud::visit_columns(hierarchy.roots_, [&](auto& column) {
    if (!column.empty()) visit_rows(column, at, root.surfels);
  });
  for (auto& extra : hierarchy.roots_.extra) {
    const std::size_t size = scalar_size(extra.type);
    visit_rows(extra.data, at * size, root.surfels * size);
  }
}

/// All that blocks leave in memory of one of them.
std::string Hierarchy::state(const std::vector<LevelPart>& parts) const {
  std::string state;
  visit_state(*this, parts, [&](const void* bytes, std::size_t count) {
    state.append(static_cast<const char*>(bytes), count);
  });
  return state;
}

/// Takes over what another run or process made of a block; false if it is not of this block's size.
bool Hierarchy::set_state(const std::vector<LevelPart>& parts, std::string_view state) {
  std::size_t bytes = 0;
  visit_state(*this, parts, [&](void*, std::size_t count) { bytes += count; });
  if (bytes != state.size()) return false;
  const char* from = state.data();
  visit_state(*this, parts, [&](void* to, std::size_t count) {
    std::memcpy(to, from, count);
    from += count;
  });
  return true;
}

/// Takes over a block that an earlier run made.
bool Hierarchy::restore_block(std::size_t number, const std::vector<LevelPart>& parts) {
  if (!options_.checkpoints) return false;
  const std::optional<std::string> state = options_.checkpoints->finished(number);
  return state && set_state(parts, *state);
}

void Hierarchy::keep_block(std::size_t number, const std::vector<LevelPart>& parts) const {
  if (!options_.checkpoints) return;
  std::vector<RowSpan> rows;
  for (const LevelPart& part : parts) {
    rows.push_back({part.first_surfel, part.first_surfel + part.surfels});
  }
  options_.checkpoints->finish(number, rows, state(parts));
}

/// Is a block this process's?
bool Hierarchy::mine(std::size_t block) const {
  if (!options_.peers) return true;
  return block % static_cast<std::size_t>(options_.peers->count()) ==
         static_cast<std::size_t>(options_.peers->rank());
}

/// Hands the first process what blocks of others leave in memory.
void Hierarchy::gather_blocks() {
  Peers& peers = *options_.peers;
  const auto count = static_cast<std::size_t>(peers.count());
  // So many blocks at a time, each process one: a block's state is some megabytes.
  for (std::size_t first = 0; first < blocks_.size(); first += count) {
    std::vector<Bytes> to(count);
    const std::size_t own = first + static_cast<std::size_t>(peers.rank());
    if (own < blocks_.size() && peers.rank() > 0) {
      const std::string bytes = state(plan_.block(own));
      append_values(bytes.data(), bytes.size(), to[0]);
    }
    const std::vector<Bytes> from = peers.exchange(std::move(to));
    for (std::size_t rank = 1; peers.rank() == 0 && rank < count && first + rank < blocks_.size();
         ++rank) {
      const auto* const bytes = reinterpret_cast<const char*>(from[rank].data());
      if (!set_state(plan_.block(first + rank), {bytes, from[rank].size()})) {
        throw_input(name_, "processes do not agree on its blocks; give all the same file");
      }
    }
  }
}

void Hierarchy::make_block(std::size_t number) {
  const std::vector<LevelPart> parts = plan_.block(number);
  if (restore_block(number, parts)) return;
  const SurfelCloud cloud = read_block(ranges_, blocks_[number]);
  const BlockLevels block(cloud, parts.size(), options_);
  const SurfelCloud surfels = block.surfels();
  std::size_t at = 0;
  for (std::size_t l = parts.size(); l-- > 0;) {
    const LevelPart& part = parts[l];
    sink_.put(surfels, at, at + part.surfels, part.first_surfel);
    at += part.surfels;
    const std::vector<TreeCluster>& clusters = block.levels()[l].clusters;
    for (std::size_t c = 0; c < clusters.size(); ++c) {
      TreeCluster& cluster = tree_[part.first_cluster + c];
      cluster = clusters[c];
      cluster.begin += static_cast<std::uint32_t>(part.first_surfel);
      cluster.end += static_cast<std::uint32_t>(part.first_surfel);
      if (l > 0) cluster.first_child += static_cast<std::uint32_t>(parts[l - 1].first_cluster);
    }
  }
  if (!merged_.empty()) keep_root(block, surfels, parts.back());
  keep_block(number, parts);
}

/// Keeps a block's coarsest level, to be merged further.
void Hierarchy::keep_root(const BlockLevels& block, const SurfelCloud& surfels,
                          const LevelPart& part) {
  const std::size_t at = part.first_surfel - plan_.level(plan_.block_levels() - 1).first_surfel;
  copy_rows(surfels, 0, part.surfels, roots_, at);
  const Array<MergeSurfel>& root = block.levels().back().surfels;
  for (std::size_t i = 0; i < root.size(); ++i) {
    merged_[at + i] = root[i];
    merged_[at + i].source = static_cast<std::uint32_t>(at + i);
  }
}

/// Makes a level above the blocks.
void Hierarchy::make_upper(std::size_t number) {
  const std::vector<LevelPlan::Upper>& clusters = plan_.upper(number);
  const LevelPart& level = plan_.level(number);
  const LevelPart& finer = plan_.level(number - 1);
  Array<MergeSurfel> surfels(level.surfels);
  PerWorker<Merger> workers;
  parallel_for(clusters.size(), 1, [&](std::size_t c, std::size_t, int w) {
    TreeCluster& cluster = tree_[level.first_cluster + c];
    cluster = clusters[c].cluster;
    const std::span<const TreeCluster> children(tree_.data() + cluster.first_child,
                                                cluster.child_count);
    const auto first = merged_.begin() - static_cast<std::ptrdiff_t>(finer.first_surfel);
    Merger& merger = workers[w];
    merger.members.assign(first + children.front().begin, first + children.back().end);
    merger.run(cluster, children, options_.sheets,
               surfels.data() + (cluster.begin - level.first_surfel));
    // The positions below are no longer there: the sphere is the one of their box, or around the
    // children's spheres.
    const auto& [low, high] = clusters[c].box;
    ClusterBounds& bounds = cluster.bounds;
    bounds.center = low + (high - low) / 2;
    float radius = 0;
    for (const TreeCluster& child : children) {
      radius = std::max(radius, (child.bounds.center - bounds.center).norm() + child.bounds.radius);
    }
    bounds.radius = std::min(radius, (high - bounds.center).norm()) * (1.0F + 1e-5F);
  });
  Array<std::uint32_t> source(surfels.size());
  for (std::size_t i = 0; i < source.size(); ++i) source[i] = surfels[i].source;
  SurfelCloud part = level_columns(roots_, source);
  parallel_each(surfels.size(), kGrain,
                [&](std::size_t i) { write_merged(part, i, surfels[i], number); });
  sink_.put(part, 0, part.size(), level.first_surfel);
  merged_ = std::move(surfels);
}

void Hierarchy::join(HierarchyReport& report) {
  if (options_.peers && options_.peers->rank() > 0) return;
  for (std::size_t l = plan_.block_levels(); l < plan_.levels(); ++l) make_upper(l);
  // Moments are areas times squared distances, which overflow long before the lengths do.
  if (!tree_problem(tree_, plan_.surfels()).empty()) {
    throw_input(name_,
                "its extent is too large for single precision, in which surfels are merged; "
                "scale it down, or remove points that lie far away");
  }
  describe(report);
  sink_.finish(std::move(tree_));
}

void Hierarchy::describe(HierarchyReport& report) const {
  for (std::size_t l = 0; l < plan_.levels(); ++l) {
    const LevelPart& level = plan_.level(l);
    double spacing2 = 0;
    for (std::size_t c = level.first_cluster; c < level.first_cluster + level.clusters; ++c) {
      spacing2 += (tree_[c].end - tree_[c].begin) *
                  portable::squared(static_cast<double>(tree_[c].spacing));
    }
    report.levels.push_back(level.surfels);
    report.spacing.push_back(std::sqrt(spacing2 / static_cast<double>(level.surfels)));
  }
  report.surfels = plan_.surfels();
  report.clusters = plan_.clusters();
}

/// Levels in memory.
class LevelsInMemory final : public LevelSink {
 public:
  void begin(const SurfelCloud& like, std::size_t surfels, std::size_t) override {
    cloud = cloud_of_rows(like, surfels);
  }
  void put(const SurfelCloud& part, std::size_t begin, std::size_t end, std::size_t at) override {
    copy_rows(part, begin, end, cloud, at);
  }
  void finish(ClusterTree tree) override { cloud.tree = std::move(tree); }

  SurfelCloud cloud;
};

}  // namespace

std::vector<std::string> HierarchyOptions::problems() const {
  std::vector<std::string> found = sheets.problems();
  check_option(found, reduction >= 2 && reduction <= 16, "reduction", reduction, "in 2..16");
  return found;
}

bool build_hierarchy(const SurfelRanges& ranges, const HierarchyOptions& options, LevelSink& sink,
                     HierarchyReport* report, const std::string& name) {
  require_usable(options);
  if (ranges.size() == 0) throw_input(name, "holds no surfel");
  if (!has_variance(ranges.read(0, 1))) {
    throw_input(name,
                "the surfels have no variance (nor radius); make it with surfel-from-mesh or "
                "surfel-estimate");
  }
  // Together with all coarser levels, 32-bit indices must do.
  if (ranges.size() > std::numeric_limits<std::uint32_t>::max() / 2 - (1U << 20)) {
    throw_input(name, "holds more than 2.1 billion surfels; levels of detail take no more");
  }
  HierarchyReport own;
  HierarchyReport& r = report ? *report : own;
  r = {};
  StageTimer stage(r.stages);
  const CurveBlocks cut = curve_blocks(ranges, most_block_surfels(options.reduction));
  if (!cut.in_order) return false;
  if (cut.blocks.empty()) throw_input(name, "holds no surfel that can be drawn");
  r.dropped = cut.dropped;
  stage.end("cut");
  Hierarchy hierarchy(ranges, cut.blocks, options, sink, name);
  hierarchy.merge(r);
  stage.end("merge");
  hierarchy.join(r);
  stage.end("join");
  return true;
}

SurfelCloud build_hierarchy(const SurfelCloud& cloud, const HierarchyOptions& options,
                            HierarchyReport* report, const std::string& name) {
  require_usable(options);
  cloud.check_columns(name);
  LevelsInMemory sink;
  build_hierarchy(OrderedCloud(cloud), options, sink, report, name);
  return std::move(sink.cloud);
}

}  // namespace surfel
